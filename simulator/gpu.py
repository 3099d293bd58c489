"""Many rigs side by side on a GPU, one thread each: `simulator.sweep` for thousands of them.

The kernels are those of the CPU, compiled a second time by numba-cuda (extra `gpu`). A thread reads its rig's
numbers as a record, whose fields have the names of those of `Model`. All is in double precision; a GPU's
fused multiplications round otherwise than the CPU, which impacts amplify.
"""

from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from typing import Any

import numba
import numpy as np
from numba import cuda
from numpy.typing import ArrayLike, NDArray

from simulator.candidates import for_kernels
from simulator.march import (
    DIVERGED,
    IN_CONTACT,
    LARGEST_FORCE,
    LARGEST_RADIUS,
    LAST_CONTACT,
    OUTCOMES,
    march,
)
from simulator.rig import Model
from simulator.simulation import SimulationError, positive
from simulator.sweep import Leg, Swept, made, varied

THREADS = 64  # of a block
CHUNK = 2500  # ticks of a launch, so that none lasts long enough for a display's watchdog

Values = NDArray[np.float64]


def available() -> bool:
    """Tell whether there is a GPU with numba-cuda, or numba's simulator of one (NUMBA_ENABLE_CUDASIM=1)."""
    settings: Any = numba.config
    return bool(settings.ENABLE_CUDASIM or (find_spec("numba_cuda") and cuda.is_available()))


@cuda.jit
def march_all(
    models: Any,
    ticks: Any,
    ramps: Any,
    first: int,
    begin: int,
    count: int,
    watched: int,
    states: Any,
    candidates: Any,
    found: Any,
) -> None:
    """Let each thread step its rig: see `march`; the arrays have one entry for each rig."""
    rig: int = cuda.grid(1)  # type: ignore[call-arg]
    if rig < states.shape[0]:
        march(
            models[rig],
            ticks[rig],
            ramps[rig],
            first,
            begin,
            count,
            watched,
            states[rig],
            candidates[rig],
            found[rig],
        )


def sweep_on_gpu(
    model: Model, changes: Mapping[str, ArrayLike], legs: Sequence[Leg], *, rate: float = 25000.0
) -> Swept:
    """Do as `simulator.sweep.sweep` on a GPU, without Poincare sections.

    Raises as it does, and `SimulationError` where there is no GPU.
    """
    if not available():
        raise SimulationError(
            "no GPU was found that numba-cuda can use: install rigtwin[gpu] beside NVIDIA's driver, "
            "or use simulator.sweep"
        )
    rigs = [made(one, number, rate) for number, one in enumerate(varied(model, changes, legs))]
    models = cuda.to_device(records([for_kernels(rig.model) for rig in rigs]))
    ticks = cuda.to_device(records([rig.tick for rig in rigs]))
    states = cuda.to_device(np.array([rig.state for rig in rigs]))
    candidates = cuda.to_device(np.array([rig.candidates for rig in rigs]))
    ramps = np.column_stack([np.zeros(len(rigs))] * 2 + [np.ones(len(rigs)), np.zeros(len(rigs))])
    first, parts, diverged = 0, [], np.zeros(len(rigs))
    for leg in legs:
        count = round(positive(leg.duration, "duration", "s") * rate)
        ramps = ramps_to(leg, ramps, first, rate)
        found = np.zeros((len(rigs), OUTCOMES))
        found[:, DIVERGED] = diverged
        through_leg(leg, models, ticks, ramps, first, count, rate, states, candidates, found)
        diverged = found[:, DIVERGED]
        parts.append(outcomes_of(found, count if leg.watched is None else round(leg.watched * rate), rate))
        first += count
    failures = {int(number): "the rig diverged" for number in np.flatnonzero(diverged)}
    radius, force, share, last = np.array(parts).transpose(1, 0, 2)
    return Swept(radius, force, share, last, np.empty((len(legs), len(rigs), 0, 2)), failures)


def ramps_to(leg: Leg, ramps: Values, first: int, rate: float) -> Values:
    """Return the ramps (n_rigs, 4) that begin at sample `first`, from where others have come to by then."""
    begin, target, slope, since = ramps.T
    way = np.minimum(slope * (first - since) / rate, abs(target - begin))
    now = begin + np.copysign(way, target - begin)
    wanted = np.broadcast_to(leg.speed, len(ramps)).astype(np.float64)
    steep = np.full(len(ramps), positive(leg.ramp, "ramp", "rad/s2"))
    return np.column_stack((now, wanted, steep, np.full(len(ramps), float(first))))


def through_leg(
    leg: Leg,
    models: Any,
    ticks: Any,
    ramps: Values,
    first: int,
    count: int,
    rate: float,
    states: Any,
    candidates: Any,
    found: Values,
) -> None:
    """Run all rigs, whose arrays are on the GPU, through a leg of `count` samples; fill `found` (n, 5)."""
    watched = 0 if leg.watched is None else max(0, count - round(leg.watched * rate))
    there, ramps_there = cuda.to_device(found), cuda.to_device(ramps)
    blocks = -(-len(found) // THREADS)
    for begin in range(0, count, CHUNK):
        size = min(CHUNK, count - begin)
        march_all[blocks, THREADS](
            models, ticks, ramps_there, first, begin, size, watched, states, candidates, there
        )
    there.copy_to_host(found)


def outcomes_of(found: Values, watched: int, rate: float) -> list[Values]:
    """Return largest radius and force, share in contact, last contact (n,); NaN of rigs that diverged."""
    good = np.where(found[:, DIVERGED] > 0.0, np.nan, 1.0)
    radius, force = found[:, LARGEST_RADIUS] * good, found[:, LARGEST_FORCE] * good
    return [
        radius,
        force,
        found[:, IN_CONTACT] / max(watched, 1) * good,
        found[:, LAST_CONTACT] / rate * good,
    ]


def records(rows: Sequence[Any]) -> NDArray[Any]:
    """Return named tuples of numbers, or of such tuples, as an array of records with their fields' names."""
    return np.array([values_of(row) for row in rows], dtype=type_of(rows[0]))


def type_of(row: Any) -> np.dtype[Any]:
    """Return the record's type: whole numbers stay whole, and empty tuples are left out."""
    pairs = [(name, value) for name, value in zip(row._fields, row, strict=True) if value != ()]
    return np.dtype(
        [(name, type_of(value) if hasattr(value, "_fields") else type(value)) for name, value in pairs]
    )


def values_of(row: Any) -> tuple[Any, ...]:
    """Return what goes into it."""
    return tuple(values_of(value) if hasattr(value, "_fields") else value for value in row if value != ())
