"""One reading of the rig for all published numbers? A scan over what the thesis leaves open.

Open are the net vertical force at rest (given as a coupling force of -12 N), the weak torsional spring of the
pivot (not given), the exact clearance, the contact's stiffness and damping (an interval), and how a
displacement was read. Each reading runs the ball bearing up and down and the pinned bearing up.
"""

from collections.abc import Iterator, Mapping
from itertools import product
from typing import Any, NamedTuple

from benchmarks.thesis_cache import Job
from benchmarks.thesis_plotting import panels
from benchmarks.thesis_readings import LIMITS, Score, score
from benchmarks.thesis_runs import Stairs, changed, levels, stairs
from simulator.rig import Model

UP, DOWN = levels(8.5, 18.0), levels(14.0, 9.0)
PINNED_UP = levels(9.0, 16.0)
COUPLING_FORCES = (-8.0, -10.0, -12.0, -14.0)  # N
PIVOT_STIFFNESSES = (0.0, 2.5)  # N m/rad; 2.5 gives the measured 10.1 Hz
CLEARANCES = (1.45e-3, 1.5e-3, 1.55e-3)  # m
CONTACTS = {  # stiffness N/m^1.5, damping factor s/m: published means and the ends of their intervals
    "published": (8.35e7, 1.45),
    "soft": (5.0e7, 1.45),
    "damped": (8.35e7, 2.1),
    "calibrated": (5.0e7, 2.1),
}
PROBE_SCALES = (1.0, 1.03, 1.07)  # of a displacement as it was read
SHIPPED = (-12.0, 0.0, 1.5e-3, "calibrated")  # the reading of the rigs thesis-ball and thesis-pinned
SHOWN = 14  # readings in the page's table
COLUMNS = (
    "coupling force [N]", "pivot spring [N m/rad]", "gap [mm]", "contact", "probe scale", "first impact [Hz]",
    "hop [Hz]", "ball: last contact [Hz]", "return [Hz]", "peak force [N]", "pinned: last contact [Hz]",
    "one-pin orbit [Hz]", "met (exactly)",
)  # fmt: skip


class Reading(NamedTuple):
    """One way to read the rig."""

    coupling_force: float
    pivot_stiffness: float
    clearance: float
    contact: str

    def models(self, ball: Model, pinned: Model) -> tuple[Model, Model]:
        """Return both rigs, read this way; the pins keep their own contact."""
        stiffness, damping_factor = CONTACTS[self.contact]
        rotor = {"coupling_force": self.coupling_force, "pivot_stiffness": self.pivot_stiffness}
        contact = {"clearance": self.clearance, "stiffness": stiffness, "damping_factor": damping_factor}
        pins = {"clearance": self.clearance}
        return (
            changed(ball, rotor=rotor, backup_bearing=contact),
            changed(pinned, rotor=rotor, backup_bearing=pins),
        )


class Run(NamedTuple):
    """What a reading does."""

    ball: Stairs
    pinned: Stairs


def readings() -> Iterator[Reading]:
    """Return the readings of the scan."""
    for force, stiffness, clearance, contact in product(
        COUPLING_FORCES, PIVOT_STIFFNESSES, CLEARANCES, CONTACTS
    ):
        if clearance == 1.5e-3 or stiffness == 0.0:
            yield Reading(force, stiffness, clearance, contact)


def read(ball: Model, pinned: Model) -> Run:
    """Run the experiments of one reading."""
    return Run(stairs(ball, UP, DOWN), stairs(pinned, PINNED_UP, []))


def jobs(ball: Model, pinned: Model) -> dict[str, Job]:
    """Return the scan's runs by name."""
    return {str(reading): Job(read, reading.models(ball, pinned)) for reading in readings()}


def scores(found: Mapping[str, Run]) -> dict[tuple[Reading, float], Score]:
    """Return how each reading, with each scale of the probes, meets what is published."""
    result = {}
    for reading in readings():
        run = found[str(reading)]
        for scale in PROBE_SCALES:
            result[reading, scale] = score(run.ball, run.pinned, reading.clearance, scale)
    return result


def page(found: Mapping[str, Run]) -> str:
    """Return the scan's chapter."""
    ranked = sorted(scores(found).items(), key=lambda item: (-item[1].met, -item[1].exact))
    published = Reading(-12.0, 0.0, 1.5e-3, "published")
    shown = [*ranked[:SHOWN], *(item for item in ranked[SHOWN:] if item[0] == (published, 1.0))]
    lines = [f"| {' | '.join(COLUMNS)} |", "|" + "---|" * len(COLUMNS)]
    lines += [line(reading, scale, merit) for (reading, scale), merit in shown]
    return "\n".join(lines) + "\n\n" + conclusion(ranked)


def line(reading: Reading, scale: float, merit: Score) -> str:
    """Return one row of the table."""
    rotor = [f"{reading.coupling_force:g}", f"{reading.pivot_stiffness:g}", f"{1e3 * reading.clearance:g}"]
    differences = [f"{value:+.{0 if abs(value) > 3.0 else 1}f}" for value in merit]
    cells = [*rotor, reading.contact, f"{scale:g}", *differences, f"**{merit.met}** ({merit.exact})"]
    return f"| {' | '.join(cells)} |"


def conclusion(ranked: list[tuple[tuple[Reading, float], Score]]) -> str:
    """Say what the scan comes to."""
    most = ranked[0][1].met
    best = [merit for _, merit in ranked if merit.met == most]
    hop = sum(abs(merit.hop) > LIMITS[1] for merit in best)
    jump = sum(abs(merit.jump) > LIMITS[2] for merit in best)
    (reading, scale), _ = ranked[0]
    kept = f" The first is that of the shipped rigs, with displacements read {scale - 1.0:.0%} too large."
    return (
        f"The best meet {most} of 7; {len(best)} of {len(ranked)} do so. Of these, {hop} miss the hop and "
        f"{jump} the last speed with contact: what makes the hop begin later also makes it last longer."
        + (kept if reading == SHIPPED else "")
    )


def figure(found: Mapping[str, Run]) -> Any:
    """Items met over coupling force and clearance, one panel for each contact; probe scale 1."""
    drawn, axes = panels(1, len(CONTACTS), 11.0, 3.0, sharey=True)
    all_scores = scores(found)
    for axis, contact in zip(axes[0], CONTACTS, strict=True):
        for row, clearance in enumerate(CLEARANCES):
            for column, force in enumerate(COUPLING_FORCES):
                met = all_scores[Reading(force, 0.0, clearance, contact), 1.0].met
                axis.text(column, row, f"{met}", ha="center", va="center", fontsize=11)
                axis.add_patch(tile(column, row, met))
        axis.set_title(f"contact: {contact}")
        axis.set_xticks(range(len(COUPLING_FORCES)), [f"{force:g}" for force in COUPLING_FORCES])
        axis.set_yticks(range(len(CLEARANCES)), [f"{1e3 * clearance:g}" for clearance in CLEARANCES])
        axis.set_xlim(-0.5, len(COUPLING_FORCES) - 0.5)
        axis.set_ylim(-0.5, len(CLEARANCES) - 0.5)
        axis.set_xlabel("coupling force [N]")
        axis.grid(visible=False)
    axes[0, 0].set_ylabel("gap [mm]")
    return drawn


def tile(column: int, row: int, met: int) -> Any:
    """Return a square shaded by the items met."""
    from matplotlib.patches import Rectangle

    shade = 1.0 - met / len(Score._fields)
    return Rectangle(
        (column - 0.5, row - 0.5), 1.0, 1.0, facecolor=(shade, 0.55 + 0.45 * shade, shade), zorder=0
    )
