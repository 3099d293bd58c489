"""The display as a real process, a stand-in for the daq on a real link, and viewers that look at it."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image
from rerun.experimental import ViewerClient

from daq import keys
from daq.link import Link, Publisher, free_ports
from daq.rig import Rig, load_rig, with_ports
from tests.conftest import require
from tests.twin.drawn_run import description
from twin.viewer import HOST, program

PATIENCE = 60.0  # s: bound on every wait
VULKAN = Path("/usr/share/vulkan/icd.d")
CHROMIUM = Path("/usr/bin/chromium")
CHROMIUM_FLAGS = (
    "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
)  # fmt: skip


def rig_on_free_ports() -> Rig:
    """The shipped rig with ports of its own."""
    return with_ports(load_rig("thesis-ball"), free_ports(4))


def wait_until(condition: Callable[[], object], what: str) -> None:
    """Wait until a condition holds."""
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, f"waited {PATIENCE:.0f} s in vain for {what}"
        time.sleep(0.05)


class Display:
    """`python -m twin display` on a rig; killed when the context ends."""

    def __init__(self, rig: Rig, folder: Path, *arguments: object) -> None:
        toml = folder / "rig.toml"
        toml.write_text(rig.toml, encoding="utf-8")
        self.output = folder / "display.out"
        with self.output.open("wb") as output:
            self.process = subprocess.Popen(
                [sys.executable, "-P", "-m", "twin", "display", "--rig", str(toml), *map(str, arguments)],
                stdin=subprocess.PIPE,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    def __enter__(self) -> "Display":
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.communicate()

    def said(self) -> str:
        """All that it printed so far."""
        return self.output.read_text(errors="replace")

    def address(self) -> str:
        """The page's address, once it is served."""
        wait_until(lambda: "http://" in self.said() or self.process.poll() is not None, "the address")
        lines = [line for line in self.said().splitlines() if "http://" in line]
        assert lines, self.said()
        return lines[0]

    def end(self) -> int:
        """Close its standard input and return its exit code."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.stdin = None
        return self.process.wait(PATIENCE)


class Source:
    """Stands where the daq stands on the link, and publishes what it is given."""

    def __init__(self, rig: Rig, run: str = "run", mode: str = "EMULATED") -> None:
        self.link = Link(listen=[rig.link.endpoint("daq")], wait_for_room=True)
        self._rig = rig
        self._publishers: dict[str, Publisher] = {}
        answer = description(rig, run, mode).SerializeToString()
        self.link.serve(keys.description(rig.name), lambda request: request.reply(answer))
        self.statuses: list[bytes] = []
        self.link.subscribe(
            keys.status(rig.name, "display"), lambda _, payload: self.statuses.append(payload)
        )

    def __enter__(self) -> "Source":
        return self

    def __exit__(self, *_: object) -> None:
        self.link.close()

    def wait_for_display(self) -> None:
        """Wait until the display announces itself on this link."""
        wait_until(
            lambda: self.link.alive(keys.alive(self._rig.name, "display")), "the display's announcement"
        )

    def publish(self, messages: Iterable[tuple[str, bytes]], speed: float = 4.0) -> None:
        """Publish at `speed` times real time; wait for the display where the machine is too busy for that."""
        start, blocks = time.monotonic(), 0
        period = self._rig.acquisition.block / self._rig.acquisition.rate / speed
        for key, payload in messages:
            if key not in self._publishers:
                self._publishers[key] = self.link.publish(key, wait=True)
            self._publishers[key].put(payload)
            blocks += key.endswith("/block")
            time.sleep(max(0.0, start + blocks * period - time.monotonic()))


@contextmanager
def headless_viewer(source: str) -> Iterator[tuple[ViewerClient, "subprocess.Popen[bytes]"]]:
    """A native viewer without a window on a file or an address, listening on loopback."""
    require(bool(list(VULKAN.glob("lvp_icd*.json"))), "Debian's mesa-vulkan-drivers")
    (port,) = free_ports(1)
    process = subprocess.Popen(
        [program(), "--headless", "--bind", HOST, "--port", str(port), "--window-size", "1600x1000", source],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "RERUN_APP_ONLY": "true"},
    )
    try:
        yield connected(port), process
    finally:
        process.send_signal(signal.SIGCONT)
        process.kill()
        process.wait()


def connected(port: int) -> ViewerClient:
    """A client of the viewer on this port, once it answers."""
    clients: list[ViewerClient] = []

    def connect() -> bool:
        try:
            client = ViewerClient.connect(f"rerun+http://{HOST}:{port}/proxy")
            client.get_state()
        except (ConnectionError, RuntimeError):
            return False
        clients.append(client)
        return True

    wait_until(connect, "the viewer")
    return clients[0]


def newest_time(client: ViewerClient, recording: int = -1) -> float:
    """The newest time in s that a recording in the viewer holds; -1 before it holds any."""
    recordings = client.get_state().recordings
    lines = [line for line in recordings[recording].timelines if line.name == "time"] if recordings else []
    return lines[0].end / 1e9 if lines and lines[0].end is not None else -1.0


def view_names(client: ViewerClient) -> set[str]:
    """Names of the views that the viewer shows now."""
    return {view.name for view in client.get_state().views}


def complaints(client: ViewerClient) -> list[str]:
    """What views and log of a viewer complain about, the missing graphics card apart."""
    views = [f"{view.name}: {report.summary}" for view in client.get_state().views for report in view.reports]
    logged = [entry.message for entry in client.get_logs() if entry.level == "ERROR"]
    return views + logged


def pixels_of(picture: bytes, colour: tuple[int, int, int], tolerance: int = 30) -> int:
    """How many pixels of a PNG have about this colour."""
    image = np.asarray(Image.open(BytesIO(picture)).convert("RGB")).astype(int)
    return int((np.abs(image - colour).max(axis=2) <= tolerance).sum())


def listening(pids: Iterable[int]) -> set[str]:
    """Addresses (hexadecimal, as /proc/net/tcp has them) on which processes accept connections."""
    inodes = set()
    for pid in pids:
        for entry in list(Path(f"/proc/{pid}/fd").iterdir()):
            target = str(entry.readlink()) if entry.is_symlink() else ""
            if target.startswith("socket:["):
                inodes.add(target[8:-1])
    found = set()
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        for line in Path(table).read_text().splitlines()[1:]:
            words = line.split()
            if words[3] == "0A" and words[9] in inodes:
                found.add(words[1].rpartition(":")[0])
    return found


def family(pid: int) -> list[int]:
    """A process and its children."""
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return [pid, *map(int, children)]
