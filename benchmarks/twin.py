"""How well the observer sees what no sensor sees, and what it costs.

Run-ups with impacts from 8 to 16 Hz on the emulated rig, its unbalance and noise hidden from the twin, on the
ball and the pinned bearing: with the contact as described, and with stiffness, damping, friction and
coupling force up to 20 % off. Beside it, on the same runs: an open-loop shadow (the same model, never
corrected, but told the true unbalance, which a real one could not be) and the raw transducers (their
resultant taken for the contact force). `--json` gives figures, otherwise the whole table is printed too.
Run `python -m benchmarks.twin`.
"""

import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from analysis.impacts import compare_impacts, correlation, find_impacts
from benchmarks.report import Figure, parser, show
from daq.messages import SeriesEncoder
from daq.rig import Rig, load_rig
from tests.twin.emulated import EmulatedRun, emulate, run_up
from twin.estimation import Twin
from twin.layout import UNBALANCE, Tuning
from twin.observer import STRIDE, Observer

SEEDS = (101, 202)
SETTLED = 0.5  # s after which positions and velocities are compared
TOLERANCE = 25  # samples by which impacts may be apart
CASES = (
    ("ball", "thesis-ball", 0.0),
    ("pinned", "thesis-pinned", 0.0),
    ("ball, mismatch", "thesis-ball", 0.2),
)
DEAF = 1e9  # noise that makes the observer ignore its sensors
FIRST_RAW = 3.0  # N of the transducers' resultant from which an impact is taken to be there


class Trace(NamedTuple):
    """One method's account of a run, every `STRIDE`-th sample."""

    normal_force: np.ndarray  # N
    x: np.ndarray | None  # m, shaft centre at the bearing's plane
    y: np.ndarray | None
    rate_x: np.ndarray | None  # m/s
    rate_y: np.ndarray | None
    threshold: float  # N from which it is an impact


class Row(NamedTuple):
    """One method's errors in one case, over all seeds."""

    correlation: float
    peak_error: float  # median
    peaks_within: float  # share within 5 %
    impulses_within: float
    missed: float  # per run
    false_alarms: float  # per run
    position: float  # m rms
    velocity: float  # m/s rms


def hidden_rig(name: str, mismatch: float, seed: int) -> Rig:
    """Return a rig whose emulation differs from its description."""
    draw = np.random.default_rng(seed)
    model = load_rig(name).model
    assert model is not None
    settings = [
        f"emulator.seed={seed}",
        f"emulator.actual.rotor.unbalance={model.rotor.unbalance * draw.uniform(0.8, 1.2)}",
        f"emulator.actual.rotor.unbalance_angle={draw.uniform(-np.pi, np.pi)}",
    ]
    if mismatch:
        bearing = model.backup_bearing
        for key in ("stiffness", "damping_factor", "friction"):
            value = getattr(bearing, key) * draw.uniform(1.0 - mismatch, 1.0 + mismatch)
            settings.append(f"emulator.actual.backup_bearing.{key}={value}")
        coupling = model.rotor.coupling_force * draw.uniform(1.0 - mismatch / 2.0, 1.0 + mismatch / 2.0)
        settings.append(f"emulator.actual.rotor.coupling_force={coupling}")
    return load_rig(name, settings)


def observed(run: EmulatedRun) -> Trace:
    """Return the observer's account."""
    return traced(run, Observer(run.rig))


def shadowed(run: EmulatedRun) -> Trace:
    """Return the account of the model alone, begun at the truth's unbalance and never corrected."""
    observer = Observer(run.rig, Tuning(displacement_noise=DEAF, force_noise=DEAF))
    rotor = run.rig.emulated_model.rotor
    unbalance = rotor.unbalance * np.exp(1j * rotor.unbalance_angle)
    observer.memory.state[UNBALANCE : UNBALANCE + 2] = unbalance.real, unbalance.imag
    return traced(run, observer)


def traced(run: EmulatedRun, observer: Observer) -> Trace:
    """Run an observer over a run."""
    assert run.rig.model is not None
    parts = [observer.update(block) for block in run.blocks]
    station = run.rig.model.rotor.bearing_station

    def row(name: str) -> np.ndarray:
        return np.concatenate([part.row(name) for part in parts])

    return Trace(
        row("normal_force"),
        row("displacement_x"),
        row("displacement_y"),
        station * row("tilt_rate_x"),
        station * row("tilt_rate_y"),
        0.1,
    )


def transduced(run: EmulatedRun) -> Trace:
    """Return what the transducers' resultant and the probes say by themselves."""
    assert run.rig.model is not None
    samples = np.concatenate([block.samples for block in run.blocks], axis=1)[:, ::STRIDE]
    row = {name: samples[run.rig.channels.index(name)] for name in run.rig.channels.names}
    force = np.hypot(row["force_right"] - row["force_left"], row["force_top"] - row["force_bottom"])
    scale = run.rig.model.rotor.bearing_station / run.rig.model.rotor.disk_station
    x, y = scale * row["proximity_x"], scale * row["proximity_y"]
    step = STRIDE / run.rig.acquisition.rate
    return Trace(force, x, y, np.gradient(x, step), np.gradient(y, step), FIRST_RAW)


def judge(runs: Sequence[EmulatedRun], method: Callable[[EmulatedRun], Trace]) -> Row:
    """Compare a method with the truth of all runs of a case."""
    peaks: list[np.ndarray] = []
    impulses: list[np.ndarray] = []
    correlations, positions, velocities = [], [], []
    impacts = missed = alarms = 0
    for run in runs:
        trace, rate = method(run), run.rig.acquisition.rate
        truth = run.truth["normal_force"]
        reference = find_impacts(truth, rate)
        seen = find_impacts(trace.normal_force, rate / STRIDE, trace.threshold)
        seen = seen._replace(start=seen.start * STRIDE, end=seen.end * STRIDE)
        found = compare_impacts(reference, seen, TOLERANCE)
        peaks.append(np.abs(found.peak_error))
        impulses.append(np.abs(found.impulse_error))
        impacts += int(np.count_nonzero(reference.peak > 5.0))
        missed += found.missed.size
        alarms += found.false_alarms.size
        correlations.append(correlation(truth[::STRIDE], trace.normal_force))
        positions.append(rms_errors(run, trace.x, trace.y, "tilt"))
        velocities.append(rms_errors(run, trace.rate_x, trace.rate_y, "tilt_rate"))
    return Row(
        float(np.mean(correlations)),
        float(np.median(np.concatenate(peaks))),
        float(np.count_nonzero(np.concatenate(peaks) < 0.05) / impacts),
        float(np.count_nonzero(np.concatenate(impulses) < 0.05) / impacts),
        missed / len(runs),
        alarms / len(runs),
        float(np.mean(positions)),
        float(np.mean(velocities)),
    )


def rms_errors(run: EmulatedRun, x: np.ndarray | None, y: np.ndarray | None, name: str) -> float:
    """Return the rms of two coordinates' errors at the bearing's plane, once settled."""
    assert run.rig.model is not None
    start = int(SETTLED * run.rig.acquisition.rate / STRIDE)
    station = run.rig.model.rotor.bearing_station
    errors = [
        seen[start:] - station * run.truth[f"{name}_{axis}"][::STRIDE][start:]
        for axis, seen in (("x", x), ("y", y))
        if seen is not None
    ]
    return float(np.sqrt(np.mean(np.square(errors))))


def table() -> dict[str, dict[str, Row]]:
    """Return the errors of each method in each case."""
    methods = {"observer": observed, "open-loop shadow": shadowed, "raw transducers": transduced}
    found = {}
    for case, name, mismatch in CASES:
        runs = [
            emulate(rig, run_up(8.0, 16.0, 0.8))
            for rig in (hidden_rig(name, mismatch, seed) for seed in SEEDS)
        ]
        found[case] = {label: judge(runs, method) for label, method in methods.items()}
    return found


def print_table(rows: dict[str, dict[str, Row]]) -> None:
    """Print the table of errors."""
    print(
        f"{'case':15} {'method':17} {'corr.':>7} {'peak':>6} {'<5 %':>5} {'imp.<5 %':>8} "
        f"{'missed':>6} {'false':>6} {'µm':>8} {'mm/s':>8}"
    )
    for case, methods in rows.items():
        for method, row in methods.items():
            print(
                f"{case:15} {method:17} {row.correlation:7.4f} {row.peak_error:6.1%} "
                f"{row.peaks_within:5.0%} {row.impulses_within:8.0%} {row.missed:6.1f} "
                f"{row.false_alarms:6.1f} {1e6 * row.position:8.3f} {1e3 * row.velocity:8.3f}"
            )
    print()


def costs() -> dict[str, Figure]:
    """Return what a block costs the twin, all included: decoding, estimating, summing up, encoding."""
    run = emulate(hidden_rig("thesis-ball", 0.0, SEEDS[0]), run_up(8.0, 16.0, 0.8))
    encoder = SeriesEncoder("run", run.rig.acquisition.rate, run.rig.channels.names, run.rig.channels.units)
    payloads = [encoder.encode(0.0, block.first_sample, 0, block.samples) for block in run.blocks]
    twin = Twin(run.rig, "run", 0)
    twin.process(payloads[0])
    walls, begin = [], time.process_time()
    for payload in payloads[1:]:
        before = time.perf_counter()
        twin.process(payload)
        walls.append(time.perf_counter() - before)
    share = (time.process_time() - begin) / (len(walls) * 0.01)
    return {
        "cpu_share": Figure(share, "core", 0.15, "what is allowed"),
        "cost_of_a_tick": Figure(40.0 * share, "us", 40.0, "the tick"),
        "block_to_estimate_p50": Figure(1e3 * float(np.quantile(walls, 0.5)), "ms", 10.0, "a block's length"),
        "block_to_estimate_p99": Figure(
            1e3 * float(np.quantile(walls, 0.99)), "ms", 10.0, "a block's length"
        ),
    }


def figures(rows: dict[str, dict[str, Row]]) -> dict[str, Figure]:
    """Return each case's main figures with the best of the other methods as baseline."""
    found = {}
    for case, methods in rows.items():
        others = [row for name, row in methods.items() if name != "observer"]
        label = case.replace(", ", "_")
        mine = methods["observer"]
        peak, speed = min(row.peak_error for row in others), min(row.velocity for row in others)
        place = min(row.position for row in others)
        best = "the better of shadow and raw sensors"
        found[f"{label}_peak_error"] = Figure(100.0 * mine.peak_error, "%", 100.0 * peak, best)
        found[f"{label}_position"] = Figure(1e6 * mine.position, "um", 1e6 * place, best)
        found[f"{label}_velocity"] = Figure(1e3 * mine.velocity, "mm/s", 1e3 * speed, best)
    return found


def main() -> None:
    """Measure and report."""
    options = parser(__doc__).parse_args()
    rows = table()
    if not options.json:
        print_table(rows)
    show(figures(rows) | costs(), options.json)


if __name__ == "__main__":
    main()
