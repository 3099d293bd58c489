"""One reading of the rig for all published numbers? A scan over what the thesis leaves open.

Open are the net vertical force at rest (given as a coupling force of -12 N), the weak torsional spring of the
pivot (not given), the exact clearance, the contact's stiffness and damping (an interval), and how a
displacement was read. Each reading runs the ball bearing up and down and the pinned bearing up.
"""

from collections.abc import Iterator
from itertools import product
from typing import NamedTuple

from benchmarks.thesis_cache import Job
from benchmarks.thesis_runs import Stairs, changed, levels, stairs
from simulator.rig import Model

UP, DOWN = levels(8.5, 18.0), levels(14.0, 9.0)
PINNED_UP = levels(9.0, 16.0)
COUPLING_FORCES = (-8.0, -10.0, -12.0, -14.0)  # N
PIVOT_STIFFNESSES = (0.0, 2.5)  # N m/rad; 2.5 gives the measured 10.1 Hz
CLEARANCES = (1.45e-3, 1.5e-3, 1.55e-3)  # m
CONTACTS = {  # stiffness N/m^1.5, damping factor s/m
    "published": (8.35e7, 1.45),
    "calibrated": (5.0e7, 2.1),
}
PROBE_SCALES = (1.0, 1.03, 1.07)  # of a displacement as it was read


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
