"""Many rigs that differ in some numbers, run through the same speeds side by side on all cores.

Each rig is stepped by the very kernel that `Simulation` uses, one rig after another on each of some
threads; the kernel releases the interpreter's lock, so that threads run at once. Only outcomes are kept: for
each rig its model, and for each leg 32 bytes and 16 for each point of its Poincare section; a thread takes
0.7 MB beside.
"""

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from math import floor, tau
from os import cpu_count
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simulator.compile import kernel
from simulator.rig import Model, RigError
from simulator.simulation import Simulation, SimulationError, positive
from simulator.state import SIGNALS

CHUNK = 5000  # samples in a thread's buffer: calls cost a twentieth of the time then
LARGEST_RADIUS, LARGEST_FORCE, IN_CONTACT, LAST_CONTACT = range(4)
OUTCOMES = 4

Values = NDArray[np.float64]


class Leg(NamedTuple):
    """A part of every rig's run: go to a speed, and stay there until the time is over.

    `speed` (rad/s), one for all rigs or one for each (n_rigs,); `ramp` (rad/s2); `duration` (s) with the
    ramp; `watched` (s), the last part of it that the outcomes are of, or all.
    """

    speed: ArrayLike
    ramp: float
    duration: float
    watched: float | None = None


class Swept(NamedTuple):
    """What came out, one row for each leg and one column for each rig; NaN from where a rig diverged."""

    largest_radius: Values  # (n_legs, n_rigs) m, of the shaft's centre at the bearing's plane
    largest_force: Values  # (n_legs, n_rigs) N, of the contact's normal force
    contact_share: Values  # (n_legs, n_rigs) of the samples
    last_contact: Values  # (n_legs, n_rigs) s from the leg's begin; 0 without contact
    section: Values  # (n_legs, n_rigs, n_points, 2) m: the centre's place at each turn's begin, the last ones
    failures: dict[int, str]  # why a rig diverged, by its number


def sweep(
    model: Model,
    changes: Mapping[str, ArrayLike],
    legs: Sequence[Leg],
    *,
    rate: float = 25000.0,
    points: int = 0,
    workers: int | None = None,
) -> Swept:
    """Run rigs through `legs`, each from rest, and return what came out.

    Args:
        model: what all rigs have in common.
        changes: values (n_rigs,) of numbers by table and key, as `rotor.unbalance`; a single one is for all.
        legs: the run.
        rate: samples a second.
        points: of the Poincare section, at most, of each leg.
        workers: threads; all cores without.

    Raises:
        RigError: a key is unknown, or a rig cannot be simulated; it names the rig's number.
        ValueError: the numbers of values differ, or a leg is not possible.
    """
    models = varied(model, changes, legs)
    speeds = np.array([np.broadcast_to(leg.speed, len(models)) for leg in legs], dtype=np.float64)
    for leg in legs:
        positive(leg.duration, "duration", "s")
    outcomes = np.full((len(legs), len(models), OUTCOMES), np.nan)
    section = np.full((len(legs), len(models), points, 2), np.nan)
    failures: dict[int, str] = {}
    refused: list[RigError] = []

    numbers = iter(range(len(models)))

    def perform(_thread: int) -> None:
        memory = np.empty(len(SIGNALS) * CHUNK)
        for number in numbers:  # each takes the next that no other has taken, so that all end at once
            if refused:
                return
            try:
                # Made here, because other threads step their rigs meanwhile: making one takes the lock.
                rig = made(models[number], number, rate)
                through_legs(rig, legs, speeds[:, number], outcomes[:, number], section[:, number], memory)
            except SimulationError as error:
                failures[number] = str(error)
            except RigError as error:
                refused.append(error)

    threads = max(1, min(workers or cpu_count() or 1, len(models)))
    with ThreadPoolExecutor(threads) as pool:
        for _ in pool.map(perform, range(threads)):
            pass
    if refused:
        raise refused[0]
    return Swept(
        outcomes[..., LARGEST_RADIUS],
        outcomes[..., LARGEST_FORCE],
        outcomes[..., IN_CONTACT],
        outcomes[..., LAST_CONTACT],
        section,
        failures,
    )


def varied(model: Model, changes: Mapping[str, ArrayLike], legs: Sequence[Leg]) -> list[Model]:
    """Return one model for each rig. Raises `RigError` and `ValueError`."""
    sizes = [np.size(values) for values in (*changes.values(), *(leg.speed for leg in legs))]
    count = max(sizes, default=1)
    if any(size not in (1, count) for size in sizes):
        raise ValueError(f"changes and speeds have {sizes} values; each must have one, or one for each rig")
    models = [model] * count
    for key, values in changes.items():
        table, _, field = key.partition(".")
        if field not in getattr(getattr(model, table, None), "_fields", ()):
            raise RigError(f"{key} is no number of the model; write it as table.key, as rotor.unbalance")
        each = np.broadcast_to(values, count)
        models = [
            one._replace(**{table: getattr(one, table)._replace(**{field: value.item()})})
            for one, value in zip(models, each, strict=True)
        ]
    return models


def made(model: Model, number: int, rate: float) -> Simulation:
    """Return a rig at rest. Raises `RigError`."""
    try:
        return Simulation(model, rate)
    except RigError as error:
        raise RigError(f"rig {number}: {error}") from error


def through_legs(
    rig: Simulation, legs: Sequence[Leg], speeds: Values, outcomes: Values, section: Values, memory: Values
) -> None:
    """Run one rig through its legs; fill `outcomes` (n_legs, 4) and `section` (n_legs, n_points, 2).

    `memory` holds `CHUNK` samples of all signals.
    """
    station = rig.model.rotor.bearing_station
    for leg, speed, outcome, place in zip(legs, speeds, outcomes, section, strict=True):
        rig.set_speed(float(speed), leg.ramp)
        first, count = rig.sample, round(leg.duration * rig.rate)
        watched = count if leg.watched is None else min(count, round(leg.watched * rig.rate))
        found, turns = np.zeros(OUTCOMES), np.array([0.0, floor(rig.state[9] / tau)])
        while rig.sample < first + count:
            unwatched = first + count - watched - rig.sample
            size = min(CHUNK, unwatched if unwatched > 0 else first + count - rig.sample)
            signals = memory[: len(SIGNALS) * size].reshape(len(SIGNALS), size)
            begin = rig.sample - first
            rig.advance(signals)
            if unwatched > 0:
                turns[1] = floor(signals[9, -1] / tau)
            else:
                gather(signals, station, begin, found, turns, place)
        found[IN_CONTACT] /= max(watched, 1)
        found[LAST_CONTACT] /= rig.rate
        outcome[:] = found
        place[:] = np.roll(place, -int(turns[0]) if turns[0] > len(place) > 0 else 0, axis=0)


@kernel
def gather(
    signals: np.ndarray, station: float, first: int, found: np.ndarray, turns: np.ndarray, section: np.ndarray
) -> None:
    """Bring a leg's outcomes `found` (4,) and its `section` (n_points, 2) up to date by true signals (17, n).

    Column 0 is sample `first` of the leg. `turns` (2,) holds how many points there were and the number of
    the turn that the shaft is in; the points beyond the section's size replace the oldest.
    """
    for column in range(signals.shape[1]):
        x, y = station * signals[0, column], station * signals[1, column]
        found[LARGEST_RADIUS] = max(found[LARGEST_RADIUS], (x * x + y * y) ** 0.5)
        normal = signals[13, column]
        if normal > 0.0:
            found[LARGEST_FORCE] = max(found[LARGEST_FORCE], normal)
            found[IN_CONTACT] += 1.0
            found[LAST_CONTACT] = first + column + 1.0
        turn = floor(signals[9, column] / tau)
        if turn > turns[1]:
            if section.shape[0] > 0:
                place = int(turns[0]) % section.shape[0]
                # Back to where the turn began, at the present velocity: at most a tick.
                since = (signals[9, column] - turn * tau) / signals[10, column]
                section[place, 0] = x - since * station * signals[2, column]
                section[place, 1] = y - since * station * signals[3, column]
            turns[0] += 1.0
            turns[1] = turn
