"""Faults injected while the rig runs are those of a description that told them beforehand."""

from math import inf, nan

import numpy as np
import pytest

from daq.backend import OutputRefused, make_backend
from daq.commanding.commands import Commands, Situation
from daq.messages_pb2 import Command
from daq.rig import load_rig
from rigtwin.emulated_rig import VirtualRig, started
from simulator.faults import Fault, FaultKind
from tests.daq.daq_process import until
from tests.daq.test_mishaps import Run, rig_with

LATER = {"at": 0.11}  # s: 2750 samples, not the end of a read


def samples(rig, seconds=0.2):
    rig.run(seconds)
    rig.close()
    return rig.signals().samples


@pytest.mark.parametrize(
    "fault",
    [
        {"kind": "gain", "channel": "proximity_x", "size": 1.5},
        {"kind": "drift", "channel": "proximity_x", "size": 1e-3, "duration": 0.03},
        {"kind": "noise", "channel": "force_top", "size": 3.0},
        {"kind": "skew", "channel": "motor_speed", "size": 40},
        {"kind": "stuck", "channel": "encoder_angle"},
        {"kind": "unbalance-step", "size": 1e-4, "angle_deg": 30.0},
        {"kind": "clearance-changed", "size": 1e-4, "duration": 0.02},
        {"kind": "dropped", "size": 130},
    ],
    ids=lambda fault: fault["kind"],
)
def test_an_injected_fault_is_the_same_to_the_byte_as_one_that_was_described(fault):
    wanted = samples(started("thesis-ball", (), [fault | LATER], None))
    rig = started("thesis-ball", (), (), None)
    rig.run(0.06)
    rig.inject(**fault, after=0.05)
    assert rig.events("inject")[0].details["kind"] == fault["kind"]
    np.testing.assert_array_equal(samples(rig, 0.14), wanted)


def test_one_that_is_injected_beside_another_changes_nothing_of_that():
    first = {"kind": "stuck", "channel": "force_top", "at": 0.05}
    second = {"kind": "skew", "channel": "proximity_y", "size": 25}
    wanted = samples(started("thesis-ball", (), [first, second | LATER], None))
    rig = started("thesis-ball", (), [first], None)
    rig.run(0.1)
    rig.inject(**second, after=0.01)
    np.testing.assert_array_equal(samples(rig, 0.1)[:, 2750 + 25 :], wanted[:, 2750 + 25 :])


def test_skews_that_together_need_too_much_of_the_past_are_refused():
    rig = started("thesis-ball", (), (), None)
    rig.run(0.01)
    rig.inject("skew", channel="proximity_x", size=6_000)
    with pytest.raises(ValueError, match=r"add up to 10001 samples.*may add up to 10000"):
        rig.inject("skew", channel="proximity_y", size=4_001)
    rig.inject("skew", channel="proximity_y", size=4_000)
    rig.run(0.01)
    rig.close()


def test_it_begins_now_and_the_rig_is_tripped_by_it():
    rig = started("thesis-ball", (), (), None)
    rig.run(0.1)
    rig.inject("open", channel="force_top", name="cable")
    (told,) = rig.events("inject")
    assert (told.text, told.details["who"]) == ("test: fault open of force_top from 0.100 s on", "test")
    trip = rig.expect("trip", within=0.1)
    assert trip.details["cause"] == "force"  # what an open input reads
    assert 2500 < trip.sample <= 2500 + 0.02 * 25_000
    rig.close()


def test_samples_come_twice_once_there_are_some():
    rig = started("thesis-ball", (), (), None)
    rig.run(0.1)
    rig.inject("repeated", size=80)
    assert rig.expect("repeated", within=0.1).details["samples"] == "80"
    rig.close()


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"kind": "opne", "channel": "force_top"}, 'inject kind = "opne" must be one of gain, drift'),
        ({"kind": "open"}, 'kind = "open" needs a channel'),
        ({"kind": "open", "channel": "force_topp"}, "is no channel of the rig; did you mean force_top"),
        ({"kind": "gain", "channel": "force_top"}, "needs size: the factor"),
        ({"kind": "open", "channel": "force_top", "after": -1.0}, "after = -1 s must not be negative"),
        (
            {"kind": "open", "channel": "force_top", "sise": 1.0},
            "inject does not take sise; did you mean size",
        ),
        ({"kind": "worn-pin", "size": 1e-4}, "needs a pinned one"),
        ({"kind": "clearance-changed", "size": -1.0}, "leaves a clearance of"),
        ({"kind": "worn-pin", "size": 1e-4, "pin": nan}, "pin = nan must be a whole number"),
        ({"kind": "worn-pin", "size": 1e-4, "pin": inf}, "pin = inf must be a whole number"),
        ({"kind": "worn-pin", "size": nan, "pin": 1}, "size = nan is outside"),
        ({"kind": "dropped", "size": 10, "after": nan}, "after = nan s must not be negative"),
        ({"kind": "dropped", "size": 10, "after": inf}, "at = inf is outside"),
        ({"kind": "late", "size": 0.1}, "a device in virtual time has no clock"),
    ],
)
def test_what_the_rig_cannot_have_is_refused_and_the_rig_goes_on(virtual, asked, said):
    with pytest.raises(ValueError, match=said):
        virtual.inject(**asked)
    virtual.run(0.02)
    assert not virtual.events("trip")


@pytest.fixture(scope="module")
def virtual():
    rig = VirtualRig(load_rig("thesis-ball"))
    yield rig
    rig.close()


def test_hardware_takes_no_faults():
    capabilities = make_backend("emulator").capabilities._replace(emulated=False)
    commands = Commands(load_rig("thesis-ball"), capabilities)
    with pytest.raises(ValueError, match="this rig is hardware: faults are injected into emulated ones"):
        commands.decide(Command(name="inject", who="anna", texts={"kind": "open"}), Situation(0, "", False))


def test_a_paced_device_is_late_and_its_clock_drifts_as_described():
    wanted = Run(rig_with(("late", 0.2, 0.1), ("clock-drift", 0.6, 5000.0))).until(1.0)
    run = Run(rig_with()).until(0.1)
    run.backend.inject(Fault(FaultKind.LATE, 0.2, 0.1))
    run.backend.inject(Fault(FaultKind.CLOCK_DRIFT, 0.6, 5000.0))
    run.until(1.0)
    assert [event.kind for event in run.events] == [event.kind for event in wanted.events]
    assert "late" in [event.kind for event in run.events]
    assert run.backend.pace == pytest.approx(wanted.backend.pace)
    assert run.backend.clock() == wanted.backend.clock() > 25_000


def test_the_past_cannot_be_changed():
    """A fault whose time has passed begins now."""
    run = Run(rig_with()).until(0.3)
    run.backend.inject(Fault(FaultKind.DROPPED, 0.1, 100))
    run.until(0.4)
    (gap,) = [event for event in run.events if event.kind == "gap"]
    assert 7450 <= int(gap.details["first"]) <= 7550


def test_the_emulated_device_takes_them_into_its_process():
    backend = make_backend("emulated-device")
    rig = load_rig("thesis-ball", ["acquisition.backend=emulated-device", "device.watchdog_s=60"])
    backend.open(rig)
    try:
        backend.start()
        with pytest.raises(OutputRefused, match="is no channel of the rig"):
            backend.inject(Fault(FaultKind.OPEN, 0.0, channel="forse"))
        backend.inject(Fault(FaultKind.DROPPED, 0.0, 100))
        out, expected, jumps = np.empty((len(rig.channels), 50)), 0, []

        def jumped():
            nonlocal expected
            reading = backend.read(out)
            if reading.n_samples:
                jumps.append(reading.first_sample - expected)
                expected = reading.first_sample + reading.n_samples
            return any(jump >= 100 for jump in jumps)

        until(jumped)
    finally:
        backend.close()


def test_two_that_the_rig_cannot_have_at_once_are_refused():
    """Each could be alone: the second would take away what the first leaves of the clearance."""
    run = Run(rig_with()).until(0.1)
    clearance = run.rig.emulated_model.backup_bearing.clearance
    run.backend.inject(Fault(FaultKind.CLEARANCE_CHANGED, 0.5, -0.6 * clearance))
    with pytest.raises(OutputRefused):
        run.backend.inject(Fault(FaultKind.CLEARANCE_CHANGED, 0.1, -0.6 * clearance))
    run.until(1.0)
