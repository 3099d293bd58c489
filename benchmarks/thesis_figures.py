"""Figures of the run-ups and run-downs with ball and pinned bearing (P2, P3)."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from analysis.orbit import once_a_turn
from analysis.spectrum import cascade, full_spectrum
from benchmarks.thesis_plotting import DOWN, MICRO, UP, panels, pin_boundary, ring, square
from benchmarks.thesis_runs import KEPT_RATE, RATE, DropTest, Dwell, Hit, Stairs
from simulator.rig import Model

ORBITS = (9.5, 10.5, 12.0, 13.5, 14.5, 15.5, 16.5)  # Hz
SECTIONS = (10.0, 10.5, 11.0, 12.0, 14.5)  # Hz
LIMIT = 40.0  # Hz, of the waterfalls
FLOOR = 0.1  # um, of a spectrum's colour scale


def at(dwells: Sequence[Dwell], hz: float) -> Dwell:
    """Return the dwell at a speed."""
    return min(dwells, key=lambda dwell: abs(dwell.hz - hz))


def wall(axis: Any, model: Model) -> None:
    """Draw the bearing."""
    bearing = model.backup_bearing
    if bearing.kind == 2:
        pin_boundary(axis, bearing.clearance, model.rotor.shaft_radius, bearing.pin_tip_radius)
    else:
        ring(axis, bearing.clearance)


def orbits(model: Model, run: Stairs) -> Any:
    """Orbits at selected speeds, going up and going down: P2 figure 14, P3 figures 14 and 15."""
    figure, axes = panels(2, len(ORBITS), 14.0, 4.6, sharex=True, sharey=True)
    limit = 2500.0 if model.backup_bearing.kind == 2 else 1750.0
    for row, (name, dwells, colour) in enumerate((("up", run.up, UP), ("down", run.down, DOWN))):
        for axis, hz in zip(axes[row], ORBITS, strict=True):
            x, y = MICRO * at(dwells, hz).end[:2, -2000:]
            wall(axis, model)
            axis.plot(x, y, color=colour, lw=0.7)
            axis.set_title(f"{hz:g} Hz, {name}")
            square(axis, limit, labels=False)
        axes[row][0].set_ylabel("y [µm]")
    for axis in axes[1]:
        axis.set_xlabel("x [µm]")
    return figure


def hysteresis(runs: Mapping[str, Stairs], freed: Hit | None) -> Any:
    """Largest radius against speed, up and down: P2 figure 11, P3 figure 13."""
    figure, axes = panels(1, len(runs), 11.0, 4.0, sharey=True)
    for axis, (name, run) in zip(axes[0], runs.items(), strict=True):
        for dwells, colour, label in ((run.up, UP, "run-up"), (run.down, DOWN, "run-down")):
            axis.plot(*line(dwells, "radius", MICRO), "o-", ms=3, lw=1.0, color=colour, label=label)
        axis.axhline(1500.0, color="#333333", lw=0.8, ls="--")
        axis.text(0.2, 1515.0, "gap under ring or pin tip", fontsize=8)
        axis.set_title(name)
        axis.set_xlabel("speed [Hz]")
    if freed is not None:
        before, after = (MICRO * np.hypot(*part[:2]).max() for part in (freed.before, freed.after[:, -2000:]))
        arrow = {"arrowstyle": "->", "ls": "--"}
        axes[0, 0].annotate("", (15.0, after), (15.0, before), arrowprops=arrow)
        axes[0, 0].text(15.2, after + 20.0, "one hit", fontsize=8)
    axes[0, 0].set_ylabel("largest radius at the bearing [µm]")
    axes[0, 0].legend(loc="upper left", bbox_to_anchor=(0.0, 0.93))
    return figure


def line(dwells: Sequence[Dwell], field: str, scale: float) -> tuple[list[float], list[float]]:
    """Return speeds and a field of dwells."""
    return [dwell.hz for dwell in dwells], [scale * getattr(dwell, field) for dwell in dwells]


def forces(runs: Mapping[str, Stairs]) -> Any:
    """Largest force against speed, up and down: P2 figure 17, P3 figure 16."""
    figure, axes = panels(1, 2, 11.0, 3.6, sharey=True)
    styles = {
        "ball": ("#1f6fb4", "o-"),
        "pinned": ("#7a7a7a", "s-"),
        "ball, published contact": ("#1f6fb4", ":"),
    }
    for axis, part in zip(axes[0], ("up", "down"), strict=True):
        for name, run in runs.items():
            colour, style = styles[name]
            axis.plot(*line(getattr(run, part), "force", 1.0), style, ms=3, lw=1.0, color=colour, label=name)
        axis.set_title(f"run-{part}")
        axis.set_xlabel("speed [Hz]")
        axis.set_xlim(7.0, 18.0)
    axes[0, 0].set_ylabel("largest transducer resultant [N]")
    axes[0, 0].legend(loc="upper left")
    return figure


def waterfalls(runs: Mapping[str, Stairs]) -> Any:
    """Double-sided spectra over speed, up then down: P2 figure 16."""
    figure, axes = panels(1, len(runs), 11.0, 5.2, sharey=True)
    for axis, (name, run) in zip(axes[0], runs.items(), strict=True):
        dwells = [dwell for dwell in (*run.up, *run.down) if dwell.hz >= 5.0]
        _, amplitude = cascade([dwell.end[:2] for dwell in dwells], KEPT_RATE, LIMIT)
        level = np.log10(np.maximum(MICRO * amplitude, FLOOR))
        picture = axis.imshow(
            level, aspect="auto", origin="lower", cmap="viridis", vmin=-1.0, vmax=3.2,
            extent=(-LIMIT, LIMIT, -0.5, len(dwells) - 0.5), interpolation="nearest",
        )  # fmt: skip
        mark_orders(axis, [dwell.hz for dwell in dwells])
        axis.set_title(name)
        axis.set_xlabel("frequency [Hz], forward whirl positive")
        axis.grid(visible=False)
    bar = figure.colorbar(picture, ax=axes[0].tolist(), label="radius of the circle [µm]")
    bar.set_ticks([-1, 0, 1, 2, 3], labels=["0.1", "1", "10", "100", "1000"])
    axes[0, 0].set_ylabel("shaft speed [Hz]: from below, up and then down")
    return figure


def mark_orders(axis: Any, speeds: list[float]) -> None:
    """Draw the lines of 1X and 2X, forward and backward, and label the rows with their speeds."""
    rows = np.arange(len(speeds))
    for order in (-2, -1, 1, 2):
        inside = np.abs(order * np.array(speeds)) <= LIMIT
        axis.plot(order * np.array(speeds)[inside], rows[inside], color="white", lw=0.5, ls=":")
    chosen = rows[::6]
    axis.set_yticks(chosen, [f"{speeds[row]:g}" for row in chosen])


def poincare(model: Model, run: Stairs) -> Any:
    """Stroboscopic sections of the run-up: the shaft's centre once a turn."""
    figure, axes = panels(1, len(SECTIONS), 12.0, 2.9, sharex=True, sharey=True)
    for axis, hz in zip(axes[0], SECTIONS, strict=True):
        x, y, _, angle = at(run.up, hz).end
        points = once_a_turn(np.unwrap(angle.astype(float)), np.stack([x, y]), np.pi)
        wall(axis, model)
        axis.plot(MICRO * x, MICRO * y, color="#c8d8e8", lw=0.4)
        axis.plot(*(MICRO * points), ".", color=DOWN, ms=4)
        axis.set_title(f"{hz:g} Hz, {points.shape[1]} turns")
        square(axis, 1750.0, labels=False)
        axis.set_xlabel("x [µm]")
    axes[0, 0].set_ylabel("y [µm]")
    return figure


def transitions(runs: Mapping[str, tuple[Dwell, float]]) -> Any:
    """Radius and force while the speed rises to the first one without contact: P3 figures 17 and 18."""
    figure, axes = panels(2, len(runs), 11.0, 4.4, sharex=True)
    for column, (name, (dwell, clearance)) in enumerate(runs.items()):
        x, y, force, _ = dwell.start
        time = np.arange(x.size) / KEPT_RATE
        axes[0, column].plot(time, MICRO * np.hypot(x, y), lw=0.8, color=UP)
        axes[0, column].axhline(MICRO * clearance, color="#333333", lw=0.8, ls="--")
        axes[1, column].plot(time, force, lw=0.8, color=DOWN)
        axes[0, column].set_title(f"{name}: {dwell.hz - 0.5:g} to {dwell.hz:g} Hz at 0 s")
        axes[1, column].set_xlabel("time [s]")
    axes[0, 0].set_ylabel("radius [µm]")
    axes[1, 0].set_ylabel("resultant [N]")
    return figure


def freeing_hit(hit: Hit, title: str) -> Any:
    """A hit that frees the rotor: radius in time, spectra before and after. P2 figures 11a and 12a."""
    figure, axes = panels(1, 2, 11.0, 3.4)
    both = np.concatenate([hit.before, hit.after], axis=1)
    time = (np.arange(both.shape[1]) - hit.before.shape[1]) / KEPT_RATE
    axes[0, 0].plot(time, MICRO * np.hypot(*both[:2]), lw=0.6, color=UP)
    axes[0, 0].axvline(0.0, color=DOWN, lw=1.0)
    axes[0, 0].axhline(1500.0, color="#333333", lw=0.8, ls="--")
    axes[0, 0].set_xlabel("time after the hit [s]")
    axes[0, 0].set_ylabel("radius [µm]")
    axes[0, 0].set_title(title)
    count = hit.before.shape[1] // 2 * 2
    parts = (("before", hit.before[:2, -count:], DOWN), ("after", hit.after[:2, -2000:], UP))
    for name, orbit, colour in parts:
        spectrum = full_spectrum(orbit, KEPT_RATE)
        axes[0, 1].semilogy(spectrum.frequency, MICRO * spectrum.amplitude, color=colour, lw=1.0, label=name)
    axes[0, 1].set_xlim(-60.0, 60.0)
    axes[0, 1].set_ylim(0.1, 2000.0)
    axes[0, 1].set_xlabel("frequency [Hz], forward whirl positive")
    axes[0, 1].set_ylabel("radius of the circle [µm]")
    axes[0, 1].legend()
    return figure


def drop_tests(tests: Mapping[str, DropTest]) -> Any:
    """Force against penetration and in time of the first impact of a drop: P3 figures 11 and 12."""
    figure, axes = panels(1, 2, 10.0, 3.4)
    for (name, test), colour in zip(tests.items(), (DOWN, UP), strict=True):
        label = f"{name}: restitution {test.restitution:.2f} at {test.speed:.2f} m/s"
        axes[0, 0].plot(MICRO * test.penetration, test.force, color=colour, label=label)
        axes[0, 1].plot(1e3 * np.arange(test.force.size) / RATE, test.force, color=colour)
    axes[0, 0].set_xlabel("penetration [µm]")
    axes[0, 0].set_ylabel("contact force [N]")
    axes[0, 1].set_xlabel("time [ms]")
    axes[0, 0].legend()
    return figure
