"""What goes wrong with the rig and its sensors, at its sample and from there on."""

from math import hypot, tau

import numpy as np
import pytest

from daq.backends.emulator import Emulator
from daq.rig import RigError, load_rig
from simulator.faults import Fault, FaultKind
from simulator.readings import Readings
from simulator.rig import Pin
from simulator.sensors import sensor_table
from simulator.simulation import Simulation, signals_for
from simulator.unbalance import UnbalanceMass, with_masses, with_unbalance
from tests.simulator.rigs import changed, hanging, ideal, model_of, signals

RIG = load_rig("thesis-ball")
ONSET, END = 1003, 1800  # samples


@pytest.fixture(scope="module")
def truth() -> np.ndarray:
    """Return true signals of a rig that runs through impacts."""
    simulation = Simulation(model_of("ball"), state=hanging(model_of("ball"), 11.0))
    signals(simulation, 0.5)
    return signals(simulation, 0.1)


def read(truth: np.ndarray, *faults: Fault, chunk: int = 2500) -> np.ndarray:
    """Return raw readings (n_channels, n) with faults, read in chunks."""
    table = sensor_table(RIG.channels, RIG.model, RIG.encoder, 20.0, RIG.emulator)
    readings, parts = Readings(RIG.channels, table, faults, 25000.0, 7), []
    for begin in range(0, truth.shape[1], chunk):
        signals = np.ascontiguousarray(truth[:, begin : begin + chunk])
        parts.append(np.empty((len(RIG.channels), signals.shape[1])))
        readings.read(signals, begin, parts[-1])
    return np.concatenate(parts, axis=1)


def fault(kind: FaultKind, channel: str, size: float | None = None, **fields) -> Fault:
    """Return a fault of a channel at the sample `ONSET`."""
    return Fault(kind, ONSET / 25000.0, size, channel, **fields)


def difference(truth: np.ndarray, channel: str, *faults: Fault) -> np.ndarray:
    """Return what faults change in a channel, V or counts; before them, and elsewhere, nothing."""
    change = read(truth, *faults) - read(truth)
    row = RIG.channels.names.index(channel)
    assert not np.delete(change, row, axis=0).any()
    assert not change[row, :ONSET].any()
    return change[row, ONSET:]


STEP = 20.0 / 2**16  # V, the converter's


def test_gain_and_drift_and_runout_are_what_they_say(truth):
    y = 2500.0 * 0.3035 * truth[1, ONSET:]
    found = difference(truth, "proximity_y", fault(FaultKind.GAIN, "proximity_y", 0.9))
    assert found == pytest.approx(-0.1 * y, abs=STEP)  # two roundings
    ages = np.arange(len(y)) / 25000.0
    found = difference(truth, "proximity_y", fault(FaultKind.DRIFT, "proximity_y", 2e-3))
    assert found == pytest.approx(2500.0 * 2e-3 * ages, abs=STEP)
    found = difference(truth, "proximity_y", fault(FaultKind.RUNOUT, "proximity_y", 1e-5, angle_deg=90.0))
    assert found == pytest.approx(2500.0 * 1e-5 * np.sin(truth[9, ONSET:]), abs=STEP)


def test_noise_skew_stuck_and_open_are_what_they_say(truth):
    found = difference(truth, "force_top", fault(FaultKind.NOISE, "force_top", 20.0))
    # The same tosses, louder: 0.5 N rms becomes 20.006 N rms.
    assert found.std() == pytest.approx(0.02 * 19.5, rel=0.05)
    whole = read(truth)
    row = RIG.channels.names.index("encoder_angle")
    skewed = read(truth, fault(FaultKind.SKEW, "encoder_angle", 40))[row]
    assert np.array_equal(skewed[ONSET:], whole[row, ONSET - 40 : -40])
    row = RIG.channels.names.index("proximity_x")
    stuck = read(truth, fault(FaultKind.STUCK, "proximity_x"))[row]
    assert (stuck[ONSET:] == whole[row, ONSET]).all()
    open_input = read(truth, fault(FaultKind.OPEN, "proximity_x"))[row]
    assert (open_input[ONSET:] == -10.0).all()


def test_faults_are_the_same_bytes_however_they_are_read(truth):
    faults = [
        fault(FaultKind.GAIN, "proximity_x", 1.1),
        Fault(FaultKind.SKEW, 0.0301, 7, "proximity_x"),
        Fault(FaultKind.RUNOUT, 0.05, 2e-5, "proximity_x"),
        Fault(FaultKind.STUCK, 0.08, None, "proximity_x"),
        fault(FaultKind.DRIFT, "force_left", 100.0),
        Fault(FaultKind.SKEW, 0.0, 3, "encoder_angle"),
        Fault(FaultKind.STUCK, 0.06, None, "encoder_turns"),
        Fault(FaultKind.OPEN, 0.07, None, "force_top"),
    ]
    whole = read(truth, *faults)
    assert (whole != read(truth)).any(axis=1).sum() >= 4
    for chunk in (1, 50, 999):
        assert np.array_equal(whole, read(truth, *faults, chunk=chunk))


@pytest.mark.parametrize(
    ("kind", "size"),
    [
        (FaultKind.GAIN, 0.9),
        (FaultKind.DRIFT, 2e-3),
        (FaultKind.RUNOUT, 1e-5),
        (FaultKind.NOISE, 1e-5),
        (FaultKind.SKEW, 40),
        (FaultKind.STUCK, None),
        (FaultKind.OPEN, None),
    ],
)
def test_a_sensor_s_fault_that_ends_is_the_same_until_then_and_leaves_no_trace(truth, kind, size):
    lasting = fault(kind, "proximity_y", size)
    passing = lasting._replace(duration=(END - ONSET) / 25000.0)
    whole, bad, found = read(truth), read(truth, lasting), read(truth, passing)
    assert np.array_equal(found[:, :END], bad[:, :END])
    assert np.array_equal(found[:, END:], whole[:, END:])
    assert not np.array_equal(found, whole)
    assert np.array_equal(found, read(truth, passing, chunk=77))


def test_a_magnet_that_comes_back_lifts_the_rotor_again():
    model, passing = ideal("ball"), Fault(FaultKind.MAGNET_LOST, 0.1, duration=0.3)
    found = []
    for chunk in (2500, 333):
        simulation, parts = Simulation(model, state=hanging(model, 6.0), faults=[passing]), []
        while simulation.sample < 150_000:
            parts.append(signals_for(min(chunk, 150_000 - simulation.sample)))
            simulation.advance(parts[-1])
        found.append(np.concatenate(parts, axis=1))
        assert simulation.model == simulation.whole
    assert np.array_equal(*found)
    assert found[0][13, 2500:10_000].max() > 30.0  # it has fallen
    whole = signals(Simulation(model, state=hanging(model, 6.0)), 6.0)
    # Freely decaying: zeta 0.023 at 10 Hz leaves exp(-7.2) of at most the clearance after 5 s.
    last = np.s_[:2, -2500:]
    assert abs(found[0][last] - whole[last]).max() < 2e-3 * 1.5e-3 / 0.211


def test_pins_wear_each_by_itself_and_one_is_mended():
    model = ideal("pinned")
    faults = [
        Fault(FaultKind.WORN_PIN, 0.01, 1e-4, pin=2),
        Fault(FaultKind.WORN_PIN, 0.02, 2e-4, pin=4, duration=0.02),
        Fault(FaultKind.WORN_PIN, 0.03, 3e-4, pin=2),
    ]
    simulation, wears = Simulation(model, faults=faults), []
    for _ in range(5):
        signals(simulation, 0.01)
        signals(simulation, 4e-5)  # a fault begins with its first sample
        wears.append({pin.number: pytest.approx(pin.wear) for pin in simulation.model.backup_bearing.pins})
    assert wears == [{2: 1e-4}, {2: 1e-4, 4: 2e-4}, {2: 4e-4, 4: 2e-4}, {2: 4e-4}, {2: 4e-4}]


def test_the_magnet_s_loss_drops_the_rotor_onto_its_bearing():
    model = ideal("ball")
    lost = Simulation(model, state=hanging(model, 10.0), faults=[Fault(FaultKind.MAGNET_LOST, 0.1)])
    whole = Simulation(model, state=hanging(model, 10.0))
    before, after = signals(lost, 0.1), signals(lost, 1.0)
    assert np.array_equal(before, signals(whole, 0.1))
    assert after[13].max() > 30.0  # it falls through what is left of the gap and bounces
    assert after[13, -2500:].mean() > 5.0  # and stays there: 12.6 N of weight, less the coupling's part


def test_the_rig_s_faults_come_at_their_sample_however_advance_is_divided():
    model = ideal("pinned")
    faults = [
        Fault(FaultKind.CLEARANCE_CHANGED, 0.02, 1e-4),
        Fault(FaultKind.UNBALANCE_STEP, 0.0101, 5e-4, angle_deg=30.0),
        Fault(FaultKind.WORN_PIN, 0.03, 2e-4, pin=3),
        Fault(FaultKind.MAGNET_LOST, 0.04),
    ]
    found = []
    for chunk in (2500, 100, 7):
        simulation, parts = Simulation(model, state=hanging(model, 10.5), faults=faults), []
        while simulation.sample < 2500:
            parts.append(signals_for(min(chunk, 2500 - simulation.sample)))
            simulation.advance(parts[-1])
        found.append(np.concatenate(parts, axis=1))
        bearing = simulation.model.backup_bearing
        assert bearing.pins == (Pin(wear=2e-4, number=3),)
        assert bearing.clearance == pytest.approx(1.6e-3)
        assert simulation.model.magnetic_bearing.stiffness == 0.0
    assert np.array_equal(found[0], found[1])
    assert np.array_equal(found[0], found[2])


def test_unbalances_add_as_vectors_and_masses_bring_their_weight():
    rotor = model_of("ball").rotor
    both = with_unbalance(rotor, 75e-6, 90.0)
    assert both.unbalance == pytest.approx(75e-6 * 2**0.5)
    assert both.unbalance_angle == pytest.approx(tau / 8)
    assert with_unbalance(both, 75e-6 * 2**0.5, 225.0).unbalance == pytest.approx(0.0, abs=1e-18)
    # The thesis' 30 g at 33 mm, once in the disk's plane, and once at half its distance from the pivot.
    heavy = with_masses(rotor, [UnbalanceMass("bolt", 0.030, 0.033, 0.0, 0.3035)])
    assert heavy.unbalance == pytest.approx(75e-6 + 990e-6)
    assert heavy.mass == pytest.approx(1.31)
    moment = heavy.mass * heavy.centre_of_mass_station
    assert moment == pytest.approx(1.28 * 0.1959 + 0.030 * 0.3035)
    assert heavy.inertia == pytest.approx(0.07714 + 0.030 * (0.3035**2 + 0.5 * 0.033**2))
    near = with_masses(rotor, [UnbalanceMass("bolt", 0.030, 0.033, 90.0, 0.3035 / 2)])
    assert near.unbalance == pytest.approx(hypot(75e-6, 495e-6))
    assert with_masses(rotor, []) == rotor


def test_a_description_s_masses_and_faults_reach_model_and_emulator(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(
        '[rig]\nbase = "thesis-ball"\nname = "mine"\n'
        '[[unbalance_mass]]\nname = "bolt"\nmass = 0.003\nradius = 0.033\nangle_deg = 0.0\nstation = 0.3035\n'
        "[emulator.actual]\nrotor.unbalance = 80e-6\n"
        '[[emulator.fault]]\nkind = "magnet-lost"\nat = 0.02\n'
        '[[emulator.fault]]\nkind = "stuck"\nat = 0.01\nchannel = "force_top"\n'
    )
    rig = load_rig(path)
    assert rig.model.rotor.unbalance == pytest.approx(75e-6 + 99e-6)
    assert rig.emulated_model.rotor.unbalance == pytest.approx(80e-6 + 99e-6)
    assert len(rig.faults) == 2
    runs = []
    for read_size in (50, 500):
        device = Emulator(paced=False)
        device.open(rig)
        device.start()
        parts = []
        for _ in range(1000 // read_size):
            parts.append(np.empty((len(rig.channels), read_size)))
            device.read(parts[-1])
        runs.append(np.concatenate(parts, axis=1))
        fall = 2500.0 * 0.3035 * (device.truth()[1, -1] - Simulation(rig.emulated_model).state[1])
        assert fall < -0.05  # V: 20 ms of falling
    assert np.array_equal(*runs)
    row = rig.channels.names.index("force_top")
    assert len(set(runs[0][row, 250:])) == 1
    assert len(set(runs[0][row, :250])) > 1


# Each case: rows of [[emulator.fault]], and what the message names.
BAD = {
    "unknown kind": ('kind = "melt"\nat = 1.0', 'kind = "melt" must be one of gain, drift'),
    "no channel": ('kind = "stuck"\nat = 1.0', 'kind = "stuck" needs a channel'),
    "channel too many": (
        'kind = "magnet-lost"\nat = 1.0\nchannel = "force_top"',
        'kind = "magnet-lost" has no channel',
    ),
    "wrong channel": ('kind = "stuck"\nat = 1.0\nchannel = "force_tip"', "did you mean force_top"),
    "no size": ('kind = "gain"\nat = 1.0\nchannel = "force_top"', "needs size: the factor"),
    "size too many": ('kind = "open"\nat = 1.0\nsize = 1.0\nchannel = "force_top"', "has no size"),
    "part of a sample": (
        'kind = "skew"\nat = 1.0\nsize = 1.5\nchannel = "force_top"',
        "size = 1.5 must be a whole number",
    ),
    "more than is kept": (
        'kind = "skew"\nat = 1.0\nsize = 10_001\nchannel = "force_top"',
        "size = 10001 must be a whole number of samples from 0 to 10000",
    ),
    "more repeated than is kept": (
        'kind = "repeated"\nat = 1.0\nsize = 1_000_000',
        r"size = 1e\+06 must be a whole number of samples from 0 to 10000",
    ),
    "too early": ('kind = "magnet-lost"\nat = -1.0', "at = -1 is outside"),
    "no pin": ('kind = "worn-pin"\nat = 1.0\nsize = 1e-4', "needs a pinned one"),
    "no gap left under a pin": (
        'kind = "worn-pin"\nat = 1.0\nsize = -2e-3\npin = 3',
        r"\[\[emulator\.fault\]\] from 1 s on: \[backup_bearing\.pin\.3\] wear = -0\.002 m leaves a gap",
    ),
    "no time": (
        'kind = "magnet-lost"\nat = 1.0\nduration = 1e-6',
        r'kind = "magnet-lost" duration = 1e-06 s is over within a sample, which takes 4e-05 s',
    ),
    "time of what is over at once": (
        'kind = "dropped"\nat = 1.0\nsize = 10\nduration = 1.0',
        'kind = "dropped" has no duration; leave it out',
    ),
    "negative time": ('kind = "magnet-lost"\nat = 1.0\nduration = -1.0', "duration = -1 is outside"),
    "no gap left": ('kind = "clearance-changed"\nat = 1.0\nsize = -2e-3', "it must be above 0"),
}


@pytest.mark.parametrize(("rows", "message"), BAD.values(), ids=BAD.keys())
def test_a_wrong_fault_is_refused(rows, message, tmp_path):
    path = tmp_path / "mine.toml"
    base = "thesis-pinned" if "pin = 3" in rows else "thesis-ball"
    path.write_text(f'[rig]\nbase = "{base}"\nname = "mine"\n[[emulator.fault]]\n{rows}\n')
    with pytest.raises(RigError, match=message) as caught:
        load_rig(path)
    assert "\n" not in str(caught.value)


def test_a_counter_has_no_gain():
    with pytest.raises(
        RigError, match=r'"gain" does not go with encoder_angle, a counter; it may be skew, stuck'
    ):
        read(np.zeros((17, 10)), fault(FaultKind.GAIN, "encoder_angle", 2.0))


def test_a_model_may_change_while_it_runs():
    simulation = Simulation(ideal("ball"))
    signals(simulation, 0.01)
    simulation.change(changed(ideal("ball"), backup_bearing={"damping_factor": 1.0}))
    assert (simulation.damping_factors == 1.0).all()
    with pytest.raises(RigError, match="ring_inertia"):
        simulation.change(changed(ideal("ball"), backup_bearing={"ring_inertia": 0.0}))
