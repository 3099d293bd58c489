"""What others want of the acquisition: one bounded queue that its one thread waits on."""

from collections.abc import Callable, Iterable
from queue import Empty, SimpleQueue
from typing import NamedTuple

from google.protobuf.message import DecodeError

from daq import keys
from daq.commanding.commands import TAKES
from daq.link import Link, Request
from daq.messages_pb2 import Answer, Command

CAPACITY = 64
"""Commands that may wait; a further one is refused."""


class CommandOrder(NamedTuple):
    """A command and where its answer goes."""

    command: Command
    reply: Callable[[Answer], None]


class LeaseOrder(NamedTuple):
    """A sign of life of whoever holds this lease."""

    lease: str


class EndOrder(NamedTuple):
    """The run shall end."""


Order = CommandOrder | LeaseOrder | EndOrder


class Orders:
    """Orders from the link's threads and from the parent process, for one consumer thread."""

    def __init__(self) -> None:
        self._queue: SimpleQueue[Order] = SimpleQueue()

    @property
    def fill(self) -> float:
        """Share of the capacity that is in use, 0 to 1."""
        return min(1.0, self._queue.qsize() / CAPACITY)

    def get(self, timeout: float) -> Order | None:
        """Return the next order as soon as it is there; None when `timeout` (s) is over."""
        try:
            return self._queue.get(timeout=timeout)
        except Empty:
            return None

    def end(self) -> None:
        """Order the end of the run; from any thread or a signal handler."""
        self._queue.put(EndOrder())

    def take_commands(self, link: Link, rig: str, names: Iterable[str] = TAKES) -> None:
        """Serve commands to the rig on a link."""
        for name in names:
            link.serve(keys.command(rig, name), self._receive)

    def hear_holder(self, link: Link, rig: str) -> None:
        """Hear the rig's lease holder on a link."""
        link.subscribe(keys.lease(rig), self._hear)

    def _receive(self, request: Request) -> None:
        def reply(answer: Answer) -> None:
            request.reply(answer.SerializeToString())

        name = request.key.rpartition("/")[2]
        try:
            command = Command.FromString(request.payload)
        except DecodeError:
            reply(Answer(text=f"{request.key} takes a message Command; these bytes are none"))
            return
        if command.name not in ("", name):
            reply(Answer(text=f"{request.key} takes {name}, not {command.name}"))
            return
        command.name = name
        if self._queue.qsize() >= CAPACITY:
            reply(Answer(text=f"{CAPACITY} commands are waiting already: try again"))
            return
        self._queue.put(CommandOrder(command, reply))

    def _hear(self, _key: str, payload: bytes) -> None:
        if self._queue.qsize() < CAPACITY:
            self._queue.put(LeaseOrder(payload.decode(errors="replace")))
