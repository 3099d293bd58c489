"""How often the twin names the regime as it truly is, and whether its confidence is fair.

A hundred motions drawn by seed, and 60 of each kind that mostly fly, lie in the bearing, rub forward and
whirl backward (`tests.twin.regime_cases`), seen by the twin through noisy sensors with contact parameters up
to 20 % off. What a motion truly is follows from the simulated force, path and Lyapunov exponent. The baseline
of an accuracy is that of always naming the most frequent regime; of the Brier score, that of always saying
the accuracy. `--fit` instead prints the logistic regression of chaos on dispersion and divergence over other
draws, to which `analysis.regime.RETURN` and `PARTING` are near. Run
`python -m benchmarks.regime`.
"""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from analysis.recurrence import dispersion, divergence
from analysis.regime import AHEAD, FINEST, LONGEST_RETURN, WINDOW, Regime
from benchmarks.report import Figure, in_processes, parser, show
from tests.twin.regime_accuracy import PLAIN, Naming, accuracy, brier, naming, reliability
from tests.twin.regime_cases import CHAOS, drawn_case, exponent, motion_of, settled, watched_run

DRAWN = range(12000, 12100)
OF_A_KIND = range(12000, 12060)
FITTED = {"any": range(400), "heavy": range(150)}


def drawn() -> list[Naming]:
    """Return what the twin says of the hundred drawn motions."""
    return in_processes(naming, DRAWN)


def plain() -> list[Naming]:
    """Return what the twin says of the kinds whose regime is plain."""
    cases = [(seed, kind) for kind in PLAIN for seed in OF_A_KIND]
    return in_processes(naming, *zip(*cases, strict=True))


def figures(any_kind: Sequence[Naming], plain_kinds: Sequence[Naming]) -> dict[str, Figure]:
    """Return the accuracies and the Brier score."""
    most = max(Counter(each.true for each in any_kind).values()) / len(any_kind)
    score, constant = brier(any_kind)
    found = {
        "regime_accuracy": Figure(100.0 * accuracy(any_kind), "%", 100.0 * most, "the most frequent regime"),
        "regime_brier": Figure(score, "1", constant, "always saying the accuracy"),
    }
    for regime in PLAIN.values():
        of = [each for each in (*any_kind, *plain_kinds) if each.true == regime]
        name = f"regime_{regime.value.replace(' ', '_').replace('-', '_').lower()}"
        found[name] = Figure(100.0 * accuracy(of), "%", 100.0 * most, "the most frequent regime")
    return found


def print_table(any_kind: Sequence[Naming], plain_kinds: Sequence[Naming]) -> None:
    """Print how often each regime was named right, what it was confused with, and the reliability."""
    for regime in Regime:
        of = [each for each in (*any_kind, *plain_kinds) if each.true == regime]
        if of:
            wrong = Counter(each.said.value for each in of if not each.right)
            confused = ", ".join(f"{count} {said}" for said, count in wrong.items())
            print(f"{regime.value:25} {accuracy(of):6.1%} of {len(of):3}  {confused}")
    for each in reliability(any_kind):
        print(f"confidence {each.said:6.1%}: {each.right:6.1%} right of {each.count}")
    print()


def fit() -> None:
    """Fit the log odds of chaos to the logarithms of both measures by Newton's method, and print it."""
    measures, chaotic = [], []
    for case in (drawn_case(seed, kind) for kind, seeds in FITTED.items() for seed in seeds):
        state = settled(case)
        motion = motion_of(watched_run(case, state))
        if 0.002 < float(np.mean(motion.normal > 0.0)) < 0.95:
            turn = motion.angle / (2.0 * np.pi)
            at = np.arange(np.ceil(turn[0]), np.floor(turn[-1]))[-WINDOW:]
            marks = np.interp(at, turn, motion.place) / case.truth.backup_bearing.clearance
            seen = dispersion(marks, LONGEST_RETURN), divergence(marks, AHEAD, FINEST)
            measures.append([*seen, np.e])
            chaotic.append(exponent(case, state) > CHAOS)
    known, yes = np.log(np.maximum(measures, 1e-6)), np.array(chaotic, float)
    weights = np.zeros(3)
    for _ in range(50):
        odds = 1.0 / (1.0 + np.exp(-known @ weights))
        curvature = known.T @ (known * (odds * (1.0 - odds))[:, np.newaxis])
        weights -= np.linalg.solve(curvature + 0.1 * np.eye(3), known.T @ (odds - yes) + 0.1 * weights)
    right = np.mean((known @ weights > 0.0) == chaotic)
    print(f"log odds = {weights[0]:.2f} ln dispersion + {weights[1]:.2f} ln divergence + {weights[2]:.2f}")
    print(f"{right:.1%} right of {yes.size} motions in contact, {int(yes.sum())} of them chaotic")


def main() -> None:
    """Measure and report, or fit."""
    options = parser(__doc__)
    options.add_argument("--fit", action="store_true", help="print the logistic regression of chaos instead")
    chosen = options.parse_args()
    if chosen.fit:
        fit()
        return
    found = drawn(), plain()
    if not chosen.json:
        print_table(*found)
    show(figures(*found), chosen.json)


if __name__ == "__main__":
    main()
