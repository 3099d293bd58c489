"""Keys of everything on the wire, and the table of what travels under them.

A key is `rig/<rig>/<part>/<topic>`; the recording uses the same keys as its topics.
"""

import re
from enum import StrEnum
from fnmatch import fnmatchcase
from functools import lru_cache
from typing import NamedTuple

ALLOWED = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")


class Delivery(StrEnum):
    """How a topic travels."""

    LOSSLESS = "lossless"
    """Kept in the publisher's cache, so that a late or stopped subscriber recovers what it missed."""
    PLAIN = "plain"
    """Sent once: whoever is not there misses it."""
    QUERY = "query"
    """Answered when asked."""


class Topic(NamedTuple):
    """One row of the service table."""

    pattern: str
    """Key with `*` for the rig and for other variable parts."""
    message: str
    """Name of its message in `messages.proto`; empty when the payload is no message."""
    delivery: Delivery
    cache: int
    """Messages that the publisher keeps for each key (30 s of a series); 0 unless lossless."""
    recorded: bool
    """Whether the recorder subscribes to it."""


TOPICS = (
    Topic("rig/*/daq/block", "Block", Delivery.LOSSLESS, 3000, recorded=True),
    Topic("rig/*/twin/estimate", "Estimate", Delivery.LOSSLESS, 3000, recorded=True),
    Topic("rig/*/twin/smoothed", "Smoothed", Delivery.PLAIN, 0, recorded=False),
    Topic("rig/*/emulator/truth", "Truth", Delivery.LOSSLESS, 3000, recorded=True),
    Topic("rig/*/daq/event", "Event", Delivery.LOSSLESS, 1000, recorded=True),
    Topic("rig/*/twin/event", "Event", Delivery.LOSSLESS, 1000, recorded=True),
    Topic("rig/*/operator/event", "Event", Delivery.LOSSLESS, 1000, recorded=True),
    Topic("rig/*/daq/summary", "Summary", Delivery.LOSSLESS, 3000, recorded=True),
    Topic("rig/*/daq/summary/*", "ChannelSummary", Delivery.LOSSLESS, 300, recorded=True),
    Topic("rig/*/twin/summary", "TwinSummary", Delivery.LOSSLESS, 300, recorded=True),
    Topic("rig/*/*/status", "Status", Delivery.PLAIN, 0, recorded=True),
    Topic("rig/*/daq/lease", "", Delivery.PLAIN, 0, recorded=False),
    Topic("rig/*/daq/description", "Description", Delivery.QUERY, 0, recorded=False),
    Topic("rig/*/daq/command/*", "Command", Delivery.QUERY, 0, recorded=False),
    Topic("rig/*/operator/command/*", "Command", Delivery.QUERY, 0, recorded=False),
)
"""The service table. A query's reply is an `Answer`, of `daq/description` the `Description` itself."""

RECORDED = "recorded"
"""Announced like a process, by a recorder that has everything: one that has only gone may come back."""

SCHEMAS = {topic.pattern: topic.message for topic in TOPICS}
"""Message name of each key pattern."""


@lru_cache(1024)
def topic(key: str) -> Topic:
    """Return the row of the service table for a key.

    Raises:
        KeyError: no topic has this key.
    """
    levels = key.count("/")
    for row in TOPICS:
        if row.pattern.count("/") == levels and fnmatchcase(key, row.pattern):
            return row
    raise KeyError(f"{key!r} is no key of a rig: see daq.keys.TOPICS")


def recorded_keys(rig: str) -> tuple[str, ...]:
    """Return the keys, with wildcards, that the recorder of a rig subscribes to."""
    return tuple(_of_rig(rig, row.pattern) for row in TOPICS if row.recorded)


def everything(rig: str) -> str:
    """Return the expression that matches every key of a rig."""
    return f"rig/{part(rig)}/**"


def block(rig: str) -> str:
    """Return the key of the acquired samples."""
    return f"rig/{part(rig)}/daq/block"


def estimate(rig: str) -> str:
    """Return the key of the twin's states and virtual sensors."""
    return f"rig/{part(rig)}/twin/estimate"


def smoothed(rig: str) -> str:
    """Return the key of the motion with hindsight, which only recordings hold."""
    return f"rig/{part(rig)}/twin/smoothed"


def truth(rig: str) -> str:
    """Return the key of the emulated rig's true state, which the twin never reads."""
    return f"rig/{part(rig)}/emulator/truth"


def event(rig: str, source: str) -> str:
    """Return the key of the events of one source: daq, twin or operator."""
    return f"rig/{part(rig)}/{part(source)}/event"


def summary(rig: str) -> str:
    """Return the key of the block in few numbers."""
    return f"rig/{part(rig)}/daq/summary"


def channel_summary(rig: str, channel: str) -> str:
    """Return the key of one channel in few numbers."""
    return f"rig/{part(rig)}/daq/summary/{part(channel)}"


def twin_summary(rig: str) -> str:
    """Return the key of the twin's findings in few numbers."""
    return f"rig/{part(rig)}/twin/summary"


def status(rig: str, process: str) -> str:
    """Return the key of a process' health; process `*` means all of them."""
    return f"rig/{part(rig)}/{part(process)}/status"


def description(rig: str) -> str:
    """Return the key that answers with the rig's description."""
    return f"rig/{part(rig)}/daq/description"


def command(rig: str, name: str) -> str:
    """Return the key of a command to the daq."""
    return f"rig/{part(rig)}/daq/command/{part(name)}"


def operator_command(rig: str, name: str) -> str:
    """Return the key of a command to the operator, who passes it on under its lease."""
    return f"rig/{part(rig)}/operator/command/{part(name)}"


def lease(rig: str) -> str:
    """Return the key on which the lease holder shows that it lives; the payload is the lease."""
    return f"rig/{part(rig)}/daq/lease"


def alive(rig: str, process: str) -> str:
    """Return the key of the liveliness token of a process; process `*` means all of them."""
    return f"rig/{part(rig)}/{part(process)}/alive"


def process_of(key: str) -> str:
    """Return the part of the rig that a key belongs to: daq, twin, operator, recorder, ..."""
    return key.split("/")[2]


def part(name: str) -> str:
    """Return a name that can stand in a key as one part, or `*` for any.

    Raises:
        ValueError: it cannot.
    """
    if name == "*" or ALLOWED.fullmatch(name):
        return name
    raise ValueError(f"{name!r} cannot be part of a key: use letters, digits, '_', '-' and '.' only")


def _of_rig(rig: str, pattern: str) -> str:
    return pattern.replace("rig/*/", f"rig/{part(rig)}/", 1)
