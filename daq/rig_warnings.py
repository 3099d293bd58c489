"""What is allowed in a rig description and yet deserves a look before the rig turns."""

from datetime import date
from math import inf, tau

from daq.guard import guard_of
from daq.rig import Rig
from daq.rig.channels import Channel
from daq.sensor_check import CONTACT

DIGITAL = ("angle", "count")
"""Quantities of counters, which need no anti-alias filter."""


def warnings(rig: Rig, today: date) -> list[str]:
    """Return one sentence for each doubt about a valid rig."""
    found = [text for channel in rig.channels for text in _of_channel(channel, rig, today)]
    return found + _unwatched(rig) + _unreachable_trips(rig)


def _of_channel(channel: Channel, rig: Rig, today: date) -> list[str]:
    """Return what is doubtful about one channel."""
    found = []
    if channel.due and channel.due < today:
        found.append(f"channel {channel.name}: calibration was due on {channel.due}")
    if not rig.emulated and not channel.anti_alias and channel.quantity not in DIGITAL:
        half = 0.5 * rig.acquisition.rate
        found.append(
            f"channel {channel.name}: no anti-alias filter; vibration above {half:g} Hz will be folded"
        )
    return found


def _unwatched(rig: Rig) -> list[str]:
    """Return the protecting sensors of which nobody would notice that they are open or saturated."""
    guard = guard_of(rig)
    return [
        f"channel {name}: a limit rests on it, but it has no ok: an open sensor would not be noticed"
        for name, trips in zip(guard.sensors.names, guard.sensors.trips, strict=True)
        if trips and rig.channels[name].ok is None and rig.channels[name].quantity != CONTACT
    ]


def _unreachable_trips(rig: Rig) -> list[str]:
    """Return the trip levels beyond what the rig's sensors can read: they would never trip."""
    found = []
    for name, (reach, scale, unit) in _reaches(rig).items():
        trip = getattr(rig.limits, name).trip
        if trip > reach and trip != inf:
            found.append(
                f"limit {name}: trips at {trip * scale:g} {unit}, but its sensors read no more than "
                f"{reach * scale:g} {unit}"
            )
    return found


def _reaches(rig: Rig) -> dict[str, tuple[float, float, str]]:
    """Return for each limit the largest value that one of its channels reads, display scale and unit."""
    station = rig.model.rotor.bearing_station if rig.model else None
    radii = [
        channel.full_scale * (station / channel.station if station and channel.station else 1.0)
        for channel in rig.channels.of_quantity("displacement")
    ]
    forces = [channel.full_scale for channel in rig.channels.of_quantity("force")]
    speeds = [channel.full_scale for channel in rig.channels.of_quantity("speed")]
    return {
        "displacement": (max(radii, default=inf), 1e6, "µm"),
        "force": (max(forces, default=inf), 1.0, "N"),
        "speed": (max(speeds, default=inf), 1 / tau, "Hz"),
    }
