"""How well the observer sees what no sensor sees, and what it costs.

Run-ups with impacts from 8 to 17 Hz on the emulated rig, its unbalance, its parameters and its noise hidden
from the twin, on the ball and the pinned bearing. Cases: `mm`, parameters off by up to 20 %; `struct`, the
model's form is wrong too (`tests.twin.cases`). Beside the observer, on the same runs: the observer without
transducers; the linear filter on the probes (its force is what true unbalance and weight leave of the moment
that it finds); an open-loop shadow (the same model, never corrected, but told the true unbalance); and the
raw transducers (their resultant taken for the contact force). Then what smoothing makes better between
impacts, how often the regime is named right
(`benchmarks.regime`), and what the twin costs in free flight, bouncing and violent backward whirl, live and
offline. `--json` gives figures, otherwise the whole table is printed too. Run `python -m benchmarks.twin`.
"""

import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks import regime
from benchmarks.report import Figure, parser, show
from daq import keys
from daq.messages import SeriesEncoder
from daq.messages_pb2 import Description
from daq.recording import RecordingWriter
from daq.rig import load_rig
from replay.rerun import estimate
from tests.twin.accuracy import (
    Calibration,
    Errors,
    Hindsight,
    Observation,
    Trace,
    calibration_of,
    errors_of,
    hindsight_of,
    observe,
    trace_of,
)
from tests.twin.cases import ACTUAL, case_run
from tests.twin.emulated import EmulatedRun, emulate, run_up
from twin.estimate import STRIDE
from twin.estimation import Twin
from twin.fallback import follow
from twin.layout import UNBALANCE
from twin.observer import Observer

SEEDS = (101, 202, 303)
RIGS = ("ball", "pinned")
CASES = ("mm", "struct")
BLOCK = 250  # samples of a block
WHIRL_UNBALANCE = 9e-5  # kg m
VIOLENT = 800.0  # N from which a block counts as violent contact
BEGUN = 1_700_000_000  # s since 1970, of the first sample: a block of a run always tells a time
FIRST_RAW = 3.0  # N of the transducers' resultant from which an impact is taken to be there


def observed(run: EmulatedRun) -> Trace:
    """Return the observer's account."""
    return trace_of(observe(run))


def on_probes_alone(run: EmulatedRun) -> Trace:
    """Return the observer's account without transducers."""
    return trace_of(observe(run, without=["force"]))


def shadowed(run: EmulatedRun) -> Trace:
    """Return the account of the model alone, begun at the truth's unbalance and never corrected."""
    observer = Observer(run.rig)
    rotor = run.rig.emulated_model.rotor
    unbalance = rotor.unbalance * np.exp(1j * rotor.unbalance_angle)
    observer.memory.state[UNBALANCE : UNBALANCE + 2] = unbalance.real, unbalance.imag
    parts = [observer.update(run.blocks[0])]
    observer.sensors.low[:] = np.inf  # no reading is above it: none is used
    parts += [observer.update(block) for block in run.blocks[1:]]
    return trace_of(Observation(run, parts, np.empty(0), observer, []))


def filtered(run: EmulatedRun) -> Trace:
    """Return the linear filter's account; its force is what true unbalance and weight leave of its moment."""
    observer, parts = Observer(run.rig), []
    for block in run.blocks:
        part = np.empty((6, -(-block.samples.shape[1] // STRIDE)))
        follow(observer.fallback, observer.sensors, block.samples, STRIDE, part)
        parts.append(part)
    motion = np.concatenate(parts, axis=1)
    rotor = run.rig.emulated_model.rotor
    angle, speed = run.truth["angle"][::STRIDE], run.truth["speed"][::STRIDE]
    turning = speed**2 - 1j * np.gradient(speed, STRIDE / run.rig.acquisition.rate)
    unbalance = rotor.disk_station * rotor.unbalance * turning * np.exp(1j * (angle + rotor.unbalance_angle))
    weight = -rotor.mass * rotor.gravity * rotor.centre_of_mass_station
    static = 1j * (weight + rotor.coupling_station * rotor.coupling_force)
    gyroscopic = 1j * rotor.polar_inertia * speed * (motion[2] + 1j * motion[3])
    left = rotor.inertia * (motion[4] + 1j * motion[5]) - unbalance - static - gyroscopic
    station = rotor.bearing_station
    return Trace(np.abs(left)[np.newaxis] / station, station * motion[:2], station * motion[2:4], FIRST_RAW)


def transduced(run: EmulatedRun) -> Trace:
    """Return what the transducers' resultant and the probes say by themselves."""
    samples = np.concatenate([block.samples for block in run.blocks], axis=1)[:, ::STRIDE]
    row = {name: samples[run.rig.channels.index(name)] for name in run.rig.channels.names}
    force = np.hypot(row["force_right"] - row["force_left"], row["force_top"] - row["force_bottom"])
    rotor = run.rig.emulated_model.rotor
    place = rotor.bearing_station / rotor.disk_station * np.stack([row["proximity_x"], row["proximity_y"]])
    rate = np.gradient(place, STRIDE / run.rig.acquisition.rate, axis=1)
    return Trace(force[np.newaxis], place, rate, FIRST_RAW)


METHODS: dict[str, Callable[[EmulatedRun], Trace]] = {
    "observer": observed,
    "on probes alone": on_probes_alone,
    "linear filter": filtered,
    "open-loop shadow": shadowed,
    "raw transducers": transduced,
}


def table() -> dict[str, dict[str, Errors]]:
    """Return the errors of each method in each case."""
    found = {}
    for case in CASES:
        for rig in RIGS:
            runs = [case_run(f"thesis-{rig}", case, seed) for seed in SEEDS]
            found[f"{rig} {case}"] = {
                label: errors_of(runs, [method(run) for run in runs]) for label, method in METHODS.items()
            }
    return found


def calibrations() -> dict[str, Calibration]:
    """Return how fair the observer's doubts are in each case."""
    return {
        f"{rig} {case}": calibration_of([observe(case_run(f"thesis-{rig}", case, seed)) for seed in SEEDS])
        for case in CASES
        for rig in RIGS
    }


def smoothings() -> dict[str, Hindsight]:
    """Return what `rigtwin twin --smooth` makes better on each rig, where the model's form is right."""
    return {
        rig: hindsight_of([observe(case_run(f"thesis-{rig}", "mm", seed), smooth=True) for seed in SEEDS])
        for rig in RIGS
    }


def print_table(
    rows: dict[str, dict[str, Errors]], fair: dict[str, Calibration], smoothed: dict[str, Hindsight]
) -> None:
    """Print the table of errors, the doubts, and what smoothing does."""
    print(
        f"{'case':14} {'method':17} {'corr.':>7} {'peak':>6} {'<5 %':>5} {'<10 %':>5} {'imp.<5 %':>8} "
        f"{'pin':>6} {'missed':>6} {'false':>6} {'µm':>8} {'mm/s':>8}"
    )
    for case, methods in rows.items():
        for method, row in methods.items():
            print(
                f"{case:14} {method:17} {row.correlation:7.4f} {np.median(np.abs(row.peak_errors)):6.1%} "
                f"{row.within(row.peak_errors, 0.05):5.0%} {row.within(row.peak_errors, 0.1):5.0%} "
                f"{row.within(row.impulse_errors, 0.05):8.0%} {row.right_pin:6.1%} "
                f"{row.missed / len(SEEDS):6.1f} {row.false_alarms / len(SEEDS):6.1f} "
                f"{1e6 * row.position:8.3f} {1e3 * row.velocity:8.3f}"
            )
    for case, doubt in fair.items():
        print(
            f"{case}: normalised error {doubt.error:.2f}, innovations {doubt.innovations.min():.2f} to "
            f"{doubt.innovations.max():.2f}, within 1 and 2 sigma {doubt.one_sigma:.0%} and "
            f"{doubt.two_sigma:.0%} of motion, {doubt.force_one_sigma:.0%} and {doubt.force_two_sigma:.0%} "
            "of force"
        )
    for rig, found in smoothed.items():
        print(
            f"{rig} mm smoothed: {found.share:.0%} of flight, {1e6 * found.filter_position:.3f} to "
            f"{1e6 * found.position:.3f} µm, {1e3 * found.filter_velocity:.4f} to "
            f"{1e3 * found.velocity:.4f} mm/s, within 1 and 2 sigma {found.one_sigma:.0%} and "
            f"{found.two_sigma:.0%}"
        )
    print()


def costs() -> dict[str, Figure]:
    """Return what the twin costs, all included: decoding, estimating, judging, summing up, encoding."""
    run = case_run("thesis-ball", "mm", SEEDS[0])
    first = int(np.flatnonzero(run.truth["normal_force"] > 0.0)[0])
    walls, shares = timed(run)
    index = np.array([block.first_sample for block in run.blocks[1:]])
    whirl = violent_run()
    pressed = np.array([whirl.truth["normal_force"][block.first_sample] for block in whirl.blocks[1:]])
    bouncing = float(shares[index >= first].mean())
    allowed, length = "what is allowed", "a block's length"
    return {
        "cpu_share_free": Figure(float(shares[index + BLOCK <= first].mean()), "core", 0.15, allowed),
        "cpu_share": Figure(bouncing, "core", 0.15, allowed),
        "cpu_share_whirl": Figure(float(timed(whirl)[1][pressed > VIOLENT].mean()), "core", 0.5, allowed),
        "whirl_force": Figure(float(np.median(pressed[pressed > VIOLENT])), "N", 1e3, "a kilonewton"),
        "cost_of_a_tick": Figure(40.0 * bouncing, "us", 40.0, "the tick"),
        "block_to_estimate_p50": Figure(1e3 * float(np.quantile(walls, 0.5)), "ms", 10.0, length),
        "block_to_estimate_p99": Figure(1e3 * float(np.quantile(walls, 0.99)), "ms", 10.0, length),
        "offline_speed": Figure(offline_speed(run), "s/s", 8.0, "what is asked"),
    }


def timed(run: EmulatedRun) -> tuple[np.ndarray, np.ndarray]:
    """Return for each block of a run but the first how long its estimate took (s) and its share of a core."""
    twin, payloads = Twin(run.rig, "run", BEGUN * 10**9), encoded(run)
    twin.process(payloads[0])
    walls, shares = [], []
    for payload in payloads[1:]:
        wall, processor = time.perf_counter(), time.process_time()
        twin.process(payload)
        walls.append(time.perf_counter() - wall)
        shares.append((time.process_time() - processor) * run.rig.acquisition.rate / BLOCK)
    return np.array(walls), np.array(shares)


def encoded(run: EmulatedRun) -> list[bytes]:
    """Return a run's blocks as they are published."""
    rate, channels = run.rig.acquisition.rate, run.rig.channels
    encoder = SeriesEncoder("run", rate, channels.names, channels.units)
    return [
        encoder.encode(BEGUN + block.first_sample / rate, block.first_sample, 0, block.samples)
        for block in run.blocks
    ]


def violent_run() -> EmulatedRun:
    """Return a run that ends in backward whirl at about a kilonewton: a plain bearing with much friction."""
    settings = ["backup_bearing.friction=0.4", f"{ACTUAL}.rotor.unbalance={WHIRL_UNBALANCE}"]
    return emulate(load_rig("thesis-plain", settings), run_up(10.0, 18.0, 1.5, dwell=1.0))


def offline_speed(run: EmulatedRun) -> float:
    """Return how many seconds of a run `rigtwin twin` estimates in one, files read and written."""
    rig = run.rig
    begun = Description(
        run="run",
        rig=rig.name,
        toml=rig.toml,
        rate=rig.acquisition.rate,
        mode="EMULATED",
        t0_ns=BEGUN * 10**9,
    )
    with TemporaryDirectory() as folder:
        source, target = Path(folder) / "run.mcap", Path(folder) / "estimated.mcap"
        with RecordingWriter(source, begun) as writer:
            for payload in encoded(run):
                writer.add(keys.block(rig.name), payload)
        begin = time.perf_counter()
        estimate(source, target)
        return len(run.blocks) * BLOCK / rig.acquisition.rate / (time.perf_counter() - begin)


def figures(rows: dict[str, dict[str, Errors]]) -> dict[str, Figure]:
    """Return each case's main figures with the best of the other methods as baseline."""
    found = {}
    for case, methods in rows.items():
        label, mine = case.replace(" ", "_"), methods["observer"]
        others = [methods[name] for name in ("linear filter", "open-loop shadow", "raw transducers")]
        peak = min(float(np.median(np.abs(row.peak_errors))) for row in others)
        speed, place = min(row.velocity for row in others), min(row.position for row in others)
        best = "the best of filter, shadow and raw sensors"
        error = 100.0 * float(np.median(np.abs(mine.peak_errors)))
        found[f"{label}_peak_error"] = Figure(error, "%", 100.0 * peak, best)
        found[f"{label}_position"] = Figure(1e6 * mine.position, "um", 1e6 * place, best)
        found[f"{label}_velocity"] = Figure(1e3 * mine.velocity, "mm/s", 1e3 * speed, best)
    return found


def smoothed_figures(smoothed: dict[str, Hindsight]) -> dict[str, Figure]:
    """Return position and velocity between impacts, smoothed, with the filter's as baseline."""
    found = {}
    for rig, each in smoothed.items():
        position, velocity = 1e6 * each.filter_position, 1e3 * each.filter_velocity
        found[f"{rig}_mm_smoothed_position"] = Figure(1e6 * each.position, "um", position, "the filter")
        found[f"{rig}_mm_smoothed_velocity"] = Figure(1e3 * each.velocity, "mm/s", velocity, "the filter")
    return found


def main() -> None:
    """Measure and report."""
    options = parser(__doc__).parse_args()
    rows, smoothed, named = table(), smoothings(), (regime.drawn(), regime.plain())
    if not options.json:
        print_table(rows, calibrations(), smoothed)
        regime.print_table(*named)
    found = figures(rows) | smoothed_figures(smoothed) | regime.figures(*named)
    show(found | costs(), options.json)


if __name__ == "__main__":
    main()
