"""The operator's process: links, loop and orders around `daq.commanding.operation.Operation`.

Everything happens in one thread, renewing the lease too: an operator that hangs loses the lease, and the daq
brings the rig to rest. It serves people's commands on the link that it listens on, publishes its events
there, and sends commands and the lease's renewals on a second link, whose loss is noticed sooner.
"""

import gc
import time
from collections.abc import Callable
from functools import partial
from queue import Empty, SimpleQueue
from typing import TypeVar
from uuid import uuid4

from google.protobuf.message import DecodeError

from daq import keys
from daq.commanding.commands import TAKES
from daq.commanding.operation import PLANNING, Operation
from daq.commanding.plan import Plan, load_plan
from daq.link import Link, NoAnswer, NoAnswerInTime, Publisher, Request
from daq.messages_pb2 import Answer, Command, Event, Summary
from daq.parent import follow_parent
from daq.ports import as_it_runs
from daq.rig import Rig, load_rig

PROCESS = "operator"
RENEWAL = 0.025
"""s between two renewals of the lease."""
STATUS_PERIOD = 0.1
"""s between two statuses."""
CONTROL_LEASE_MS = 200
"""ms after which a daq that is silent on the control link is given up."""
ANSWER_TIME = 0.5
"""s within which the daq answers a command."""
PATIENCE = 1.0
"""s after which a command without an answer is asked no more; who asked the operator waits 2 s."""
PAUSE = 0.02
"""s between two attempts while nobody is there to answer."""
CAPACITY = 1024
"""Pieces of news that may wait for the loop; what finds no room is dropped, and a command gets no answer."""

M = TypeVar("M")


class News:
    """What happens elsewhere, as functions for the loop's thread to call: a bounded queue with an end."""

    def __init__(self) -> None:
        self._queue: SimpleQueue[Callable[[], object]] = SimpleQueue()
        self.ended = False

    def add(self, tell: Callable[[], object]) -> None:
        """Add a piece of news if there is room; the link's threads must not wait."""
        if self._queue.qsize() < CAPACITY:
            self._queue.put(tell)

    def tell_next(self, timeout: float) -> None:
        """Call the next piece of news, if one comes within `timeout` (s)."""
        try:
            tell = self._queue.get(timeout=timeout)
        except Empty:
            return
        tell()

    def end(self) -> None:
        """Let the loop end, and wake it; from any thread or a signal handler."""
        self.ended = True
        self._queue.put(lambda: None)


def operate(name_or_path: str, plan_name: str | None = None) -> None:
    """Operate a rig until standard input ends.

    Args:
        name_or_path: rig description; without ports in it, those of the running rig are taken.
        plan_name: name or path of the plan to perform; None waits for commands.

    Raises:
        RigError, PlanError, NotRunning, LinkError: rig, plan or ports cannot be used.
    """
    rig = as_it_runs(load_rig(name_or_path))
    plan = load_plan(plan_name, rig) if plan_name else None
    link = rig.link
    with (
        Link(listen=[link.endpoint("operator")], connect=[link.endpoint("daq")]) as data,
        Link(connect=[link.endpoint("control")], lease_ms=CONTROL_LEASE_MS) as control,
    ):
        _run(rig, plan, data, control)


def _run(rig: Rig, plan: Plan | None, data: Link, control: Link) -> None:
    """Declare everything, then work through the news until it ends."""
    news = News()
    event_key = keys.event(rig.name, PROCESS)
    events = data.publish(event_key, cache=keys.topic(event_key).cache)
    status = data.publish(keys.status(rig.name, PROCESS))
    lease = control.publish(keys.lease(rig.name))
    operation = Operation(rig, plan, partial(_ask, control, rig.name), events.put)
    data.subscribe(keys.summary(rig.name), _teller(news, Summary.FromString, operation.advance))
    data.subscribe(keys.event(rig.name, "daq"), _teller(news, Event.FromString, operation.heed))
    for name in (*TAKES, *PLANNING):
        data.serve(keys.operator_command(rig.name, name), _server(news, operation, name))
    follow_parent(news.end)
    for each in (data, control):
        each.announce(keys.alive(rig.name, PROCESS))
    gc.collect()
    gc.freeze()
    try:
        _loop(operation, news, lease, status)
    finally:
        operation.end("the operator was told to end" if news.ended else "the operator failed")


def _loop(operation: Operation, news: News, lease: Publisher, status: Publisher) -> None:
    """Do what the news says; renew the lease and publish the status in between."""
    renewed = reported = time.monotonic()
    cpu = time.process_time()
    while not news.ended:
        news.tell_next(max(0.001, renewed + RENEWAL - time.monotonic()))
        now = time.monotonic()
        if now - renewed >= RENEWAL:
            renewed = now
            if operation.lease:
                lease.put(operation.lease.encode())
        if now - reported >= STATUS_PERIOD:
            used = time.process_time()
            _report(operation, status, (used - cpu) / (now - reported))
            reported, cpu = now, used


def _report(operation: Operation, status: Publisher, cpu: float) -> None:
    """Publish the operator's status."""
    message = operation.status()
    message.monotonic_ns, message.utc_ns = time.monotonic_ns(), time.time_ns()
    message.cpu = cpu
    status.put(message.SerializeToString())


def _ask(control: Link, rig: str, command: Command) -> Answer:
    """Send a command to the daq and return its answer. Raises `LinkError`.

    After this process was stopped its link may have to connect anew: what got no answer is asked again, under
    one id, which the daq performs once.
    """
    command.id = uuid4().hex
    key, request = keys.command(rig, command.name), command.SerializeToString()
    deadline = time.monotonic() + PATIENCE
    while True:
        try:
            return Answer.FromString(control.ask(key, request, ANSWER_TIME))
        except (NoAnswer, NoAnswerInTime):
            if time.monotonic() >= deadline:
                raise
            time.sleep(PAUSE)


def _server(news: News, operation: Operation, name: str) -> Callable[[Request], None]:
    """Return a handler that answers requests for the command `name` in the loop's thread."""
    return lambda request: news.add(partial(_answer, operation, request, name))


def _answer(operation: Operation, request: Request, name: str) -> None:
    """Serve one request for the command `name`."""
    try:
        command = Command.FromString(request.payload)
    except DecodeError:
        answer = Answer(text=f"{request.key} takes a message Command; these bytes are none")
    else:
        command.name = name
        answer = operation.serve(command)
    request.reply(answer.SerializeToString())


def _teller(
    news: News, parse: Callable[[bytes], M], take: Callable[[M], None]
) -> Callable[[str, bytes], None]:
    """Return a subscriber that hands parsed messages to `take` in the loop's thread."""
    return lambda _key, payload: news.add(lambda: take(parse(payload)))
