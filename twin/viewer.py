"""Runs the rerun program: the page with the viewer for a browser, or the viewer's window. Loopback only.

The rerun library can only serve its page to the whole network, its program can bind to loopback.
"""

import ctypes
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryFile
from types import TracebackType
from typing import Literal, Self
from urllib.parse import quote

from daq.link import free_ports

HOST = "127.0.0.1"
START = 20.0  # s within which the program must serve
FILE_MEMORY = "2GB"  # of a recording that is shown, kept for browsers that come late
PR_SET_PDEATHSIG = 1  # Linux: signal a process when its parent dies

View = Literal["web", "native"]


class ViewerError(RuntimeError):
    """The viewer or its page cannot be started; the message is one line that says what to do."""


def program() -> str:
    """Return the path of the rerun program. Raises `ViewerError`."""
    found = find_spec("rerun_cli")
    folders = (found.submodule_search_locations or []) if found else []
    for folder in folders:
        path = Path(folder) / "rerun"
        if path.is_file():
            return str(path)
    raise ViewerError(
        "the rerun program is missing; install it anew: pip install --force-reinstall rerun-sdk"
    )


class Page:
    """The web viewer, served on loopback until `close` or until this process dies.

    Args:
        port: TCP port of the page.
        sources: addresses of running displays, or files, which then are served through `data_port`.
        data_port: port for the content of files.
    """

    def __init__(self, port: int, sources: Sequence[str], data_port: int | None = None) -> None:
        refuse_taken(port)
        arguments = ["--serve-web", "--bind", HOST, "--web-viewer-port", str(port)]
        address = sources[0]
        if data_port is not None:
            refuse_taken(data_port)
            arguments += ["--port", str(data_port), "--server-memory-limit", FILE_MEMORY]
            address = f"rerun+http://{HOST}:{data_port}/proxy"
        self.url = f"http://{HOST}:{port}/?url={quote(address, safe='')}&theme=dark"
        with TemporaryFile() as words:
            self._process = start([*arguments, *sources], words.fileno())
            try:
                wait_until_served(port, self._process)
            except ViewerError as error:
                self.close()
                words.seek(0)
                said = words.read().decode(errors="replace").strip().splitlines() or ["it said nothing"]
                raise ViewerError(f"{error}: {said[-1]}") from None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def wait(self) -> int:
        """Wait until the page's process ends; return its exit status."""
        return self._process.wait()

    def close(self) -> None:
        """End the page."""
        self._process.terminate()
        self._process.wait()


def look_at(sources: Sequence[str], view: View) -> None:
    """Open the viewer on files of its own or on a running display, and wait for the user."""
    if view == "native":
        open_window(sources, stays=False).wait()
        return
    served = any(source.startswith("rerun") for source in sources)
    page_port, data_port = free_ports(2)
    with Page(page_port, sources, None if served else data_port) as page:
        print(f"open {page.url}\nCtrl-C ends", flush=True)
        page.wait()


def open_window(sources: Sequence[str], *, stays: bool) -> "subprocess.Popen[bytes]":
    """Open the viewer's window on addresses or files; one that `stays` outlives this process."""
    arguments = ["--bind", HOST, "--port", "auto", *sources]
    return start(arguments, subprocess.DEVNULL, stays=stays)


def start(arguments: Sequence[str], output: int, *, stays: bool = False) -> "subprocess.Popen[bytes]":
    """Start the rerun program without its welcome and its questions, apart from the terminal's Ctrl-C."""
    die_with_parent = None if stays or sys.platform != "linux" else _death_signal()
    return subprocess.Popen(
        [program(), *arguments],
        stdin=subprocess.DEVNULL,
        stdout=output,
        stderr=output,
        start_new_session=True,
        env={**os.environ, "RERUN_APP_ONLY": "true", "NO_COLOR": "1"},
        preexec_fn=die_with_parent,
    )


def refuse_taken(port: int) -> None:
    """Raise `ViewerError` when something listens on this port already."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or "a port is 0 to 65535"
            raise ViewerError(f"port {port} on {HOST} cannot be used ({reason}); take another one") from None


def wait_until_served(port: int, process: "subprocess.Popen[bytes] | None" = None) -> None:
    """Return when something accepts connections on a port. Raises `ViewerError`."""
    deadline = time.monotonic() + START
    while time.monotonic() < deadline and (process is None or process.poll() is None):
        with socket.socket() as probe:
            if probe.connect_ex((HOST, port)) == 0:
                return
        time.sleep(0.02)
    raise ViewerError(f"the viewer did not open port {port} on {HOST}")


def _death_signal() -> Callable[[], None]:
    """Return a function that has the process that calls it ended with its parent."""
    prctl = ctypes.CDLL(None).prctl
    return lambda: prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
