"""What a link is told: endpoints checked, zenoh's settings as plain values, and its errors in plain words."""

import random
import re
import socket
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

ENDPOINT = re.compile(r"[a-z][a-z0-9_-]*/[^/\s]+:\d{1,5}([?#].*)?")
RETRY = {"period_init_ms": 50, "period_max_ms": 500, "period_increase_factor": 2.0}
QUEUES = {"data": 16, "data_low": 16}
"""Batches a link holds back for a slow subscriber; with zenoh's 2, healthy subscribers lose blocks."""
PATIENCE_US = 24 * 3600 * 1_000_000
"""How long a waiting publisher stands a subscriber that takes nothing."""
EPHEMERAL_RANGE = Path("/proc/sys/net/ipv4/ip_local_port_range")


class LinkError(RuntimeError):
    """The link cannot do what was asked; the message is one line that says what to do."""


def settings(
    listen: Sequence[str], connect: Sequence[str], lease_ms: int, wait_for_room: bool
) -> dict[str, Any]:
    """Return zenoh's settings, by name, of a link that looks for nobody by itself.

    Raises:
        LinkError: an endpoint is malformed.
    """
    for endpoint in (*listen, *connect):
        if not ENDPOINT.fullmatch(endpoint):
            raise LinkError(f"endpoint {endpoint!r}: expected protocol/host:port, as tcp/127.0.0.1:7447")
    values: dict[str, Any] = {
        "mode": "peer",
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "listen/endpoints": list(listen),
        "connect/endpoints": list(connect),
        "connect/retry": RETRY,
        "open/return_conditions/declares": False,
        "transport/shared_memory/enabled": False,
        "transport/link/tx/lease": lease_ms,
    }
    for queue, size in QUEUES.items():
        values[f"transport/link/tx/queue/size/{queue}"] = size
    if wait_for_room:
        values["transport/link/tx/queue/congestion_control/block/wait_before_close"] = PATIENCE_US
    return values


def reason(error: Exception, listen: Sequence[str], connect: Sequence[str]) -> str:
    """Return one line that says why a session could not be opened, and what to do."""
    text = str(error)
    endpoint = next((each for each in listen if each in text), "")
    if "Address already in use" in text:
        return f"{endpoint} is in use by another process: stop that one or take another port"
    if "Cannot assign requested address" in text:
        return f"{endpoint} is no address of this machine: listen on one of its own, as 127.0.0.1"
    without_places = re.sub(r" at /\S+", "", text).splitlines()[0]
    return f"cannot open the link on {', '.join([*listen, *connect])}: {without_places}"


def free_ports(count: int) -> list[int]:
    """Return TCP ports that are free on loopback now and that the system gives to no outgoing connection."""
    lowest_ephemeral = 32768
    if EPHEMERAL_RANGE.exists():
        lowest_ephemeral = int(EPHEMERAL_RANGE.read_text().split()[0])
    first = max(1024, lowest_ephemeral - 12_000)
    candidates = random.sample(range(first, lowest_ephemeral), lowest_ephemeral - first)
    ports: list[int] = []
    for port in candidates:
        if len(ports) == count:
            return ports
        with socket.socket() as probe, suppress(OSError):
            probe.bind(("127.0.0.1", port))
            ports.append(port)
    raise LinkError(f"fewer than {count} ports between {first} and {lowest_ephemeral} are free on 127.0.0.1")
