"""The display process: follows a running rig and shows it, in a browser page or in the viewer's window.

It takes what it can get: its subscriptions are lossy, and what is dropped is counted and said. Nothing
waits for it. When the run is over it goes on serving until its standard input ends, so that one can look.
"""

import argparse
import os
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from subprocess import Popen
from threading import Event as Flag
from uuid import uuid4

from daq import keys
from daq.describe import EMULATED, LIVE, REPLAY
from daq.link import Inbox, Link, LinkError, free_ports
from daq.messages import MessageError, read_header
from daq.messages_pb2 import Description, Status
from daq.parent import follow_parent
from daq.ports import as_it_runs
from daq.rig import Rig, load_rig
from twin.display import Screen, canvas
from twin.display_address import Address, Announcement
from twin.display_data import Scene
from twin.show import Show
from twin.viewer import Page, open_window

PROCESS = "display"
PERIOD = 0.1  # s between two pictures: one batch each keeps the viewer's work small
CAPACITY = 2000  # messages that wait for the next picture: 10 s of a run
ANSWER = 0.5  # s that the daq has to describe itself
MODES = (LIVE, EMULATED, REPLAY)


class Service:
    """Follows a rig and draws it until told to stop.

    Args:
        rig: with the ports of its processes.
        link: connected to them.
        screen: for the first run that is seen; it serves already.
        address: of that screen, at which later runs are shown too.
        mode: LIVE, EMULATED or REPLAY; empty to ask the daq.
    """

    def __init__(self, rig: Rig, link: Link, screen: Screen, scene: Scene, address: str, mode: str) -> None:
        self._rig = rig
        self._link = link
        self._screen, self._scene = screen, scene
        self._address = address
        self._mode = mode
        self._run = ""
        self._show = Show(rig, scene, screen, mode or "CONNECTING")
        self._inbox = Inbox(CAPACITY, "drop_oldest")
        self._block, self._estimate = keys.block(rig.name), keys.estimate(rig.name)
        self._clock, self._cpu = time.monotonic(), time.process_time()
        for key in self._show.topics:
            link.subscribe(key, self._inbox)
        self._status = link.publish(keys.status(rig.name, PROCESS))

    def run(self, stop: Flag, window: "Popen[bytes] | None" = None) -> None:
        """Draw what comes, ten times a second, until `stop` is set."""
        self._show.draw()
        while not stop.wait(PERIOD):
            fill = self._inbox.fill
            if self._take_all():
                self._show.draw()
            self._publish_status(fill)
            if window is not None and window.poll():
                print(
                    f"the viewer's window ended with status {window.returncode}; try --view web", flush=True
                )
                window = None
        self._inbox.close()
        self._screen.close()

    def _take_all(self) -> int:
        """Take in what has arrived; return how many messages."""
        count = 0
        while count < CAPACITY and (item := self._inbox.get(0.0)) is not None:
            count += 1
            self._take(*item)
        return count

    def _take(self, key: str, payload: bytes) -> None:
        try:
            _timestamp, run, sample = read_header(payload)
        except MessageError:
            run, sample = "", 0
        if (run != self._run or self._goes_back(sample)) and (key == self._block or not self._run):
            self._begin(run)
        if run == self._run and not (key == self._estimate and self._goes_ahead(sample)):
            self._show.take(key, payload)

    def _goes_back(self, sample: int) -> bool:
        """Tell whether a replay goes on from an earlier sample, as after a seek or in a loop."""
        return self._show.mode == REPLAY and sample < self._scene.next_sample

    def _goes_ahead(self, sample: int) -> bool:
        """Tell whether an estimate is of samples from before a replay went back."""
        return self._show.mode == REPLAY and sample > self._scene.next_sample

    def _begin(self, run: str) -> None:
        """Show another run, or one anew, from now on; the first one has its screen already."""
        if self._run:
            self._scene = Scene(self._rig)
            self._screen = Screen(self._rig, self._scene, canvas(str(uuid4())))
            self._screen.join(self._address)
            self._show = Show(self._rig, self._scene, self._screen, self._mode)
        self._run = run
        self._show.mode = self._mode or self._asked_mode()
        self._screen.name(f"{self._rig.name} {run}")

    def _asked_mode(self) -> str:
        """Return the mode that the daq, or the player in its place, says the run has."""
        try:
            answer = self._link.ask(keys.description(self._rig.name), b"", ANSWER)
        except LinkError:
            return EMULATED if self._rig.emulated else LIVE
        return Description.FromString(answer).mode

    def _publish_status(self, fill: float) -> None:
        now, cpu = time.monotonic(), time.process_time()
        status = Status(
            timestamp=time.time(),
            run=self._run,
            sample=self._scene.next_sample,
            process=PROCESS,
            monotonic_ns=time.monotonic_ns(),
            utc_ns=time.time_ns(),
            state="ended" if self._show.over else "running",
            samples=self._scene.shown,
            lost=self._scene.skipped,
            queue_fill=fill,
            cpu=(cpu - self._cpu) / max(now - self._clock, 1e-9),
        )
        self._clock, self._cpu = now, cpu
        self._status.put(status.SerializeToString())


def show(rig: Rig, view: str, mode: str, grpc_port: int, web_port: int, stop: Flag) -> None:
    """Serve and draw a running rig until `stop` is set.

    Raises:
        ViewerError: a port is taken or the viewer is missing.
        LinkError: the rig's endpoints are malformed.
    """
    grpc_port, web_port = (
        port or other for port, other in zip((grpc_port, web_port), free_ports(2), strict=True)
    )
    with ExitStack() as stack:
        scene = Scene(rig)
        screen = Screen(rig, scene, canvas(str(uuid4())))
        data = screen.serve(grpc_port)
        stack.callback(screen.close)
        page = stack.enter_context(Page(web_port, [data])) if view == "web" else None
        window = open_window([data], stays=True) if view == "native" else None
        url = page.url if page else ""
        stack.enter_context(Announcement(rig.name, Address(os.getpid(), data, url)))
        link = stack.enter_context(
            Link(connect=[rig.link.endpoint(name) for name in ("daq", "twin", "operator")])
        )
        service = Service(rig, link, screen, scene, data, mode)
        link.announce(keys.alive(rig.name, PROCESS))
        print(url or data, flush=True)
        service.run(stop, window)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the display process; return its exit code."""
    options = parser().parse_args(arguments)
    stop = Flag()
    follow_parent(stop.set)
    try:
        rig = as_it_runs(load_rig(options.rig))
        show(rig, options.view, options.mode, options.grpc_port, options.web_port, stop)
    except (ValueError, RuntimeError) as error:
        print(f"display: {error}", file=sys.stderr, flush=True)
        return 2
    return 0


def parser() -> argparse.ArgumentParser:
    """Return the parser of the display's command line."""
    made = argparse.ArgumentParser(prog="python -m twin display", description=__doc__)
    made.add_argument("--rig", required=True, metavar="NAME|PATH", help="rig description, with its ports")
    made.add_argument(
        "--view", choices=("web", "native"), default="web", help="page for a browser, or a window"
    )
    made.add_argument(
        "--mode", choices=MODES, default="", help="what the headline says (default: ask the daq)"
    )
    made.add_argument(
        "--grpc-port", type=int, default=0, metavar="N", help="port for viewers (default: a free one)"
    )
    made.add_argument(
        "--web-port", type=int, default=0, metavar="N", help="port of the page (default: a free one)"
    )
    return made
