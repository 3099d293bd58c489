"""What the display draws, in plain numbers: series thinned to 500 Hz and the orbit's last revolutions.

`Scene` takes the messages as they come and gives, for each picture, one `Frame`. Nothing here knows a
viewer, a link or a clock: times are sample index over rate.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.messages import Series
from daq.rig import Rig
from twin.display_geometry import Points, project, sensors_of

MICRO = 1e6
HZ = 0.5 / np.pi
BIN = 0.002  # s that one point of a curve stands for
TRAIL_RATE = 2000.0  # Hz of the orbit's points
TRAIL_REVOLUTIONS = 2.0
TRAIL_SHORTEST, TRAIL_LONGEST = 0.1, 1.0  # s
TRAIL_POINTS = 240  # of one orbit as drawn
DRAWN = {"displacement_x", "displacement_y", "contact_force_x", "contact_force_y"}  # rows of an estimate
BANDS = ("displacement_x_sigma", "displacement_y_sigma", "normal_force_sigma")  # likewise, where it has them

Floats = NDArray[np.float64]
Reduction = Callable[[Floats], Floats]


class Curve(NamedTuple):
    """Points of one plot: times (n,) in s, values (n, n_lines); a row of NaN breaks the lines."""

    times: Floats
    values: Floats


class Orbit(NamedTuple):
    """The way of the shaft's centre over the last revolutions, in µm at the bearing's plane."""

    path: Points  # (n, 2), oldest first
    marks: Points  # (m, 2), where the encoder passed its zero


class Contact(NamedTuple):
    """The largest contact force on the rotor in a frame."""

    position: Points  # (2,) µm
    force: Points  # (2,) N


class Doubt(NamedTuple):
    """Where the twin takes the shaft's centre to be now, and the standard deviation of that along x and y."""

    position: Points  # (2,) µm
    sigma: Points  # (2,) µm


class Frame(NamedTuple):
    """All that changed since the frame before."""

    time: float  # s, of the newest sample
    curves: dict[str, Curve]
    orbits: dict[str, Orbit]
    contact: Contact | None
    doubt: Doubt | None


class Numbers(NamedTuple):
    """The state of the rig in few numbers, for the headline."""

    time: float  # s
    speed_hz: float
    radius: float  # µm, largest since the frame before
    force: float  # N, largest resultant of the transducers since the frame before


class Stretches:
    """Columns of one series, collected until they are taken; a skipped index starts a new stretch."""

    def __init__(self, width: int) -> None:
        self.width = width  # columns in a bin
        self.next_index = 0  # after the newest column
        self._step = 1
        self._parts: list[tuple[int, list[NDArray[np.float32]]]] = []

    def add(self, first: int, step: int, columns: NDArray[np.float32]) -> None:
        """Append columns (n_rows, n); column j has the index first + j * step."""
        if first != self.next_index or not self._parts:
            self._parts.append((first, []))
        self._parts[-1][1].append(columns)
        self.next_index = first + columns.shape[1] * step
        self._step = step

    def take(self) -> list[tuple[NDArray[np.int64], NDArray[np.float32]]]:
        """Return the stretches in whole bins: indices (n,) and columns (n_rows, n); keep the rest."""
        taken = []
        for first, pieces in self._parts:
            columns = np.concatenate(pieces, axis=1)
            whole = columns.shape[1] // self.width * self.width
            taken.append((first + self._step * np.arange(whole), columns[:, :whole]))
        if self._parts:
            rest = columns[:, whole:]
            self._parts = [(first + self._step * whole, [rest])] if rest.shape[1] else []
        return taken


class Curves:
    """The curves of one frame, thinned; where samples are missing a row of NaN breaks the lines."""

    def __init__(self) -> None:
        self._parts: dict[str, list[Curve]] = {}
        self._ends: dict[str, float] = {}  # s, of each curve's newest point

    def add(self, name: str, times: Floats, values: Floats, width: int, reduce: Reduction) -> None:
        """Append values (n_lines, n) as one point for each `width` columns."""
        part = Curve(times[::width], reduce(values.reshape(values.shape[0], -1, width)).T)
        parts = self._parts.setdefault(name, [])
        end = self._ends.get(name)
        if end is not None and part.times[0] - end > 1.5 * BIN:
            parts.append(Curve(np.array([end + BIN]), np.full((1, values.shape[0]), np.nan)))
        parts.append(part)
        self._ends[name] = float(part.times[-1])

    def take(self) -> dict[str, Curve]:
        """Return and forget what was appended since the last call."""
        taken = {name: joined(parts) for name, parts in self._parts.items()}
        self._parts = {}
        return taken


class Trail:
    """The last second of the shaft's way, thinned, from which the orbit's last revolutions are cut."""

    def __init__(self) -> None:
        self._times = np.empty(0)
        self._path = np.empty((2, 0))

    def add(self, times: Floats, path: Points) -> None:
        """Append points (2, n) in µm with their times in s."""
        if self._times.size and times.size and times[0] - self._times[-1] > 1.5 * BIN:
            self._times, self._path = np.empty(0), np.empty((2, 0))  # the way across a gap is not known
        times = np.concatenate((self._times, times))
        path = np.concatenate((self._path, path), axis=1)
        recent = np.searchsorted(times, times[-1] - TRAIL_LONGEST) if times.size else 0
        self._times, self._path = times[recent:], path[:, recent:]

    def orbit(self, duration: float, marks: Floats) -> Orbit | None:
        """Return the last `duration` s and the positions at the times `marks` in it; None when empty."""
        if not self._times.size:
            return None
        start = int(np.searchsorted(self._times, self._times[-1] - duration))
        times, path = self._times[start:], self._path[:, start:]
        marks = marks[(marks >= times[0]) & (marks <= times[-1])]
        at_marks = np.column_stack([np.interp(marks, times, row) for row in path])
        thin = -(-times.size // TRAIL_POINTS)
        return Orbit(path[:, ::-thin][:, ::-1].T, at_marks)


class Scene:
    """Turns blocks and estimates into frames.

    `frame()` gives what has arrived since the last call. Measurement and twin need not arrive together.
    """

    def __init__(self, rig: Rig) -> None:
        self.rate = rig.acquisition.rate
        self.sensors = sensors_of(rig)
        self.residuals: dict[str, tuple[int, ...]] = {}  # unit: rows of the estimate
        self.residual_names: dict[str, tuple[str, ...]] = {}
        self.numbers = Numbers(0.0, 0.0, 0.0, 0.0)
        self.shown = 0  # samples taken in
        self.skipped = 0  # samples that never came
        self.next_sample = 0  # index after the newest sample
        self._curves = Curves()
        self._blocks = Stretches(max(1, round(BIN * self.rate)))
        self._estimates: Stretches | None = None
        self._stride = 1
        self._rows: dict[str, int] = {}
        self._trails = {"measured": Trail(), "twin": Trail()}
        self._doubt: Doubt | None = None
        self._marks = np.empty(0)  # s, when the encoder passed its zero
        self._last_angle = (-1, 0.0)  # index and value

    def add_block(self, block: Series) -> None:
        """Take in a block; one that goes back in time is left out."""
        if self.shown:
            if block.first_sample < self.next_sample:
                return
            self.skipped += block.first_sample - self.next_sample
        self.next_sample = block.first_sample + block.samples.shape[1]
        self.shown += block.samples.shape[1]
        self._blocks.add(block.first_sample, 1, block.samples)

    def add_estimate(self, estimate: Series) -> None:
        """Take in an estimate of the twin; one that goes back in time is left out."""
        if self._estimates is None:
            self._estimates = self._learn(estimate)
        if estimate.first_sample >= self._estimates.next_index:
            self._estimates.add(estimate.first_sample, self._stride, estimate.samples)

    def frame(self) -> Frame:
        """Return what has arrived since the last call."""
        for indices, samples in self._blocks.take():
            self._measure(indices, samples)
        contact = None
        for indices, columns in self._estimates.take() if self._estimates else []:
            contact = self._estimate(indices, columns) or contact
        duration = self._trail_duration()
        orbits = {name: trail.orbit(duration, self._marks) for name, trail in self._trails.items()}
        return Frame(
            self.numbers.time,
            self._curves.take(),
            {name: orbit for name, orbit in orbits.items() if orbit is not None},
            contact,
            self._doubt,
        )

    def _learn(self, estimate: Series) -> Stretches:
        """Note where the estimates keep what the display draws; return where to collect them."""
        self._stride = max(1, estimate.stride)
        self._rows = {name: row for row, name in enumerate(estimate.names)}
        for unit in dict.fromkeys(estimate.units):
            names = [
                name
                for name, its_unit in zip(estimate.names, estimate.units, strict=True)
                if name.startswith("residual_") and its_unit == unit
            ]
            if names:
                self.residuals[unit] = tuple(self._rows[name] for name in names)
                self.residual_names[unit] = tuple(name.removeprefix("residual_") for name in names)
        return Stretches(max(1, round(BIN * self.rate / self._stride)))

    def _measure(self, indices: NDArray[np.int64], samples: NDArray[np.float32]) -> None:
        """Add one stretch of measurement to the curves, the orbit and the numbers."""
        if not indices.size:
            return
        width = self._blocks.width
        times = indices / self.rate
        sensors = self.sensors
        radius = force = speed = 0.0
        if sensors.displacement:
            path = MICRO * project(samples, sensors.displacement)
            self._curves.add("displacement/measured", times, path, width, mean)
            self._extend("measured", times, path, 1)
            radius = float(np.sqrt((path**2).sum(axis=0).max()))
        if sensors.force:
            resultant = np.linalg.norm(project(samples, sensors.force), axis=0)
            self._curves.add("force/transducers", times, resultant[np.newaxis], width, largest)
            force = float(resultant.max())
        if sensors.speed is not None:
            rows = [row for row in (sensors.speed_command, sensors.speed) if row is not None]
            self._curves.add("speed", times, HZ * samples[rows].astype(np.float64), width, mean)
            speed = HZ * float(samples[sensors.speed].mean())
        if sensors.angle is not None:
            self._note_turns(indices, samples[sensors.angle])
        self.numbers = Numbers(float(times[-1]), speed, radius, force)

    def _estimate(self, indices: NDArray[np.int64], columns: NDArray[np.float32]) -> Contact | None:
        """Add one stretch of the twin's estimate to the curves and the orbit; return its largest contact."""
        if not indices.size or self._estimates is None:
            return None
        width = self._estimates.width
        times = indices / self.rate
        values = columns.astype(np.float64)
        for unit, rows in self.residuals.items():
            scale = MICRO if unit == "m" else 1.0
            self._curves.add(f"residual/{unit}", times, scale * values[list(rows)], width, largest)
        if not self._rows.keys() >= DRAWN:
            return None
        path = MICRO * values[[self._rows["displacement_x"], self._rows["displacement_y"]]]
        force = values[[self._rows["contact_force_x"], self._rows["contact_force_y"]]]
        resultant = np.linalg.norm(force, axis=0)
        self._curves.add("displacement/twin", times, path, width, mean)
        self._curves.add("force/twin", times, resultant[np.newaxis], width, largest)
        self._extend("twin", times, path, self._stride)
        if self._rows.keys() >= set(BANDS):
            self._add_bands(times, path, resultant, values[[self._rows[name] for name in BANDS]])
        hardest = int(resultant.argmax())
        return Contact(path[:, hardest], force[:, hardest]) if resultant[hardest] > 0.0 else None

    def _add_bands(self, times: Floats, path: Points, force: Floats, sigma: Floats) -> None:
        """Add one standard deviation below and above displacement (2, n) in µm and force (n,) in N.

        `sigma` (3, n) is that of displacement along x and y (m) and of the normal force (N), from which the
        resultant's differs by the friction's share only.
        """
        width = self._estimates.width if self._estimates else 1
        place = MICRO * sigma[:2]
        around = np.concatenate((path - place, path + place))
        self._curves.add("displacement/band", times, around, width, mean)
        limits = np.stack((np.maximum(force - sigma[2], 0.0), force + sigma[2]))
        self._curves.add("force/band", times, limits, width, largest)
        self._doubt = Doubt(path[:, -1], place[:, -1])

    def _extend(self, name: str, times: Floats, path: Points, stride: int) -> None:
        thin = max(1, round(self.rate / stride / TRAIL_RATE))
        self._trails[name].add(times[::thin], path[:, ::thin])

    def _note_turns(self, indices: NDArray[np.int64], angle: NDArray[np.float32]) -> None:
        """Note when the wrapped angle jumped by more than half a turn."""
        index, value = self._last_angle
        before = value if index == indices[0] - 1 else angle[0]
        jumps = np.abs(np.diff(angle, prepend=before)) > np.pi
        marks = np.concatenate((self._marks, indices[jumps] / self.rate))
        self._marks = marks[marks > indices[-1] / self.rate - TRAIL_LONGEST]
        self._last_angle = (int(indices[-1]), float(angle[-1]))

    def _trail_duration(self) -> float:
        """Return how long the drawn trail is: a fixed number of revolutions within bounds."""
        revolutions = TRAIL_REVOLUTIONS / max(abs(self.numbers.speed_hz), 1e-3)
        return float(np.clip(revolutions, TRAIL_SHORTEST, TRAIL_LONGEST))


def mean(bins: Floats) -> Floats:
    """Return the mean of each bin; bins (n_lines, n, width)."""
    return bins.mean(axis=2)


def largest(bins: Floats) -> Floats:
    """Return the value of largest magnitude in each bin, with its sign, so that no peak is lost."""
    at = np.abs(bins).argmax(axis=2)
    return np.take_along_axis(bins, at[..., np.newaxis], axis=2)[..., 0]


def joined(parts: Sequence[Curve]) -> Curve:
    """Join the parts of one curve."""
    times, values = zip(*parts, strict=True)
    return Curve(np.concatenate(times), np.concatenate(values))
