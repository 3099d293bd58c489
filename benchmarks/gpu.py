"""What a GPU does of a sweep: rigs stepped a second, beside one thread and all cores of the same machine.

Each rig goes to 11 Hz and on to 12 Hz, one simulated second, with an unbalance of its own, so that some fly
and others bounce. A GPU takes its time for each tick of the slowest rig, so it pays for thousands of rigs.
Before anything is measured, the outcomes of a few are compared with those of the CPU. Run
`python -m benchmarks.gpu` where NVIDIA's driver and numba-cuda (extra `gpu`) are; it is not part of
`python -m benchmarks`.
"""

import os
import time
from collections.abc import Callable
from math import tau
from typing import Any

import numpy as np

from benchmarks.report import Figure, parser, show
from daq.rig import load_rig
from simulator.gpu import available, sweep_on_gpu
from simulator.rig import DriveMode, Model
from simulator.sweep import Leg, Swept, sweep

RAMP = tau * 26.7  # rad/s2
LEGS = [Leg(tau * 11.0, RAMP, 0.5), Leg(tau * 12.0, RAMP, 0.5)]
SECONDS = sum(leg.duration for leg in LEGS)
RIGS = (1024, 8192, 65536)
ON_CPU = 64  # rigs a thread
COMPARED = 256
FLYING = 20e-6  # kg m: up to this unbalance no rig hits its bearing, and outcomes are not chaotic
AGREEMENT = 1e-9  # of an orbit without contact: the GPU rounds otherwise, and nothing amplifies it


def main() -> None:
    """Compare, measure, show."""
    options = parser(__doc__).parse_args()
    if not available():
        raise SystemExit("no GPU was found that numba-cuda can use: pip install 'rigtwin[gpu]'")
    model = prescribed()
    compare(model)
    one = rate(sweep, model, ON_CPU, workers=1)
    cores = os.cpu_count() or 1
    every = rate(sweep, model, ON_CPU * cores, workers=cores)
    figures = {"all_cores": Figure(every, "rig s/s", one, "one thread")}
    for count in RIGS:
        figures[f"gpu_{count}_rigs"] = Figure(
            rate(sweep_on_gpu, model, count), "rig s/s", every, f"{cores} cores"
        )
    show(figures, options.json)


def prescribed() -> Model:
    """Return the thesis' ball bearing rig with a prescribed speed."""
    model = load_rig("thesis-ball").model
    assert model is not None
    return model._replace(drive=model.drive._replace(mode=DriveMode.IDEAL))


def compare(model: Model) -> None:
    """Compile both, and raise where they disagree on orbits without contact."""
    changes = {"rotor.unbalance": np.linspace(2e-6, FLYING, COMPARED)}
    first, second = sweep_on_gpu(model, changes, LEGS), sweep(model, changes, LEGS)
    assert not second.largest_force.any(), "a rig is in contact: choose a smaller unbalance"
    np.testing.assert_allclose(first.largest_radius, second.largest_radius, rtol=AGREEMENT)


def rate(run: Callable[..., Swept], model: Model, count: int, **options: Any) -> float:
    """Return how many rigs' seconds are simulated in a second."""
    changes = {"rotor.unbalance": np.linspace(20e-6, 400e-6, count)}
    begin = time.perf_counter()
    run(model, changes, LEGS, **options)
    return count * SECONDS / (time.perf_counter() - begin)


if __name__ == "__main__":
    main()
