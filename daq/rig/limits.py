"""The tables `[limits.*]` of a rig description: what warns, what trips, and who has to agree."""

from collections.abc import Mapping
from math import inf, tau
from typing import Annotated, Any, NamedTuple

from daq.rig.channels import ChannelTable
from simulator.validation import Quantity, RigError, nearest, tuple_at

PERSISTENCE = Annotated[float, Quantity("s", 0.0, 10.0, "time above the level before it counts")]
VOTES = Annotated[int, Quantity("1", 1, 16, "measurements that must be above a level together")]
FACTOR = Annotated[float, Quantity("1", 1.0, 3.0, "both levels times this while the resonance is passed")]
BAND = Annotated[tuple[float, float] | None, Quantity("Hz", 0.0, 1e5, "speeds that count as passing it")]
PASSING = Annotated[float, Quantity("s", 0.0, 600.0, "longest stay in the band with raised levels")]


class Limit(NamedTuple):
    """A protection limit in SI units: m, N, rad/s or rad/s2; the band in Hz."""

    warn: float
    trip: float
    persistence: float
    reason: str
    votes: int = 1
    multiplier: float = 1.0
    multiplier_hz: tuple[float, float] | None = None
    multiplier_time: float = 5.0


class DisplacementLimit(NamedTuple):
    """Table `[limits.displacement]`: radius of the shaft's centre at the backup bearing's plane."""

    warn: Annotated[float, Quantity("m", 0.0, 1.0, "radius that warns")]
    trip: Annotated[float, Quantity("m", 1e-7, 1.0, "radius that trips")]
    persistence: PERSISTENCE
    reason: str
    votes: VOTES = 1
    multiplier: FACTOR = 1.0
    multiplier_hz: BAND = None
    multiplier_time: PASSING = 5.0


class ForceLimit(NamedTuple):
    """Table `[limits.force]`: resultant of the force transducers."""

    warn: Annotated[float, Quantity("N", 0.0, 1e7, "force that warns")]
    trip: Annotated[float, Quantity("N", 1e-3, 1e7, "force that trips")]
    persistence: PERSISTENCE
    reason: str
    multiplier: FACTOR = 1.0
    multiplier_hz: BAND = None
    multiplier_time: PASSING = 5.0


class SpeedLimit(NamedTuple):
    """Table `[limits.speed]`: written in Hz."""

    warn: Annotated[float, Quantity("Hz", 0.0, 1e5, "speed that warns")]
    trip: Annotated[float, Quantity("Hz", 1e-3, 1e5, "speed that trips")]
    persistence: PERSISTENCE
    reason: str
    votes: VOTES = 1


class SpeedRateLimit(NamedTuple):
    """Table `[limits.speed_rate]`, which may be missing: change of a measured speed over 20 ms, in Hz/s."""

    warn: Annotated[float, Quantity("Hz/s", 0.0, 1e6, "rate that warns")]
    trip: Annotated[float, Quantity("Hz/s", 1e-3, 1e6, "rate that trips")]
    persistence: PERSISTENCE
    reason: str
    votes: VOTES = 1


class Limits(NamedTuple):
    """Protection limits in SI units; `NO_LIMIT` where the rig has none of that quantity."""

    displacement: Limit
    force: Limit
    speed: Limit
    speed_rate: Limit


NO_LIMIT = Limit(inf, inf, 0.0, "the rig has no channel for it")
KINDS: dict[str, type] = {
    "displacement": DisplacementLimit,
    "force": ForceLimit,
    "speed": SpeedLimit,
    "speed_rate": SpeedRateLimit,
}
IN_HERTZ = ("speed", "speed_rate")
OPTIONAL = ("speed_rate",)


def limits_of(table: Mapping[str, Any], channels: ChannelTable) -> Limits:
    """Read the limits; one may be missing only where the rig has no channel of its quantity.

    Raises `RigError`.
    """
    for name in table:
        if name not in KINDS:
            raise RigError(f"[limits.{name}] is not a limit{nearest(name, KINDS, 'the limits are')}")
    return Limits(**{name: limit_of(table, name, channels) for name in KINDS})


def limit_of(table: Mapping[str, Any], name: str, channels: ChannelTable) -> Limit:
    """Read one limit. Raises `RigError`."""
    if name not in table:
        if channels.of_quantity(name) and name not in OPTIONAL:
            raise RigError(f"table [limits.{name}] is missing, and the rig has {name} channels; protect them")
        return NO_LIMIT
    limit = Limit(**tuple_at(KINDS[name], table[name], f"[limits.{name}]")._asdict())
    if limit.warn > limit.trip:
        raise RigError(
            f"[limits.{name}] warn = {limit.warn:g} is above trip = {limit.trip:g}; warn comes first"
        )
    if (limit.multiplier == 1.0) != (limit.multiplier_hz is None):
        raise RigError(f"[limits.{name}] has only one of multiplier and multiplier_hz; give both, or none")
    scale = tau if name in IN_HERTZ else 1.0
    return limit._replace(warn=scale * limit.warn, trip=scale * limit.trip)
