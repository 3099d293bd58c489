"""What goes wrong with the emulated rig, its sensors and its device, and when: data, for runs that repeat."""

from collections.abc import Iterable
from enum import IntEnum
from typing import Annotated, NamedTuple

from simulator.rig import MOST_PINS, BackupBearing, BearingKind, Model, Pin
from simulator.unbalance import with_unbalance
from simulator.validation import NAME, Quantity, RigError, written


class FaultKind(IntEnum):
    """What goes wrong: first sensors' faults, which need a channel, then the rig's, then the device's."""

    GAIN = 0
    DRIFT = 1
    RUNOUT = 2
    NOISE = 3
    SKEW = 4
    STUCK = 5
    OPEN = 6
    MAGNET_LOST = 7
    UNBALANCE_STEP = 8
    WORN_PIN = 9
    CLEARANCE_CHANGED = 10
    DROPPED = 11
    REPEATED = 12
    LATE = 13
    UNPLUGGED = 14
    CLOCK_DRIFT = 15


class Fault(NamedTuple):
    """A row `[[emulator.fault]]`: from a moment on, for a while or to the end of the run."""

    kind: FaultKind
    at: Annotated[float, Quantity("s", 0.0, 1e7, "when it begins, from the first sample on")]
    size: Annotated[float | None, Quantity("1", -1e9, 1e9, "how large it is")] = None
    channel: NAME = ""
    angle_deg: Annotated[
        float, Quantity("deg", -360.0, 360.0, "of the unbalance added, or of the runout's largest reading")
    ] = 0.0
    pin: Annotated[int, Quantity("1", 1, MOST_PINS, "number of the worn pin")] = 1
    duration: Annotated[
        float | None, Quantity("s", 1e-6, 1e7, "how long it lasts; to the end of the run without one")
    ] = None
    name: NAME = "fault"


class Span(NamedTuple):
    """A fault with its samples: from `begin` on, up to and without `end`."""

    begin: int
    end: int
    fault: Fault

    def acts(self, sample: int) -> bool:
        """Tell whether the fault acts at a sample."""
        return self.begin <= sample < self.end


SIZES = {
    FaultKind.GAIN: "the factor on what the sensor measures",
    FaultKind.DRIFT: "the channel's SI unit a second",
    FaultKind.RUNOUT: "the amplitude, once a turn, in the channel's SI unit",
    FaultKind.NOISE: "rms of the noise that is added, in the channel's SI unit",
    FaultKind.SKEW: "whole samples by which the channel lags",
    FaultKind.UNBALANCE_STEP: "kg m",
    FaultKind.WORN_PIN: "m by which the pin's gap grows",
    FaultKind.CLEARANCE_CHANGED: "m by which the clearance grows",
    FaultKind.DROPPED: "whole samples that are never delivered",
    FaultKind.REPEATED: "whole samples that are delivered twice",
    FaultKind.LATE: "s during which nothing is delivered",
    FaultKind.CLOCK_DRIFT: "parts per million by which the device's clock runs fast",
}
"""What `size` means; the other kinds have none."""

MOST_SAMPLES = 1_000_000
MOST_KEPT = 10_000
"""Samples of the past that are kept at most: with ten times as many the emulator falls behind real time."""
MOST_DRIFT = 100_000.0  # ppm
KEPT = (FaultKind.SKEW, FaultKind.REPEATED)
"""Kinds for which as many samples of the past are kept as their size says."""
IN_SAMPLES = (*KEPT, FaultKind.DROPPED)
POSITIVE = (FaultKind.NOISE, FaultKind.RUNOUT, FaultKind.LATE)
ONCE = (FaultKind.DROPPED, FaultKind.REPEATED, FaultKind.LATE, FaultKind.UNPLUGGED)
"""Kinds without a duration: their size says how long they last, or nothing follows."""
NEVER = 2**62  # sample at which a fault without a duration ends


def of_sensor(fault: Fault) -> bool:
    """Tell whether a fault is a sensor's."""
    return fault.kind <= FaultKind.OPEN


def of_rig(fault: Fault) -> bool:
    """Tell whether a fault is the rig's own."""
    return FaultKind.OPEN < fault.kind < FaultKind.DROPPED


def of_device(fault: Fault) -> bool:
    """Tell whether a fault is that of the device that reads the sensors."""
    return fault.kind >= FaultKind.DROPPED


def check_fault(fault: Fault) -> None:
    """Refuse a fault without what its kind needs, or with what it has no use for. Raises `RigError`."""
    place = f'[[emulator.fault]] kind = "{written(FaultKind(fault.kind))}"'
    if of_sensor(fault) != bool(fault.channel):
        raise RigError(f"{place} {'needs a' if of_sensor(fault) else 'has no'} channel")
    if fault.kind in SIZES and fault.size is None:
        raise RigError(f"{place} needs size: {SIZES[FaultKind(fault.kind)]}")
    if fault.kind not in SIZES and fault.size is not None:
        raise RigError(f"{place} has no size; leave it out")
    if fault.kind in ONCE and fault.duration is not None:
        raise RigError(f"{place} has no duration; leave it out")
    check_size(fault, place)


def check_size(fault: Fault, place: str) -> None:
    """Refuse a size that a fault of its kind cannot have. Raises `RigError`."""
    size = fault.size or 0.0
    most = MOST_KEPT if fault.kind in KEPT else MOST_SAMPLES
    if fault.kind in IN_SAMPLES and not (0.0 <= size <= most and size == int(size)):
        raise RigError(f"{place} size = {size:g} must be a whole number of samples from 0 to {most}")
    if fault.kind == FaultKind.CLOCK_DRIFT and abs(size) > MOST_DRIFT:
        raise RigError(f"{place} size = {size:g} must be from -{MOST_DRIFT:g} to {MOST_DRIFT:g} ppm")
    if fault.kind in POSITIVE and size < 0.0:
        raise RigError(f"{place} size = {size:g} must not be negative")


def schedule(faults: Iterable[Fault], rate: float) -> list[Span]:
    """Return the faults in the order in which they begin; of equal samples in theirs. Raises `RigError`.

    `rate` is samples a second.
    """
    return sorted((span_of(fault, rate) for fault in faults), key=lambda span: span.begin)


def span_of(fault: Fault, rate: float) -> Span:
    """Return a fault with its samples. Raises `RigError` when it has none."""
    begin = round(fault.at * rate)
    end = NEVER if fault.duration is None else round((fault.at + fault.duration) * rate)
    if end <= begin:
        raise RigError(
            f'[[emulator.fault]] kind = "{written(FaultKind(fault.kind))}" duration = {fault.duration:g} s '
            f"is over within a sample, which takes {1.0 / rate:g} s; give more"
        )
    return Span(begin, end, fault)


def edges(spans: Iterable[Span]) -> list[int]:
    """Return the samples at which a fault begins or ends, in order, each once."""
    return sorted({sample for span in spans for sample in (span.begin, span.end) if sample < NEVER})


def damaged_at(model: Model, spans: Iterable[Span], sample: int) -> Model:
    """Return the model with what acts on it at a sample. Raises `RigError` when it cannot have it."""
    for span in spans:
        if span.acts(sample):
            model = damaged(model, span.fault)
    return model


def damaged(model: Model, fault: Fault) -> Model:
    """Return the model after one of the rig's faults. Raises `RigError` when it cannot have it."""
    bearing = model.backup_bearing
    size = fault.size or 0.0
    if fault.kind == FaultKind.MAGNET_LOST:
        return model._replace(magnetic_bearing=model.magnetic_bearing._replace(stiffness=0.0, damping=0.0))
    if fault.kind == FaultKind.UNBALANCE_STEP:
        return model._replace(rotor=with_unbalance(model.rotor, size, fault.angle_deg))
    if fault.kind == FaultKind.WORN_PIN:
        return model._replace(backup_bearing=worn(model, fault.pin, size))
    clearance = bearing.clearance + size
    if clearance <= 0.0:
        raise RigError(
            f"[[emulator.fault]] size = {size:g} m leaves a clearance of {clearance:g} m; it must be above 0"
        )
    return model._replace(backup_bearing=bearing._replace(clearance=clearance))


def worn(model: Model, pin: int, size: float) -> BackupBearing:
    """Return the backup bearing with one pin worn by `size` (m) more."""
    bearing = model.backup_bearing
    if bearing.kind != BearingKind.PINNED or pin > bearing.pin_count:
        raise RigError(
            f'[[emulator.fault]] pin = {pin} is no pin of the bearing: "worn-pin" needs a pinned one'
        )
    old = next((each for each in bearing.pins if each.number == pin), Pin(number=pin))
    others = [each for each in bearing.pins if each.number != pin]
    return bearing._replace(pins=(*others, old._replace(wear=old.wear + size)))
