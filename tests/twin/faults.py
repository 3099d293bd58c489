"""Faulted and sound runs of the emulated rig, drawn by seed, and what the health watch makes of them.

The rig differs from what the twin is told as in case *mm* of `tests.twin.cases`: contact, coupling and
unbalance are off, and noise, speed, onset and size of the fault are drawn.
"""

from collections.abc import Callable, Iterable, Iterator
from math import tau
from typing import NamedTuple

import numpy as np

from daq.backend import SpeedOutput
from daq.backends.emulator import Emulator
from daq.messages import Series
from daq.rig import Rig, with_overrides
from tests.twin.cases import hidden_rig
from tests.twin.emulated import series_of
from twin.fault import Fault
from twin.health import Health
from twin.observer import Observer
from twin.trust import Trust
from twin.walls import depths

FREE = 15.5, 20.0  # Hz, above the resonance
BOUNCING = {"thesis-ball": (12.7, 13.3), "thesis-plain": (10.8, 11.3), "thesis-pinned": (11.7, 12.3)}  # Hz
BEARINGS = tuple(BOUNCING)
PINNED = ("thesis-pinned",)
SETTLED = 5.0  # s until the rotor bounces as it goes on to
WITHIN = 2.0  # s in which a fault must be named
PROBES = "proximity_x", "proximity_y"
TRANSDUCERS = "force_top", "force_bottom", "force_left", "force_right"

Draw = np.random.Generator


class Kind(NamedTuple):
    """A kind of fault, where it shows, and what must be said of it."""

    kind: str  # in the rig file
    named: str  # by the twin
    size: Callable[[Draw], float] | None = None
    channels: tuple[str, ...] = ()
    free: bool = True  # it shows in steady contact-free running; else where the rotor bounces
    bearings: tuple[str, ...] = BEARINGS


def either(low: float, high: float) -> Callable[[Draw], float]:
    """Return how a size between two magnitudes is drawn, of either sign."""
    return lambda draw: draw.choice((-1.0, 1.0)) * draw.uniform(low, high)


def between(low: float, high: float) -> Callable[[Draw], float]:
    """Return how a size between two bounds is drawn."""
    return lambda draw: draw.uniform(low, high)


KINDS = {
    "probe's gain": Kind("gain", "gain", lambda draw: 1.0 + either(0.03, 0.1)(draw), PROBES),
    "probe's drift": Kind("drift", "drift", either(5e-6, 20e-6), PROBES),
    "probe's runout": Kind("runout", "runout", between(4e-6, 15e-6), PROBES),
    "probe's skew": Kind("skew", "skew", lambda draw: 1.0, PROBES),
    "probe's noise": Kind("noise", "noise", between(4e-6, 15e-6), PROBES),
    "lost channel": Kind("open", "lost", None, PROBES + TRANSDUCERS),
    "stuck channel": Kind("stuck", "stuck", None, PROBES + TRANSDUCERS),
    "transducer's drift": Kind("drift", "drift", either(1.0, 4.0), TRANSDUCERS),
    "loose transducer": Kind("gain", "gain", between(0.3, 0.8), TRANSDUCERS, free=False),
    "transducer's skew": Kind("skew", "skew", lambda draw: 1.0, TRANSDUCERS, free=False),
    "added unbalance": Kind("unbalance-step", "unbalance", between(2e-6, 1e-5)),
    "lost magnet": Kind("magnet-lost", "magnet"),
    "changed clearance": Kind("clearance-changed", "clearance", between(5e-5, 1.5e-4), free=False),
    "worn pin": Kind("worn-pin", "pin", between(5e-5, 1.5e-4), free=False, bearings=PINNED),
}
"""Sizes as in a rig file: m or N (drift: a second), kg m, samples of skew, factors of gain."""


class Case(NamedTuple):
    """A drawn run: the fault, if it has one, and the speed at which it must show."""

    rig: Rig
    hz: float
    begin: float  # s of the fault
    named: str  # kind that must be said
    channel: str
    pin: int  # number of the worn pin, or 0
    free: bool


def drawn(label: str, seed: int) -> Case:
    """Return a run with a fault of `KINDS`."""
    kind, draw = KINDS[label], np.random.default_rng([seed, list(KINDS).index(label)])
    bearing = str(draw.choice(kind.bearings))
    begin = draw.uniform(6.5, 7.5)
    keys = {"at": begin, "angle_deg": draw.uniform(-180.0, 180.0)}
    if kind.size:
        keys["size"] = kind.size(draw)
    channel = str(draw.choice(kind.channels)) if kind.channels else ""
    rig = hidden_rig(bearing, "mm", seed)
    hz = draw.uniform(*(FREE if kind.free else BOUNCING[bearing]))
    while touches(rig, hz, kind.free) == kind.free:  # above the resonance it may go on bouncing as well
        hz = draw.uniform(*(FREE if kind.free else BOUNCING[bearing]))
    pin = int(draw.choice(pins_hit(rig, hz))) if kind.bearings == PINNED else 0
    said = [f'name="it",kind="{kind.kind}"', *(f"{key}={value}" for key, value in keys.items())]
    said += [f'channel="{channel}"'] * bool(channel) + [f"pin={pin}"] * bool(pin)
    rig = with_overrides(rig, [f"emulator.fault=[{{{','.join(said)}}}]"])
    return Case(rig, hz, begin, kind.named, channel, pin, kind.free)


def touches(rig: Rig, hz: float, free: bool) -> bool:
    """Tell whether the rotor touches the bearing at a speed, before any fault."""
    force = Emulator.truth_names.index("normal_force")
    return any(truth[force].any() for truth in before_fault(rig, hz, free))


def pins_hit(rig: Rig, hz: float) -> list[int]:
    """Return the numbers of the pins that the rotor hits, bouncing at a speed, before any fault."""
    assert rig.model is not None
    station, hit = rig.model.rotor.bearing_station, set()
    for truth in before_fault(rig, hz, False):
        depth = [reach(*(station * truth[:2])).max() for reach in depths(rig.model)]
        hit |= {number for number, each in enumerate(depth, 1) if each > 0.0}
    return sorted(hit)


def before_fault(rig: Rig, hz: float, free: bool) -> Iterator[np.ndarray]:
    """Yield the true state in the second in which the rotor has come to what it goes on doing at a speed."""
    for block, truth in blocks(rig, hz, free, SETTLED + 1.0):
        if block.first_sample > SETTLED * block.rate:
            yield truth


def blocks(rig: Rig, hz: float, free: bool, seconds: float) -> Iterator[tuple[Series, np.ndarray]]:
    """Yield blocks and true state of a run: quickly to 8 Hz, then to a speed, slowly if it is to bounce."""
    device, rate, size = Emulator(paced=False), rig.acquisition.rate, rig.acquisition.block
    ramp = rig.command.default_ramp_hz_per_s if free else 1.5
    device.open(rig)
    device.start()
    device.write(SpeedOutput(8.0 * tau, 20.0 * tau))
    for number in range(round(seconds * rate / size)):
        if number == round(0.5 * rate / size):
            device.write(SpeedOutput(hz * tau, ramp * tau))
        values = np.empty((len(rig.channels), size))
        reading = device.read(values)
        rig.channels.calibrate(values, values)
        yield series_of(rig, reading.first_sample, values), device.truth()


def found(case: Case) -> list[Fault]:
    """Return the faults that the health watch names in a run until they must have been, in their order."""
    return [fault for _, fault in told(case)]


def told(case: Case) -> Iterator[tuple[float, Fault]]:
    """Yield each such fault with the time (s) at which it was named."""
    return named(case.rig, blocks(case.rig, case.hz, case.free, case.begin + WITHIN))


def named(rig: Rig, run: Iterable[tuple[Series, np.ndarray]]) -> Iterator[tuple[float, Fault]]:
    """Yield each fault that is named in a run of blocks with their truth, and when (s), as the twin does."""
    observer = Observer(rig)
    health, trust = Health(rig, observer.tuning), Trust(observer)
    for block, _ in run:
        estimated = observer.update(block)
        faults = health.add(block, estimated)
        for change in trust.add(block, estimated, faults):
            health.believe(change.channel, not change.left_out)
        for fault in faults:
            yield (block.first_sample + block.samples.shape[1]) / block.rate, fault


def is_right(case: Case, faults: list[Fault]) -> bool:
    """Tell whether what was named is what was drawn, and nothing else."""
    return [(fault.kind, fault.channel, fault.pin) for fault in faults] == [
        (case.named, case.channel, case.pin)
    ]
