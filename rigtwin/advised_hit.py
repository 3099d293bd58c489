"""The search behind `rigtwin command hit --advised`, in the command's own process."""

from math import degrees
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from daq.rig import Rig
    from twin.advisor import Advice, Hit


def search(rig: "Rig") -> "tuple[Advice, str, int]":
    """Return the advice for a running rig, what to say of it, and the sample of the estimate behind it.

    Raises:
        RigError: the rig has no solenoid or no model, or its rotor does not turn.
        PresentError: its twin gives no estimate.
    """
    from rich.console import Console

    from twin.advisor import advise
    from twin.present import of_running

    with Console(stderr=True).status("searching for the hit that frees the rotor"):
        present = of_running(rig)
        advice = advise(rig, present.values)
    return advice, sentence(advice), present.sample


def arguments(hit: "Hit") -> tuple[dict[str, float], dict[str, str]]:
    """Return the numbers and texts of the command that does a hit."""
    return (
        {"force": hit.force, "duration": hit.duration, "angle": hit.angle},
        {"solenoid": hit.solenoid},
    )


def sentence(advice: "Advice") -> str:
    """Say what was found."""
    if advice.hit is None:
        if advice.needed:
            return f"none helps: the best frees {advice.vote:.0%} of the rigs that the estimate allows"
        return f"none is needed: {advice.vote:.0%} of the rigs that the estimate allows are free without"
    hit = advice.hit
    return (
        f"advised: {hit.solenoid}, {hit.force:g} N for {1e3 * hit.duration:g} ms when the shaft is at "
        f"{degrees(hit.angle):.0f} deg; it frees {advice.vote:.0%} of the rigs that the estimate allows"
    )
