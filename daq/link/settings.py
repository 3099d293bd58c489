"""What a link is told: endpoints checked, zenoh's settings as plain values, and its errors in plain words."""

import errno
import random
import re
import socket
import sys
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import Any

ENDPOINT = re.compile(r"[a-z][a-z0-9_-]*/[^/\s]+:\d{1,5}([?#].*)?")
RETRY = {"period_init_ms": 50, "period_max_ms": 500, "period_increase_factor": 2.0}
QUEUES = {"data": 16, "data_low": 16}
"""Batches a link holds back for a slow subscriber; with zenoh's 2, healthy subscribers lose blocks."""
OPEN_MS = 2000
"""How long whoever listens at an endpoint may take to show that it speaks zenoh, before it is tried again.
With zenoh's 10 s, a port that another program has holds up everyone who connects to it, and their end."""
PATIENCE_US = 24 * 3600 * 1_000_000
"""How long a waiting publisher stands a subscriber that takes nothing."""
EPHEMERAL_RANGE = Path("/proc/sys/net/ipv4/ip_local_port_range")
HELD = 64
"""Ports that a process holds at most: more than one run takes, fewer than it may open files."""

_held: deque[socket.socket] = deque()


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
        "transport/unicast/open_timeout": OPEN_MS,
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


def is_taken(host: str, port: int) -> bool:
    """Tell whether another process listens on a TCP port of an address of this machine."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            return error.errno == errno.EADDRINUSE
    return False


def free_ports(count: int) -> list[int]:
    """Return free TCP ports on loopback that nobody else is given before they are listened on.

    The system gives them to no outgoing connection, and on Linux this process keeps the newest `HELD` of them
    bound without listening: whoever is to listen may (zenoh, rerun and Python's servers set `SO_REUSEADDR`),
    while another search for free ports, here or in another process, passes them over.

    Raises:
        LinkError: too few are free.
    """
    lowest_ephemeral = 32768
    if EPHEMERAL_RANGE.exists():
        lowest_ephemeral = int(EPHEMERAL_RANGE.read_text().split()[0])
    first = max(1024, lowest_ephemeral - 12_000)
    candidates = random.sample(range(first, lowest_ephemeral), lowest_ephemeral - first)
    ports: list[int] = []
    for port in candidates:
        if len(ports) == count:
            return ports
        if _is_taken_first(port):
            ports.append(port)
    raise LinkError(f"fewer than {count} ports between {first} and {lowest_ephemeral} are free on 127.0.0.1")


def _is_taken_first(port: int) -> bool:
    """Bind a port, and on Linux hold it; return False when another process or this one has it."""
    probe = socket.socket()
    try:
        probe.bind(("127.0.0.1", port))
    except OSError:
        probe.close()
        return False
    if sys.platform == "linux":  # elsewhere nobody else could listen on a port that is held
        # Set now, not before the bind: so who listens may have the port, but not who binds it to hold it.
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        _held.append(probe)
        while len(_held) > HELD:
            _held.popleft().close()
    else:
        probe.close()
    return True
