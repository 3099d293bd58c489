"""How runs look in the picture: colours, names and places of their lines.

One run has the picture to itself. Others, such as forks of it, are drawn into the same views in colours of
their own, with fewer lines and with their label in each name.
"""

from typing import NamedTuple

Colour = tuple[int, int, int]
Lines = dict[str, tuple[tuple[str, ...], tuple[Colour, ...]]]
"""Names and colours of the lines of a plot's part."""
Orbits = dict[str, tuple[Colour, float, float, float]]
"""Colour, half widths of line and dot on the screen, order from back to front."""

MEASURED_X, MEASURED_Y = (86, 180, 233), (240, 190, 70)
TWIN_X, TWIN_Y = (213, 94, 160), (60, 190, 130)
MEASURED, TWIN, COMMAND = MEASURED_X, TWIN_X, (150, 150, 150)
EDGE, RULER, CONTACT = (225, 225, 225), (80, 86, 96), (240, 80, 60)
RESIDUALS = ((86, 180, 233), (240, 190, 70), (60, 190, 130), (213, 94, 160), (170, 140, 240), (200, 200, 200))
BAND_X, BAND_Y = (124, 60, 96), (40, 112, 80)  # of the twin's standard deviation: its colours, darker
BACKGROUND = (16, 18, 22)

FORKS: tuple[tuple[Colour, Colour], ...] = (
    ((255, 120, 40), (140, 90, 255)),
    ((180, 230, 40), (255, 60, 200)),
    ((0, 220, 220), (200, 130, 80)),
)
"""Two colours for each further run in a picture; from the fourth on they come again."""


class Look(NamedTuple):
    """Where a run is drawn, and in which names and colours."""

    place: str
    """Part of the entities' paths, behind that of the view; empty for the run that has the picture."""
    label: str
    """Goes into each name; empty for the run that has the picture."""
    lines: Lines
    orbits: Orbits
    edge: Colour
    contact: Colour

    def path(self, view: str, rest: str = "") -> str:
        """Return the path of an entity in a view."""
        return "/".join(part for part in (view, self.place, rest) if part)

    def named(self, text: str) -> str:
        """Return a text with the run's label before it."""
        return f"{self.label}: {text}" if self.label else text


RUN = Look(
    place="",
    label="",
    lines={
        "displacement/measured": (("x measured", "y measured"), (MEASURED_X, MEASURED_Y)),
        "displacement/twin": (("x twin", "y twin"), (TWIN_X, TWIN_Y)),
        "displacement/band": (
            ("x twin - 1 σ", "y twin - 1 σ", "x twin + 1 σ", "y twin + 1 σ"),
            (BAND_X, BAND_Y, BAND_X, BAND_Y),
        ),
        "force/transducers": (("transducers' resultant",), (MEASURED,)),
        "force/twin": (("twin's contact force",), (TWIN,)),
        "force/band": (("twin - 1 σ", "twin + 1 σ"), (BAND_X, BAND_X)),
        "speed": (("set-point", "speed"), (COMMAND, MEASURED)),
    },
    orbits={"measured": (MEASURED, 1.6, 5.0, 20.0), "twin": (TWIN, 0.8, 3.5, 30.0)},
    edge=EDGE,
    contact=CONTACT,
)
"""The look of the run that has the picture."""


def look_of_fork(number: int, label: str) -> Look:
    """Return the look of another run in the picture, the first of which has the number 0.

    What its sensors read and its contact force are shown; not its twin's path, which lies on the former.
    """
    first, second = FORKS[number % len(FORKS)]
    return Look(
        place=f"fork{number + 1}",
        label=label,
        lines={
            "displacement/measured": (("x", "y"), (first, second)),
            "force/transducers": (("transducers' resultant",), (first,)),
            "force/twin": (("twin's contact force",), (second,)),
            "speed": (("set-point", "speed"), (COMMAND, first)),
        },
        orbits={"measured": (first, 1.6, 5.0, 40.0)},
        edge=first,
        contact=second,
    )
