"""How the validation's figures look: one style, small files. matplotlib is imported when one is drawn."""

from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

UP, DOWN = "#1f6fb4", "#c8502d"  # run-up, run-down
WALL, GRID = "#333333", "#d9d9d9"
MICRO = 1e6
COLOURS = 96  # of the palette of a picture


def panels(rows: int, columns: int, width: float, height: float, **options: Any) -> tuple[Any, np.ndarray]:
    """Return a figure of `width` by `height` inches and its axes (rows, columns)."""
    try:
        import matplotlib
    except ImportError as error:
        raise SystemExit('the figures need matplotlib: pip install "rigtwin[docs]"') from error
    matplotlib.use("Agg")
    from matplotlib import pyplot

    pyplot.rcParams.update(
        {
            "font.size": 9,
            "axes.titlesize": 9,
            "axes.grid": True,
            "grid.color": GRID,
            "grid.linewidth": 0.6,
            "axes.axisbelow": True,
            "legend.fontsize": 8,
        }
    )
    figure, axes = pyplot.subplots(
        rows, columns, figsize=(width, height), squeeze=False, layout="constrained", **options
    )
    return figure, axes


def save(figure: Any, path: Path) -> None:
    """Write a figure as a PNG with a palette, which is a third of the size."""
    from matplotlib import pyplot
    from PIL import Image

    buffer = BytesIO()
    figure.savefig(buffer, dpi=100)
    pyplot.close(figure)
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.open(buffer).convert("RGB").quantize(COLOURS).save(path, optimize=True)


def ring(axis: Any, clearance: float) -> None:
    """Draw the clearance circle, um."""
    turned = np.linspace(0.0, 2.0 * np.pi, 361)
    axis.plot(MICRO * clearance * np.cos(turned), MICRO * clearance * np.sin(turned), color=WALL, lw=1.0)


def pin_boundary(axis: Any, clearance: float, shaft_radius: float, tip_radius: float) -> None:
    """Draw the boundary that four pins on the diagonals leave to the shaft's centre, um."""
    reach = shaft_radius + tip_radius
    distance = reach + clearance
    for angle in (np.pi / 4, 3 * np.pi / 4, 5 * np.pi / 4, 7 * np.pi / 4):
        half = np.arcsin(distance / np.sqrt(2.0) / reach) - np.pi / 4
        turned = angle + np.pi + np.linspace(-half, half, 61)
        x = distance * np.cos(angle) + reach * np.cos(turned)
        y = distance * np.sin(angle) + reach * np.sin(turned)
        axis.plot(MICRO * x, MICRO * y, color=WALL, lw=1.0)


def square(axis: Any, limit: float, labels: bool = True) -> None:
    """Give an orbit's axes equal scales up to +-`limit` um."""
    axis.set_aspect("equal")
    axis.set_xlim(-limit, limit)
    axis.set_ylim(-limit, limit)
    if labels:
        axis.set_xlabel("x [µm]")
        axis.set_ylabel("y [µm]")
