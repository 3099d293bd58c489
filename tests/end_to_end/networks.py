"""Two computers' networks joined by a wire that can be cut, on one computer: Linux network namespaces.

A rig's processes listen on and connect to 127.0.0.1 only. So each network has that address, and a rule of the
far one sends what it has for the daq's ports over the wire instead of to itself.
"""

import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from tests.conftest import require

DAQ, CONTROL, TWIN, OPERATOR = PORTS = 7001, 7002, 7003, 7004  # free: nobody else is in these networks
ALONE = ("unshare", "--user", "--map-root-user", "--net")
LOOPBACK = """
echo 1 > /proc/sys/net/ipv4/conf/{wire}/route_localnet
ip link set lo up
ip address delete 127.0.0.1/8 dev lo
ip address add 127.0.0.1/32 dev lo
ip address add {address}/24 dev {wire}
ip link set {wire} up
"""
NEAR = f"""{LOOPBACK.format(wire="near", address="127.77.0.1")}
echo 4096 16384 65536 > /proc/sys/net/ipv4/tcp_wmem  # so that what is sent while it is cut is soon lost
"""
RULE = f"ip rule add pref 10 ipproto tcp dport {DAQ}-{CONTROL} lookup 77\n"
FAR = f"""{LOOPBACK.format(wire="far", address="127.77.0.2")}
echo 1 > /proc/sys/net/ipv4/conf/far/accept_local
{RULE}
ip rule add pref 20 lookup local
ip rule delete pref 0
ip route add 127.0.0.1 dev far src 127.77.0.2 table 77
"""
WIRE = "ip link add near type veth peer name far"


class Networks:
    """The two networks: words that put a command into one of them, and the wire."""

    def __init__(self, near: int, far: int) -> None:
        self.near, self.far = inside(near), inside(far)

    def cut(self) -> None:
        """Let nothing pass from here on; nobody is told."""
        shell(self.near, "ip link set near down")

    def mend(self) -> None:
        """Let everything pass again."""
        shell(self.near, "ip link set near up")


def inside(pid: int) -> tuple[str, ...]:
    """Words before a command that put it into a process' network."""
    return ("nsenter", f"--target={pid}", "--user", "--preserve-credentials", "--net")


def shell(place: tuple[str, ...], script: str) -> None:
    """Run a script in a network; a failure shows what it said."""
    done = subprocess.run([*place, "sh", "-ec", script], capture_output=True, text=True)
    assert done.returncode == 0, f"{script}\n{done.stderr}"


@contextmanager
def holder(*words: str) -> Iterator[int]:
    """Keep a new network as long as a process of it lives, which ends with its input; give that one's id."""
    with subprocess.Popen(
        [*words, "sh", "-c", "echo; exec cat"], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        process.stdout.readline()
        yield process.pid


def refuse_where_impossible() -> None:
    """Skip where the system gives no right to networks; nothing that could be installed would change that."""
    require(shutil.which("unshare") is not None, "unshare, of util-linux,")
    bare = subprocess.run([*ALONE, "true"], capture_output=True, text=True)
    if bare.returncode:
        pytest.skip(f"no right to network namespaces: {bare.stderr.strip()}")
    require(shutil.which("ip") is not None, "ip, of Debian's iproute2,")
    whole = subprocess.run([*ALONE, "sh", "-ec", f"{WIRE}\n{NEAR}{RULE}"], capture_output=True, text=True)
    if whole.returncode:
        pytest.skip(f"no right to wires or rules in network namespaces: {whole.stderr.strip()}")


@contextmanager
def two_networks() -> Iterator[Networks]:
    """Make the two and join them; they go when the last process in them ends."""
    refuse_where_impossible()
    with holder(*ALONE) as near, holder(*inside(near), "unshare", "--net") as far:
        shell(inside(near), f"{WIRE} netns {far}\n{NEAR}")
        shell(inside(far), FAR)
        yield Networks(near, far)
