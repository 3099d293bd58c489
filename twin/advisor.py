"""Which hit of a solenoid frees the rotor from impacts, by a vote of the rigs that the estimate allows.

Where impacts go on at a speed at which the rotor could also run free, a pulse at the right moment takes it
from the one motion to the other. Which pulse does depends on the state at its begin, and so finely on the
parameters that the best pulse of the model most likely to be true frees the true rotor too seldom: see
docs/explanation/advisor.md. Therefore each rig drawn from the estimate's uncertainty runs ahead until
its motion has forgotten how it began, is hit in a revolution of its own, and votes.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from math import tau
from typing import NamedTuple

from daq.rig import Rig, RigError
from simulator.rig import Solenoid
from simulator.simulation import SimulationError
from twin.branches import Branch, Moment
from twin.ensemble import drawn

VOTERS = 16  # rigs drawn
SCOUTS = 2  # of them, that all hits are tried on
FINALISTS = 24  # hits that all rigs vote on
SHARES = (0.3, 0.5, 0.7, 1.0)  # of a solenoid's largest force
LENGTHS = (0.2, 0.4, 0.7, 1.0)  # of its longest pulse
ANGLES = 12  # shaft angles, evenly through the turn
AHEAD = 1.5  # s that a rig runs before it is hit
HORIZON = 1.6  # s after a hit within which the rotor must be free
QUIET = 0.6  # s without contact that count as free
LEAST_VOTE = 0.6  # share of the rigs that a hit must free
LEAST_SPEED = tau  # rad/s below which no hit is looked for: the rotor has no revolution to speak of


class Hit(NamedTuple):
    """A pulse that begins when the shaft comes to an angle."""

    solenoid: str
    force: float  # N, peak
    duration: float  # s
    angle: float  # rad from the encoder's zero, within a turn


class Advice(NamedTuple):
    """What came of a search."""

    hit: Hit | None  # None: no hit helps, or none is needed
    vote: float  # share of the rigs that the best hit frees; 1 when the rotor comes free by itself
    flights: int  # runs of the model that it took

    @property
    def needed(self) -> bool:
        """Whether the rotor stays in impacts without a hit."""
        return self.hit is not None or self.vote < LEAST_VOTE


class Voter:
    """A rig as it may be, at each of `ANGLES` shaft angles of one revolution.

    Args:
        branch: at the estimate.
        rig: for its limits.
    """

    def __init__(self, branch: Branch, rig: Rig) -> None:
        self._branch, self._limits = branch, rig.limits
        branch.run(AHEAD)
        self.free = branch.run(QUIET).quiet >= QUIET
        self._moments = [self._moment_at(angle) for angle in angles()]

    def freed_by(self, hit: Hit, solenoid: Solenoid) -> bool:
        """Tell whether a hit frees this rig and no limit trips meanwhile."""
        branch = self._branch
        branch.back_to(self._moments[round(hit.angle / tau * ANGLES)])
        branch.hit(solenoid, hit.force, hit.duration)
        try:
            peaks = branch.run_until_quiet(QUIET, HORIZON)
        except SimulationError:
            return False
        return peaks.quiet >= QUIET and not peaks.trip(self._limits)

    def _moment_at(self, angle: float) -> Moment:
        self._branch.to_angle(angle)
        return self._branch.moment()


def advise(rig: Rig, values: Mapping[str, float], seed: int = 0) -> Advice:
    """Search for the hit that frees the rotor.

    Args:
        rig: with a model and solenoids.
        values: the newest column of an estimate by row name.
        seed: of the draws; equal arguments give equal advice.

    Raises:
        RigError: the rig has no model or no solenoid, or the rotor does not turn.
    """
    if rig.model is None or not rig.solenoids:
        raise RigError(f"{rig.name} has no {'[[solenoid]]' if rig.model else 'model'}: no hit can be advised")
    if abs(values["speed"]) < LEAST_SPEED:
        raise RigError(f"{rig.name}: the rotor stands still or nearly so: there is nothing to free it from")
    rate = rig.acquisition.rate
    voters = [Voter(Branch(each, rate), rig) for each in drawn(rig.model, values, VOTERS, seed)]
    free = sum(voter.free for voter in voters) / VOTERS
    if free >= LEAST_VOTE:
        return Advice(None, free, 0)
    return vote(rig, voters)


def vote(rig: Rig, voters: Sequence[Voter]) -> Advice:
    """Return the hit that frees most rigs, and is not alone in it; of equals the one with least impulse."""
    hits = list(possible_hits(rig.solenoids))
    scouted = {hit: votes(rig, voters[:SCOUTS], hit) for hit in hits}
    support = {hit: with_neighbours(scouted, hit) for hit in hits}
    finalists = sorted(hits, key=lambda hit: (-support[hit], impulse(hit)))[:FINALISTS]
    final = {hit: scouted[hit] + votes(rig, voters[SCOUTS:], hit) for hit in finalists}
    best = min(finalists, key=lambda hit: (-final[hit] - support[hit] / SCOUTS, impulse(hit)))
    share = final[best] / len(voters)
    flights = len(hits) * SCOUTS + len(finalists) * (len(voters) - SCOUTS)
    return Advice(best if share >= LEAST_VOTE else None, share, flights)


def possible_hits(solenoids: Sequence[Solenoid]) -> Iterator[Hit]:
    """Yield hits of every solenoid within its limits, at every shaft angle."""
    for solenoid, share, length, angle in product(solenoids, SHARES, LENGTHS, angles()):
        yield Hit(solenoid.name, share * solenoid.max_force, length * solenoid.max_duration, angle)


def angles() -> list[float]:
    """Return the shaft angles (rad) at which hits are tried."""
    return [tau * number / ANGLES for number in range(ANGLES)]


def votes(rig: Rig, voters: Sequence[Voter], hit: Hit) -> int:
    """Return how many rigs a hit frees."""
    solenoid = rig.solenoid(hit.solenoid)
    return sum(voter.freed_by(hit, solenoid) for voter in voters)


def with_neighbours(scouted: Mapping[Hit, int], hit: Hit) -> float:
    """Return a hit's votes with half of those at the angles before and behind."""
    turn = angles()
    number = round(hit.angle / tau * ANGLES)
    beside = (hit._replace(angle=turn[(number + step) % ANGLES]) for step in (-1, 1))
    return scouted[hit] + 0.5 * sum(scouted[other] for other in beside)


def impulse(hit: Hit) -> float:
    """Return what orders hits by strength, N s but for a factor."""
    return hit.force * hit.duration
