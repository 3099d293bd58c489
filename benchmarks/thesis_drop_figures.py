"""Figures of the rotor drop over unbalance (P1, C1)."""

from collections.abc import Mapping, Sequence
from math import tau
from typing import Any

import numpy as np

from analysis.orbit import once_a_turn
from analysis.spectrum import full_spectrum
from benchmarks.thesis_plotting import DOWN, MICRO, UP, panels, ring, square
from benchmarks.thesis_runs import KEPT_RATE, Drop

SPEED = 10.0  # Hz


def bifurcation(series: Mapping[str, Sequence[Drop]]) -> Any:
    """What P1's figure 5 shows: y and both velocities where the orbit crosses x = 0, over unbalance."""
    figure, axes = panels(3, len(series), 11.0, 7.0, sharex=True, sharey="row")
    for column, (name, drops) in enumerate(series.items()):
        for drop in drops:
            unbalance = np.full(drop.crossings.shape[1], 1e6 * drop.unbalance)
            for row, scale in enumerate((MICRO, 1.0, 1.0)):
                axes[row, column].plot(unbalance, scale * drop.crossings[row], ".", ms=1.5, color=UP)
        for boundary in (60.0, 280.0):
            for row in range(3):
                axes[row, column].axvline(boundary, color=DOWN, lw=0.8, ls="--")
        axes[0, column].set_title(name)
        axes[2, column].set_xlabel("unbalance [g mm]; dashed: P1's regions I | II | III")
    for row, label in enumerate(("y at x = 0 [µm]", "x velocity [m/s]", "y velocity [m/s]")):
        axes[row, 0].set_ylabel(label)
    return figure


def orbits(drops: Sequence[Drop], clearance: float) -> Any:
    """Orbits after the drop: P1 figures 6 to 10."""
    figure, axes = panels(2, 4, 10.5, 5.4, sharex=True, sharey=True)
    for axis, drop in zip(axes.ravel(), drops, strict=True):
        ring(axis, clearance)
        axis.plot(*(MICRO * drop.start[:, : int(KEPT_RATE)]), color="#e3a48f", lw=0.5, label="first second")
        axis.plot(*(MICRO * drop.end), color=UP, lw=0.5, label="last 4 s of 40")
        axis.set_title(f"U = {1e6 * drop.unbalance:.0f} g mm")
        square(axis, 1700.0, labels=False)
    for axis in axes[:, 0]:
        axis.set_ylabel("y [µm]")
    for axis in axes[1]:
        axis.set_xlabel("x [µm]")
    axes[0, 0].legend(loc="upper center")
    return figure


def spectra(drops: Sequence[Drop]) -> Any:
    """Double-sided spectra: P1 figure 11, C1 figure 5 (their forward whirl is negative)."""
    figure, axes = panels(2, 4, 11.0, 4.6, sharex=True, sharey=True)
    for axis, drop in zip(axes.ravel(), drops, strict=True):
        spectrum = full_spectrum(drop.end, KEPT_RATE)
        axis.semilogy(spectrum.frequency, MICRO * spectrum.amplitude, color=UP, lw=0.7)
        for speed in (-SPEED, SPEED):
            axis.axvline(speed, color=DOWN, lw=0.6, ls=":")
        axis.set_title(f"U = {1e6 * drop.unbalance:.0f} g mm")
        axis.set_xlim(-50.0, 50.0)
        axis.set_ylim(0.1, 3000.0)
    for axis in axes[:, 0]:
        axis.set_ylabel("circle [µm]")
    for axis in axes[1]:
        axis.set_xlabel("frequency [Hz]")
    return figure


def forces(drops: Sequence[Drop]) -> Any:
    """Transducer forces in time: P1 figure 12."""
    figure, axes = panels(2, 4, 11.0, 4.6, sharex=True, sharey=True)
    for axis, drop in zip(axes.ravel(), drops, strict=True):
        time = np.arange(drop.force.shape[1]) / KEPT_RATE
        axis.plot(time, drop.force[1], color="#b0b0b0", lw=0.4, label="vertical")
        axis.plot(time, drop.force[0], color="black", lw=0.4, label="horizontal")
        axis.set_title(f"U = {1e6 * drop.unbalance:.0f} g mm")
    for axis in axes[:, 0]:
        axis.set_ylabel("force [N]")
    for axis in axes[1]:
        axis.set_xlabel("time [s]")
    axes[0, 0].legend(loc="upper right")
    return figure


def poincare(drops: Sequence[Drop], clearance: float) -> Any:
    """Stroboscopic sections after the drop: the shaft's centre once a turn."""
    figure, axes = panels(1, len(drops), 11.0, 3.1, sharex=True, sharey=True)
    for axis, drop in zip(axes[0], drops, strict=True):
        angle = tau * SPEED * np.arange(drop.end.shape[1]) / KEPT_RATE  # it ends after whole turns
        points = once_a_turn(angle, drop.end, np.pi)
        ring(axis, clearance)
        axis.plot(*(MICRO * points), ".", color=UP, ms=3)
        axis.set_title(f"U = {1e6 * drop.unbalance:.0f} g mm")
        square(axis, 1700.0)
    return figure
