from math import pi, tau
from typing import NamedTuple

import numpy as np
import pytest

from simulator.rig import RigError
from simulator.sensors import SensorTable, read_sensors, sensor_table
from simulator.state import SIGNALS
from tests.simulator.rigs import model_of

STIFFNESS = 8.3e7  # N/m, of one force transducer


class Probe(NamedTuple):
    name: str
    quantity: str
    sensitivity: float
    offset: float = 0.0
    range: tuple[float, float] = (-10.0, 10.0)
    station: float | None = None
    angle_deg: float | None = None


class Encoder(NamedTuple):
    counts_per_turn: int = 4096
    index_angle: float = 0.0
    direction: int = 1


class Imperfections(NamedTuple):
    displacement_noise: float = 0.0
    force_noise: float = 0.0
    adc_bits: int = 16
    adc_noise: float = 0.0


def table_of(*probes: Probe, encoder: Encoder | None = None, **imperfections) -> SensorTable:
    return sensor_table(probes, model_of("ball"), encoder or Encoder(), 20.0, Imperfections(**imperfections))


def constant(count: int = 1, **values: float) -> np.ndarray:
    signals = np.zeros((len(SIGNALS), count))
    for name, value in values.items():
        signals[SIGNALS.index(name)] = value
    return signals


def read(table: SensorTable, signals: np.ndarray, first: int = 0, seed: int = 1) -> tuple[np.ndarray, bool]:
    raw = np.empty((len(table.kind), signals.shape[1]))
    clipped = read_sensors(table, signals, first, seed, raw)
    return raw, clipped


def force(name: str, angle: float) -> Probe:
    return Probe(name, "force", 0.02, station=0.211, angle_deg=angle)


def displacement(angle: float, **fields) -> Probe:
    return Probe("probe", "displacement", 2500.0, station=0.3035, angle_deg=angle, **fields)


def test_each_channel_sees_its_signal():
    table = table_of(
        displacement(0.0),
        displacement(90.0),
        displacement(45.0),
        force("top", 90.0),
        force("bottom", 270.0),
        force("left", 180.0),
        force("right", 0.0),
        Probe("motor_speed", "speed", 0.05),
        Probe("motor_speed_command", "speed", 0.05),
        Probe("solenoid_current", "current", 2.0),
    )
    raw, clipped = read(
        table,
        constant(
            tilt_x=1e-3,
            tilt_y=-2e-3,
            house_x=1e-6,
            house_y=-2e-6,
            speed=60.0,
            speed_command=80.0,
            solenoid_force=40.0,
        ),
    )
    top, right = STIFFNESS * -2e-6, STIFFNESS * 1e-6
    tilt = 0.3035 * 2500.0 * 1e-3
    expected = [
        tilt,
        -2.0 * tilt,
        -tilt * 0.5**0.5,
        0.02 * top,
        -0.02 * top,
        -0.02 * right,
        0.02 * right,
        3.0,
        4.0,
        4.0,
    ]
    assert raw[:, 0] == pytest.approx(expected, abs=0.5 * 20.0 / 65536)  # half a step of the converter
    assert not clipped


def test_volts_are_multiples_of_the_converter_s_step_and_stay_in_its_range():
    table = table_of(displacement(0.0), adc_bits=12)
    signals = constant(4001)
    signals[0] = np.linspace(-5e-3, 5e-3, 4001) / 0.3035
    raw, clipped = read(table, signals)
    step = 20.0 / 4096
    assert np.array_equal(raw / step, np.round(raw / step))
    assert raw.min() == -10.0
    assert raw.max() == 10.0 - step  # the highest code of a two's complement converter
    assert clipped
    inside = abs(signals[0] * 0.3035) < 3.99e-3
    true = 2500.0 * 0.3035 * signals[0, inside]
    assert abs(raw[0, inside] - true).max() <= 0.5 * step * (1.0 + 1e-9)
    assert not read(table, signals[:, inside].copy())[1]


def test_a_negative_sensitivity_and_an_offset_are_as_an_eddy_probe_s():
    table = table_of(
        displacement(0.0, offset=-10.0, range=(-24.0, 0.0))._replace(sensitivity=-7870.0), adc_bits=24
    )
    raw, _ = read(table, constant(tilt_x=1e-3 / 0.3035))
    assert raw[0, 0] == pytest.approx(-17.87, abs=24.0 / 2**24)  # a step of the converter


def test_noise_has_the_strength_that_was_asked_for():
    table = table_of(
        displacement(0.0), force("top", 90.0), displacement_noise=1e-6, force_noise=0.5, adc_noise=1.0
    )
    raw, _ = read(table, constant(200_000, tilt_x=0.3e-3))
    step = 20.0 / 65536
    for row, sensor in ((0, 2500.0 * 1e-6), (1, 0.02 * 0.5)):
        rms = (sensor**2 + step**2 + step**2 / 12.0) ** 0.5  # sensor, converter, rounding
        # Standard error of an rms from 2e5 values: 0.16 %; four of them.
        assert raw[row].std() == pytest.approx(rms, rel=6.4e-3)
    assert raw[0].mean() == pytest.approx(2500.0 * 0.3035 * 0.3e-3, abs=4.0 * 2.6e-3 / 200_000**0.5)


def test_readings_do_not_depend_on_how_they_are_divided():
    table = table_of(
        displacement(0.0), force("top", 90.0), displacement_noise=1e-6, force_noise=0.5, adc_noise=1.0
    )
    signals = constant(1000, tilt_x=0.3e-3)
    whole, _ = read(table, signals, first=5000)
    for size in (1, 7, 250):
        parts = [
            read(table, signals[:, begin : begin + size].copy(), first=5000 + begin)[0]
            for begin in range(0, 1000, size)
        ]
        assert np.array_equal(np.concatenate(parts, axis=1), whole)
    assert not np.array_equal(read(table, signals, first=5000, seed=2)[0], whole)


def test_a_wider_array_is_filled_as_far_as_there_are_samples():
    table = table_of(displacement(0.0))
    raw = np.full((1, 10), np.nan)
    read_sensors(table, constant(4, tilt_x=1e-3), 0, 1, raw)
    assert np.isfinite(raw[0, :4]).all()
    assert np.isnan(raw[0, 4:]).all()


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("index_angle", [0.0, 2.0])
def test_encoder_counts_within_the_turn_and_turns(direction, index_angle):
    encoder = Encoder(4096, index_angle, direction)
    probes = (Probe("encoder_angle", "angle", 4096 / tau), Probe("encoder_turns", "count", 1.0))
    signals = constant(5001)
    angle = np.linspace(-20.0, 400.0, 5001)
    signals[SIGNALS.index("angle")] = angle
    (counts, turns), clipped = read(table_of(*probes, encoder=encoder), signals)
    assert not clipped
    assert np.array_equal(counts, np.round(counts))
    assert counts.min() >= 0.0
    assert counts.max() <= 4095.0
    unwrapped = (counts + 4096.0 * turns) * tau / 4096.0
    # The nearest count: half of one, 2 pi / 8192, and rounding.
    assert abs(unwrapped - direction * (angle - index_angle)).max() <= pi / 4096 * (1.0 + 1e-9)


def test_a_channel_that_nothing_feeds_is_named():
    with pytest.raises(
        RigError, match=r"oil_temperature \(temperature\) is nothing that the emulated rig measures"
    ):
        table_of(Probe("oil_temperature", "temperature", 0.1))
    with pytest.raises(RigError, match="probe lacks angle_deg"):
        table_of(displacement(0.0)._replace(angle_deg=None))
    with pytest.raises(RigError, match=r"encoder_angle needs the table \[encoder\]"):
        sensor_table(
            [Probe("encoder_angle", "angle", 4096 / tau)], model_of("ball"), None, 20.0, Imperfections()
        )
