"""Whether sensors are OK, on every sample: out of their range, stuck, or a safety contact that is open.

Pure functions of samples and state, as `daq.protection`, which decides what follows.
"""

from collections.abc import Iterable, Sequence
from math import inf
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.rig.channels import Channel

RANGE_PERSISTENCE = 0.010
"""s: how long a sensor is outside its range before it counts as not OK."""
CONTACT_PERSISTENCE = 0.002
"""s: how long a safety contact is open before it counts; shorter is its bouncing."""
CONTACT_CLOSED = 0.5
"""A safety contact is closed, and all is well, from this value on."""
CONTACT = "contact"
"""The quantity of a safety contact, as that of an emergency stop: closed when all is well."""

Counts = NDArray[np.int64]


class SensorGuard(NamedTuple):
    """When each channel's sensor is OK; one entry for each channel."""

    names: tuple[str, ...]
    contacts: tuple[bool, ...]
    trips: tuple[bool, ...]  # by itself; others only warn
    lowest: NDArray[np.float32]  # (n_channels, 1): least value of a sensor that is OK
    highest: NDArray[np.float32]
    persistence: Counts  # samples outside that range before it counts
    watched: list[int]  # rows whose sensors are stuck when nothing changes
    stuck_after: Counts  # samples without a change, for each watched row


class SensorState(NamedTuple):
    """What is remembered of the sensors from read to read."""

    outside: Counts  # (n_channels,): consecutive samples outside the range so far
    unchanged: Counts  # (n_watched,): consecutive samples equal to the one before
    last: NDArray[np.float32]  # (n_watched,): newest value; not a number before the first


class SensorFault(NamedTuple):
    """A sensor that has become not OK: its row, when, and why."""

    row: int
    column: int
    text: str


class SensorVerdict(NamedTuple):
    """State after a read, what was found, whether all are in range now, and which samples count as not OK."""

    state: SensorState
    faults: list[SensorFault]
    in_range: bool
    bad: NDArray[np.bool_] | None  # (n_channels, n), after the persistence; None when there is none


def sensor_guard(channels: Sequence[Channel], rate: float, trips: Iterable[int]) -> SensorGuard:
    """Return the guard of a channel table; `trips` are the rows on which a limit rests."""
    alone = set(trips)
    contacts = tuple(channel.quantity == CONTACT for channel in channels)
    bounds = np.array([ok_bounds(channel) for channel in channels], dtype=np.float32).reshape(-1, 2)
    times = [CONTACT_PERSISTENCE if contact else RANGE_PERSISTENCE for contact in contacts]
    stuck = {row: channel.stuck for row, channel in enumerate(channels) if channel.stuck}
    return SensorGuard(
        tuple(channel.name for channel in channels),
        contacts,
        tuple(contact or row in alone for row, contact in enumerate(contacts)),
        np.ascontiguousarray(bounds[:, :1]),
        np.ascontiguousarray(bounds[:, 1:]),
        np.array([samples_of(time, rate) for time in times], np.int64),
        list(stuck),
        np.array([samples_of(time, rate) for time in stuck.values()], np.int64),
    )


def initial_sensors(guard: SensorGuard) -> SensorState:
    """Return the state before the first sample."""
    watched = len(guard.watched)
    return SensorState(
        np.zeros(len(guard.names), np.int64),
        np.zeros(watched, np.int64),
        np.full(watched, np.nan, np.float32),
    )


def check_sensors(samples: NDArray[np.float32], before: SensorState, guard: SensorGuard) -> SensorVerdict:
    """Check one read, shape (n_channels, n), n at least 1, in the channels' units."""
    faults: list[SensorFault] = []
    ok = (samples >= guard.lowest) & (samples <= guard.highest)
    in_range = bool(ok.all())
    bad = None
    if in_range:
        outside = np.zeros_like(before.outside)
    else:
        counts = run_lengths(~ok, before.outside)
        outside = counts[:, -1]
        bad = counts >= guard.persistence[:, np.newaxis]
        faults += [
            SensorFault(row, column, out_of_range(guard, row, float(samples[row, column])))
            for row, column in begun(bad, before.outside >= guard.persistence)
        ]
    if not guard.watched:
        return SensorVerdict(before._replace(outside=outside), faults, in_range, bad)
    unchanged, stuck = check_stuck(samples[guard.watched], before, guard)
    if stuck is not None:
        bad = np.zeros(samples.shape, np.bool_) if bad is None else bad
        bad[guard.watched] |= stuck
        faults += [
            SensorFault(guard.watched[index], column, frozen(guard, index, float(samples[row, column])))
            for index, column in begun(stuck, before.unchanged >= guard.stuck_after)
            for row in [guard.watched[index]]
        ]
    state = SensorState(outside, unchanged, samples[guard.watched, -1])
    return SensorVerdict(state, faults, in_range, bad)


def check_stuck(
    samples: NDArray[np.float32], before: SensorState, guard: SensorGuard
) -> tuple[Counts, NDArray[np.bool_] | None]:
    """Return for how long each watched sensor has not changed, and on which samples for too long."""
    same = np.empty(samples.shape, np.bool_)
    np.equal(samples[:, 0], before.last, out=same[:, 0])
    np.equal(samples[:, 1:], samples[:, :-1], out=same[:, 1:])
    counts = run_lengths(same, before.unchanged)
    stuck = counts >= guard.stuck_after[:, np.newaxis]
    return counts[:, -1], stuck if stuck.any() else None


def not_ok(state: SensorState, guard: SensorGuard) -> list[int]:
    """Return the rows whose sensors were outside their range at the last sample, or are stuck."""
    stuck = state.unchanged >= guard.stuck_after
    return sorted(
        {*np.flatnonzero(state.outside).tolist(), *(guard.watched[i] for i in np.flatnonzero(stuck))}
    )


def run_lengths(flags: NDArray[np.bool_], before: Any) -> Counts:
    """Return at each sample how many true flags in a row end there.

    `flags` has the shape (..., n), `before` (...): the length of the run that ended before the first.
    """
    positions = np.arange(1, flags.shape[-1] + 1)
    newest_false = np.maximum.accumulate(np.where(flags, 0, positions), axis=-1)
    went_before = np.where(newest_false == 0, np.asarray(before)[..., np.newaxis], 0)
    counts: Counts = positions - newest_false + went_before
    return counts


def begun(bad: NDArray[np.bool_], already: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return row and first column of each row that has become true and was not at the last sample before."""
    rows = np.flatnonzero(bad.any(axis=1) & ~already)
    return [(int(row), int(bad[row].argmax())) for row in rows]


def out_of_range(guard: SensorGuard, row: int, value: float) -> str:
    """Say what is wrong with a sensor outside its range, or with an open contact."""
    if guard.contacts[row]:
        return f"the safety contact {guard.names[row]} is open"
    return f"the sensor of {guard.names[row]} is not OK: its value {value:g} is outside the OK range"


def frozen(guard: SensorGuard, index: int, value: float) -> str:
    """Say that a sensor is stuck."""
    name = guard.names[guard.watched[index]]
    return f"the sensor of {name} is not OK: its value {value:g} has not changed for too long"


def ok_bounds(channel: Channel) -> tuple[float, float]:
    """Return the least and largest value of a channel whose sensor is OK, in the channel's unit."""
    if channel.quantity == CONTACT:
        return CONTACT_CLOSED, inf
    if channel.ok is None:
        return -inf, inf
    ends = [(volts - channel.offset) / channel.sensitivity for volts in channel.ok]
    return min(ends), max(ends)


def samples_of(seconds: float, rate: float) -> int:
    """Return a duration in samples, at least one."""
    return max(1, round(seconds * rate))
