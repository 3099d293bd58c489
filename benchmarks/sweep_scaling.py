"""What a sweep over many rigs gains from two cores, beside what the machine gives to two threads at most."""

import time
from concurrent.futures import ThreadPoolExecutor
from math import tau

import numpy as np

from benchmarks.report import Figure, in_turns
from simulator.rig import Model
from simulator.simulation import Simulation, signals_for
from simulator.sweep import CHUNK, Leg, sweep

ROUNDS = 5
RIGS = 1000
SECONDS = 5.0  # of each rig; making one costs as much as 0.1 s of it
RAMP = tau * 26.7  # rad/s2
APART_HZ = 12.0  # with impacts, as most of the sweep's rigs
APART_CHUNKS = 12_000  # of each thread: 2400 s of run
UNIT = "x real time"


def sweep_rate(model: Model, workers: int) -> float:
    """Sweep speed and unbalance over `RIGS` rigs; return seconds of run for each second of the clock."""
    changes = {"rotor.unbalance": np.tile(np.linspace(20e-6, 200e-6, 40), RIGS // 40)}
    speeds = np.repeat(tau * np.linspace(8.0, 18.0, RIGS // 40), 40)
    begin = time.perf_counter()
    sweep(model, changes, [Leg(speeds, RAMP, SECONDS)], workers=workers)
    return RIGS * SECONDS / (time.perf_counter() - begin)


def apart_rate(model: Model, threads: int) -> float:
    """Let each thread step a rig of its own in memory of its own; return the same."""
    rigs = [(Simulation(model), signals_for(CHUNK)) for _ in range(threads)]

    def run(rig: tuple[Simulation, np.ndarray]) -> None:
        simulation, signals = rig
        simulation.set_speed(tau * APART_HZ, RAMP)
        for _ in range(APART_CHUNKS):
            simulation.advance(signals)

    with ThreadPoolExecutor(threads) as pool:
        begin = time.perf_counter()
        for _ in pool.map(run, rigs):
            pass
        spent = time.perf_counter() - begin
    return threads * APART_CHUNKS * CHUNK / rigs[0][0].rate / spent


def measured(model: Model) -> dict[str, Figure]:
    """Return the figures of a rig with a prescribed speed; by the clock, medians of `ROUNDS` rounds."""
    apart_rate(model, 1)  # warms up
    rates = in_turns(
        {
            "two": lambda: sweep_rate(model, 2),
            "apart_two": lambda: apart_rate(model, 2),
            "one": lambda: sweep_rate(model, 1),
            "apart_one": lambda: apart_rate(model, 1),
        },
        ROUNDS,
    )
    most = rates["apart_two"] / rates["apart_one"]
    return {
        "sweep_of_1000": Figure(rates["two"], UNIT, rates["one"], "one thread instead of two"),
        "sweep_scaling": Figure(
            rates["two"] / rates["one"], "x", most, "two threads with nothing in common, on this machine"
        ),
    }
