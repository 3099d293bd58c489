"""Double-sided (full) spectra of orbits: forward whirl at positive, backward at negative frequencies.

The orbit's complex signal x + i y is a sum of circles exp(2 pi i f t): with f > 0 they run with the
coordinates' turn, x towards y, which is the shaft's positive direction. (P1 and C1 plot the opposite sign.)
"""

from typing import NamedTuple

import numpy as np


class FullSpectrum(NamedTuple):
    """Amplitudes of the circles that make up an orbit."""

    frequency: np.ndarray  # (n,) Hz, ascending, negative ones backward
    amplitude: np.ndarray  # (n,) radius of each circle, in the orbit's unit

    def near(self, hz: float) -> float:
        """Amplitude at a frequency: the largest within three bins."""
        bins = 3.0 * (self.frequency[1] - self.frequency[0])
        return float(self.amplitude[np.abs(self.frequency - hz) <= bins].max())


def full_spectrum(orbit: np.ndarray, rate: float) -> FullSpectrum:
    """Return the double-sided spectrum of an `orbit` (2, n) sampled at `rate` Hz.

    A Hann window is applied, and the amplitudes are corrected for it: a circle whose frequency falls on a
    bin shows its radius there. The mean is taken off. Raises ValueError below 16 samples.
    """
    count = orbit.shape[1]
    if count < 16:
        raise ValueError(f"a spectrum needs at least 16 samples, not {count}")
    signal = orbit[0] + 1j * orbit[1]
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(count) / count)
    values = np.fft.fft((signal - np.mean(signal)) * window) / np.sum(window)
    frequency = np.fft.fftfreq(count, 1.0 / rate)
    return FullSpectrum(np.fft.fftshift(frequency), np.abs(np.fft.fftshift(values)))


def cascade(orbits: list[np.ndarray], rate: float, limit: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the spectra of equally long `orbits` up to +-`limit` Hz, one row each: a waterfall.

    The first array is the frequencies (m,), the second the amplitudes (n_orbits, m). Raises ValueError when
    there is no orbit or their lengths differ.
    """
    if len({orbit.shape for orbit in orbits}) != 1:
        raise ValueError("a cascade needs orbits of one length")
    spectra = [full_spectrum(orbit, rate) for orbit in orbits]
    chosen = np.abs(spectra[0].frequency) <= limit
    return spectra[0].frequency[chosen], np.stack([spectrum.amplitude[chosen] for spectrum in spectra])
