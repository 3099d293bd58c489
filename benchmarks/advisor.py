"""How often the advised hit frees the rotor, beside hits at random, and what search and forecast cost.

Emulated rigs with two solenoids, at drawn speeds from 14 to 15.5 Hz, in impacts; stiffness, damping and
friction of the contact 10 to 20 % and the coupling's force up to 5 % off, unbalance and noise not told. Each
rig gets the advised hit, a second after the estimate, and four hits at random. Run
`python -m benchmarks.advisor`.
"""

import time
from statistics import median
from typing import NamedTuple

import numpy as np

from benchmarks.report import Figure, parser, show
from tests.twin.bouncing import BouncingRig, drawn_hit, drawn_rig
from twin.advisor import advise
from twin.forecast import forecast

SEEDS = range(900, 905)
TRIES = 4
ALLOWED = 5.0  # s that a search may take


class Outcome(NamedTuple):
    """What came of one rig."""

    advised: bool  # a hit was
    freed: bool  # by it
    random: float  # share of hits at random that freed it
    search: float  # s of one core
    forecast: float  # s of one core, for a forecast
    ahead: float  # s that all its runs were ahead, together


def judge(bouncing: BouncingRig, seed: int) -> Outcome:
    """Advise, try, and take the time."""
    begin = time.process_time()
    told = forecast(bouncing.rig, bouncing.values)
    middle = time.process_time()
    advice = advise(bouncing.rig, bouncing.values)
    end = time.process_time()
    bouncing.go(1.0)
    chance = np.random.default_rng(seed)
    random = [bouncing.freed_by(drawn_hit(bouncing.rig.solenoids, chance)) for _ in range(TRIES)]
    return Outcome(
        advice.hit is not None,
        advice.hit is not None and bouncing.freed_by(advice.hit),
        float(np.mean(random)),
        end - middle,
        middle - begin,
        told.rigs * told.seconds,
    )


def outcomes(name: str) -> list[Outcome]:
    """Return what came of all rigs that are in impacts."""
    warm = drawn_rig(name, SEEDS[0])
    advise(warm.rig, warm.values)  # compiles
    found = []
    for seed in SEEDS:
        bouncing = drawn_rig(name, seed)
        if bouncing.is_bouncing():
            found.append(judge(bouncing, seed))
    return found


def main() -> None:
    """Measure and report."""
    options = parser(__doc__).parse_args()
    two, one = outcomes("thesis-ball-two-solenoids"), outcomes("thesis-ball")
    show(
        {
            "freed_by_advice": Figure(
                100.0 * float(np.mean([each.freed for each in two])),
                "%",
                100.0 * float(np.mean([each.random for each in two])),
                f"hits at random, {len(two)} rigs",
            ),
            "advised_with_one_solenoid": Figure(
                100.0 * float(np.mean([each.advised for each in one])),
                "%",
                100.0 * float(np.mean([each.freed for each in one])),
                "of them freed",
            ),
            "search": Figure(median(each.search for each in two), "s", ALLOWED, "what is allowed"),
            "forecast": Figure(
                median(each.forecast for each in two),
                "s",
                two[0].ahead,
                "the time that it foretells, all rigs",
            ),
        },
        options.json,
    )


if __name__ == "__main__":
    main()
