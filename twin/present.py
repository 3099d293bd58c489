"""Where a run stands: the newest estimate and the plan's next speed, of a running rig or in a recording."""

import time
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from daq import keys
from daq.commanding.plan import PlanError, SpeedStep, load_plan
from daq.link import Inbox, Link
from daq.messages import Series, decode_series
from daq.messages_pb2 import Event, TwinSummary
from daq.recording import Recording
from daq.rig import Rig, rig_from_text
from twin.estimate import EstimateStatus
from twin.resume import rows_of, values_at

PATIENCE = 5.0  # s for the twin to publish an estimate that it vouches for
HISTORY = 1024  # events of the operator, at most
LULL = 0.2  # s without a further event after which all have come
UNSURE = EstimateStatus.SETTLING | EstimateStatus.LOST


class PresentError(RuntimeError):
    """There is no estimate to go on from; the message says why."""


class Present(NamedTuple):
    """A run at one moment."""

    rig: Rig
    sample: int  # index that the values are of
    values: dict[str, float]  # of the estimate by row name, and of the parameters found, with deviations
    next_step: SpeedStep | None  # of the plan; None without one, or when it is not known here


def of_running(rig: Rig) -> Present:
    """Return where a running rig stands; `rig` has the ports of its processes.

    Raises:
        PresentError: its twin gives no estimate, or none that it vouches for.
        LinkError: the link cannot be opened.
    """
    estimates, summaries = Inbox(1, "drop_oldest"), Inbox(1, "drop_oldest")
    events = Inbox(HISTORY, "drop_oldest")
    with Link(connect=[rig.link.endpoint(name) for name in ("twin", "operator")]) as link:
        link.subscribe(keys.event(rig.name, "operator"), events, recover=True)
        link.subscribe(keys.twin_summary(rig.name), summaries)
        link.subscribe(keys.estimate(rig.name), estimates)
        estimate = next_estimate(rig, estimates)
        summary = summaries.get(PATIENCE)
        told = []
        while (event := events.get(LULL)) is not None:
            told.append(Event.FromString(event[1]))
    values = values_at(estimate) | parameters_of(summary[1] if summary else b"")
    return Present(rig, last_sample(estimate), values, next_speed(rig, told))


def next_estimate(rig: Rig, estimates: Inbox) -> Series:
    """Return the next estimate that the twin vouches for. Raises `PresentError`."""
    deadline, said = time.monotonic() + PATIENCE, "says nothing: does it run?"
    while (left := deadline - time.monotonic()) > 0.0:
        message = estimates.get(left)
        if message is not None:
            estimate = decode_series(message[1])
            if not estimate.status & UNSURE:
                return estimate
            said = "does not vouch for its estimate now: try again"
    raise PresentError(f"the twin of {rig.name} {said}")


def of_recording(path: Path, at: float) -> Present:
    """Return where a recorded run stood `at` seconds after its start.

    Raises:
        RecordingError: the file is no recording, or cannot be read.
        PresentError: it holds no estimate there that the twin vouched for.
    """
    with Recording(path) as recording:
        rig = rig_from_text(recording.rig_toml, f"rig description in {path}")
        sample = round(at * rig.acquisition.rate)
        estimate = estimate_of(recording, keys.estimate(rig.name), sample)
        if estimate is None:
            raise PresentError(
                f"{path} holds no estimate at {at:g} s that the twin vouched for: take another time, or let "
                "`rigtwin twin` estimate anew"
            )
        told = (event for event in recording.events() if event.sample <= sample)
        column = (sample - estimate.first_sample) // estimate.stride
        return Present(
            rig,
            estimate.first_sample + column * estimate.stride,
            values_at(estimate, column) | parameters_of(summary_of(recording, rig, sample)),
            next_speed(rig, told),
        )


def estimate_of(recording: Recording, key: str, sample: int) -> Series | None:
    """Return the sound estimate that holds a sample."""
    longest = round(recording.description.rate)  # a block is shorter than a second
    for message in recording.messages_between(key, first=max(0, sample - longest), last=sample):
        estimate = decode_series(message.payload)
        if estimate.first_sample <= sample <= last_sample(estimate) + estimate.stride - 1:
            return None if estimate.status & UNSURE else estimate
    return None


def summary_of(recording: Recording, rig: Rig, sample: int) -> bytes:
    """Return the twin's newest summary at a sample; nothing where there is none."""
    newest = b""
    longest = round(recording.description.rate)
    for message in recording.messages_between(
        keys.twin_summary(rig.name), first=max(0, sample - longest), last=sample
    ):
        newest = message.payload
    return newest


def parameters_of(summary: bytes) -> dict[str, float]:
    """Return the parameters of a twin's summary with their deviations; none where it does not say."""
    return rows_of(TwinSummary.FromString(summary).parameters)


def last_sample(estimate: Series) -> int:
    """Return the index of an estimate's last column."""
    return estimate.first_sample + (estimate.samples.shape[1] - 1) * estimate.stride


def next_speed(rig: Rig, events: Iterable[Event]) -> SpeedStep | None:
    """Return the next step of the plan being performed that changes the speed, by the events so far."""
    name, begun = "", 0
    for event in events:
        if event.kind in ("plan_start", "plan_end"):
            name, begun = event.details["plan"] if event.kind == "plan_start" else "", 0
        elif event.kind == "step":
            begun = int(event.details["step"])
    if not name:
        return None
    try:
        steps = load_plan(name, rig).steps[begun:]
    except PlanError:  # performed from a file that is not here
        return None
    return next((step for step in steps if isinstance(step, SpeedStep)), None)
