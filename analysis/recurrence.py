"""Whether a motion repeats, by its Poincaré marks: where the shaft's centre is at the end of each turn."""

import numpy as np

FINER = 4  # points of the spectrum in each of its bins


def dispersion(marks: np.ndarray, longest: int) -> float:
    """Return how far marks (n,), complex, are from repeating; NaN when they are not all known.

    It is the median distance between marks p revolutions apart, for the p up to `longest` for which it is
    least: zero for a periodic motion, near the attractor's size for a chaotic one. A motion of two periods
    comes back closely within some revolutions.
    """
    periods = range(1, min(longest, marks.size - 1) + 1)
    apart = [float(np.median(np.abs(marks[p:] - marks[:-p]))) for p in periods]
    return min(apart, default=float("nan"))


def broadband(marks: np.ndarray, lines: int) -> float:
    """Return the share of the power of marks (n,), complex, outside the highest `lines` of their spectrum.

    A motion of one or two periods has a spectrum of lines, a chaotic one is broadband (Moon, Chaotic and
    Fractal Dynamics, 1992). The spectrum is that of the marks without their mean, under a Hann window, whose
    main lobe of four bins counts as one line. 0 where nothing moves, NaN when marks are unknown.
    """
    moving = (marks - np.mean(marks)) * np.hanning(marks.size)
    power = np.abs(np.fft.fft(moving, FINER * marks.size)) ** 2
    whole = float(np.sum(power))
    lobe = np.arange(-2 * FINER, 2 * FINER + 1)
    for _ in range(lines):
        power[(np.argmax(power) + lobe) % power.size] = 0.0
    return float(np.sum(power)) / whole if whole != 0.0 else 0.0
