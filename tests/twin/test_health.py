"""Faults of sensors and rig, injected into the emulated rig, are named; none is without a fault."""

from math import tau
from typing import NamedTuple

import numpy as np
import pytest

from daq.backend import SpeedOutput
from daq.backends.emulator import Emulator
from daq.commanding.plan import load_plan
from daq.rig import Rig, load_rig
from tests.twin.emulated import emulate, series_of
from twin.fault import Fault
from twin.health import Health
from twin.observer import Observer

FREE, BOUNCING = 20.0, {"thesis-ball": 13.0, "thesis-plain": 11.0, "thesis-pinned": 12.0}  # Hz
WITHIN = 2.0  # s in which a fault must be named


class Case(NamedTuple):
    """A fault, where it shows, and what must be said of it."""

    toml: str
    kind: str
    channel: str = ""
    free: bool = True


CASES = {
    "gain of a probe": Case('kind="gain",channel="proximity_y",size=0.93', "gain", "proximity_y"),
    "gain of the other": Case('kind="gain",channel="proximity_x",size=1.05', "gain", "proximity_x"),
    "drift of a probe": Case('kind="drift",channel="proximity_x",size=1e-5', "drift", "proximity_x"),
    "runout": Case('kind="runout",channel="proximity_y",size=6e-6,angle_deg=40.0', "runout", "proximity_y"),
    "skew of a probe": Case('kind="skew",channel="proximity_x",size=1.0', "skew", "proximity_x"),
    "lost probe": Case('kind="open",channel="proximity_x"', "lost", "proximity_x"),
    "stuck transducer": Case('kind="stuck",channel="force_left"', "stuck", "force_left"),
    "noisy probe": Case('kind="noise",channel="proximity_y",size=1e-5', "noise", "proximity_y"),
    "drift of a transducer": Case('kind="drift",channel="force_top",size=2.0', "drift", "force_top"),
    "unbalance": Case('kind="unbalance-step",size=3e-6,angle_deg=100.0', "unbalance"),
    "lost magnet": Case('kind="magnet-lost"', "magnet"),
    "loose transducer": Case('kind="gain",channel="force_top",size=0.6', "gain", "force_top", free=False),
    "skew of a transducer": Case(
        'kind="skew",channel="force_bottom",size=1.0', "skew", "force_bottom", free=False
    ),
    "clearance": Case('kind="clearance-changed",size=7e-5', "clearance", free=False),
}
QUICK = ("gain of a probe", "runout", "lost probe", "unbalance", "loose transducer", "clearance")


def found(
    name: str, case: Case | None, seed: int, free: bool = True
) -> tuple[float, list[tuple[float, Fault]]]:
    """Return when the fault began, and what was found when (s)."""
    draw = np.random.default_rng(seed)
    begin = 6.5 + draw.uniform(0.0, 1.0)
    settings = [f"emulator.seed={seed}", f"emulator.actual.rotor.unbalance_angle={draw.uniform(-3.0, 3.0)}"]
    if case:
        settings.append(f'emulator.fault=[{{name="it",at={begin},{case.toml}}}]')
    rig = load_rig(name, settings)
    hz, ramp = (FREE, rig.command.default_ramp_hz_per_s) if free else (BOUNCING[name], 1.5)
    return begin, watched(rig, hz, ramp, begin + WITHIN)


def watched(rig: Rig, hz: float, ramp: float, seconds: float) -> list[tuple[float, Fault]]:
    """Run up quickly to 8 Hz and then to a speed; return what the health watch found, with its time (s)."""
    device, observer = Emulator(paced=False), Observer(rig)
    health, rate, size = Health(rig, observer.tuning), rig.acquisition.rate, rig.acquisition.block
    device.open(rig)
    device.start()
    device.write(SpeedOutput(8.0 * tau, 20.0 * tau))
    faults = []
    for number in range(round(seconds * rate / size)):
        if number == round(0.5 * rate / size):
            device.write(SpeedOutput(hz * tau, ramp * tau))
        values = np.empty((len(rig.channels), size))
        reading = device.read(values)
        rig.channels.calibrate(values, values)
        block = series_of(rig, reading.first_sample, values)
        now = (reading.first_sample + size) / rate
        faults += [(now, fault) for fault in health.add(block, observer.update(block))]
    return faults


def check(name: str, label: str, seed: int) -> None:
    """Check that one fault, and no other, is named in time, and dated to within a second."""
    case = CASES[label]
    begin, faults = found(name, case, seed, case.free)
    assert faults, label
    _, first = faults[0]
    assert (first.kind, first.channel) == (case.kind, case.channel), (label, faults)
    assert first.onset / 25000.0 == pytest.approx(begin, abs=1.0)


@pytest.mark.parametrize("label", QUICK)
def test_a_fault_is_named(label):
    check("thesis-ball", label, 40)


def test_sizes_are_told():
    faults = {
        label: found("thesis-ball", CASES[label], 41)[1][0][1] for label in ("gain of a probe", "unbalance")
    }
    assert faults["gain of a probe"].size == pytest.approx(0.93, abs=0.002)
    # The magnet's stiffness is as described: the orbit is the unbalance's to 1 %.
    assert faults["unbalance"].size == pytest.approx(3e-6, rel=0.05)
    assert str(faults["unbalance"]).startswith("the unbalance has changed by 3")


def test_a_worn_pin_is_told_from_a_larger_clearance():
    worn = [Case(f'kind="worn-pin",size=1e-4,pin={pin}', "pin") for pin in (3, 4)]
    for case in worn:
        _, faults = found("thesis-pinned", case, 42, free=False)
        assert {fault.kind for _, fault in faults} <= {"pin"}
    assert faults


def test_a_healthy_rig_has_no_fault():
    assert found("thesis-ball", None, 43)[1] == []
    assert found("thesis-pinned", None, 43, free=False)[1] == []


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(50, 53))
@pytest.mark.parametrize("name", ["thesis-ball", "thesis-plain", "thesis-pinned"])
def test_every_fault_is_named_on_every_bearing(name, seed):
    for label in CASES:
        check(name, label, seed)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["thesis-ball", "thesis-plain", "thesis-pinned"])
def test_the_default_plan_gives_no_alarm(name):
    rig = load_rig(name, ["emulator.actual.rotor.unbalance_angle=1.0"])
    run = emulate(rig, load_plan("resonance", rig))
    observer = Observer(rig)
    health = Health(rig, observer.tuning)
    assert [fault for block in run.blocks for fault in health.add(block, observer.update(block))] == []
