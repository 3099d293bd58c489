"""The guided installation, on an emulated rig that differs from its description as a real one does."""

from math import cos, sin, tau

import numpy as np
import pytest

from daq.backends.emulator import Emulator
from daq.commanding.hand import push_round, with_hand
from daq.installation import roll_of, wall_of
from daq.rig import RigError, load_rig, rig_from_text
from daq.setup import Setup

TOLD = load_rig("thesis-ball")
TRUE = load_rig(
    "thesis-ball",
    [
        "channel.proximity_x.offset=0.9",
        "channel.proximity_y.offset=-1.3",
        "channel.force_top.offset=0.35",
        "channel.force_left.offset=-0.2",
        "channel.motor_speed.offset=0.05",
        "encoder.direction=-1",
        "encoder.index_angle_deg=37.0",
        "solenoid.horizontal.angle_deg=0.0",
    ],
)


class Installed(Emulator):
    """The true rig, whatever description it is opened with."""

    def __init__(self, true):
        super().__init__(paced=False)
        self._true = true

    def open(self, rig):
        super().open(self._true)


def connected(true):
    def connect(_rig):
        device = Installed(true)
        device.open(true)
        return device

    return connect


@pytest.fixture(scope="module")
def found():
    setup = Setup(TOLD, connected(with_hand(TRUE)), lambda device: push_round(device, 25000.0))
    setup.read()
    setup.turn()
    return setup


@pytest.fixture(scope="module")
def rig(found):
    return found.rig("thesis-ball-found")


def test_the_offsets_of_the_probes_are_those_of_the_bearings_centre(rig):
    # 2500 V/m: 0.05 V are 20 µm, an indentation at the few newtons that count as a touch
    assert rig.channels["proximity_x"].offset == pytest.approx(0.9, abs=0.05)
    assert rig.channels["proximity_y"].offset == pytest.approx(-1.3, abs=0.05)


def test_the_clearance_is_the_bearings(found):
    radius = found.findings.wall.radius * TRUE.model.rotor.bearing_station / 0.3035
    assert radius == pytest.approx(TRUE.model.backup_bearing.clearance, rel=0.02)
    assert found.findings.wall.residual < 30e-6


def test_transducers_and_tachometer_are_tared(rig):
    # 0.5 N rms noise over 25000 samples leaves 3 mN, 0.02 V/N make 0.06 mV of it
    for name, volts in (("force_top", 0.35), ("force_left", -0.2), ("force_right", 0.0)):
        assert rig.channels[name].offset == pytest.approx(volts, abs=0.002)
    assert rig.channels["motor_speed"].offset == pytest.approx(0.05, abs=0.002)


def test_the_encoders_direction_and_index_are_found(rig):
    assert rig.encoder.direction == -1
    assert rig.encoder.index_angle_deg == pytest.approx(37.0, abs=0.1)  # one count is 0.09 deg


def test_a_solenoid_that_pushes_the_other_way_is_turned_round(found, rig):
    assert TOLD.solenoid("horizontal").angle_deg == 180.0
    assert found.findings.hits["horizontal"] < -50e-6
    assert rig.solenoid("horizontal").angle_deg == 0.0


def test_what_is_right_stays():
    setup = Setup(TOLD, connected(with_hand(TOLD)), lambda device: push_round(device, 25000.0))
    setup.read()
    setup.turn()
    rig = setup.rig("again")
    assert rig.encoder.direction == 1
    assert rig.solenoid("horizontal").angle_deg == 180.0
    assert rig.limits == TOLD.limits
    assert rig.name == "again"


def test_a_runout_is_found():
    fault = '[[emulator.fault]]\nkind = "runout"\nat = 0.0\nsize = 30e-6\nchannel = "proximity_x"\n'
    true = rig_from_text(f"{with_hand(TOLD).toml}\n{fault}")
    setup = Setup(TOLD, connected(true), lambda device: push_round(device, 25000.0))
    setup.read()
    setup.turn()
    plain = Setup(TOLD, connected(with_hand(TOLD)), lambda device: push_round(device, 25000.0))
    plain.read()
    plain.turn()
    with_it, without = setup.findings.roll.runout[0], plain.findings.roll.runout[0]
    assert with_it - without == pytest.approx(30e-6, abs=2e-6)
    assert setup.rig().channels["proximity_x"].runout == pytest.approx(abs(with_it), abs=1e-9)


def test_a_circle_is_found_through_its_points():
    angles = np.linspace(0.0, tau, 30, endpoint=False)
    points = np.array([2.0 + 3.0 * np.cos(angles), -1.0 + 3.0 * np.sin(angles)])
    wall = wall_of(points)
    assert wall.centre == pytest.approx([2.0, -1.0])
    assert wall.radius == pytest.approx(3.0)
    assert wall.residual == pytest.approx(0.0, abs=1e-9)


def test_a_wall_that_was_not_touched_all_round_is_refused():
    angles = np.radians([0.0, 30.0, 60.0, 90.0, 120.0, 150.0, 180.0])
    points = np.array([[cos(angle), sin(angle)] for angle in angles]).T
    with pytest.raises(RigError, match="nowhere over 180 deg: push it all the way round"):
        wall_of(points)
    with pytest.raises(RigError, match="did not touch the wall"):
        wall_of(points[:, :2])


def test_a_shaft_that_does_not_turn_is_refused():
    with pytest.raises(RigError, match=r"turned 1\.0 times in the slow roll, not 3"):
        roll_of(np.linspace(0.0, tau, 100) % tau, np.zeros((1, 100)), 100.0)
