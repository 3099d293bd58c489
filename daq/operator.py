"""The operator's process: links, loop and orders around `daq.operation.Operation`.

Everything happens in one thread, renewing the lease too: an operator that hangs loses the lease, and the daq
brings the rig to rest. It serves people's commands on the link that it listens on, publishes its events
there, and sends commands and the lease's renewals on a second link, whose loss is noticed sooner.
"""

import queue
import sys
import threading
import time
from collections.abc import Callable
from functools import partial
from typing import TypeVar

from daq import keys
from daq.commands import TAKES
from daq.link import Link, Publisher, Request
from daq.messages_pb2 import Answer, Command, Event, Summary
from daq.operation import Operation
from daq.plan import Plan, load_plan
from daq.rig import Rig, load_rig

RENEWAL = 0.025
"""s between two renewals of the lease."""
STATUS_PERIOD = 0.1
"""s between two statuses."""
CONTROL_LEASE_MS = 200
ANSWER_TIME = 0.5
"""s within which the daq answers a command."""
EVENT_CACHE = keys.topic(keys.event("any", "operator")).cache
QUEUE = 1024
"""Pieces of news that may wait for the loop; what finds no room is dropped, and a command gets no answer."""

News = Callable[[], object]
M = TypeVar("M")


def operate(rig_path: str, plan_name: str | None = None) -> int:
    """Operate a rig until standard input ends or says `stop`; return the exit code.

    Raises:
        RigError, PlanError, LinkError: the rig, the plan or a port cannot be used.
    """
    rig = load_rig(rig_path)
    plan = load_plan(plan_name, rig) if plan_name else None
    news: queue.Queue[News | None] = queue.Queue(QUEUE)
    threading.Thread(target=_await_end, args=(news,), daemon=True).start()
    link = rig.link
    with (
        Link(listen=[link.endpoint("operator")], connect=[link.endpoint("daq")]) as data,
        Link(connect=[link.endpoint("control")], lease_ms=CONTROL_LEASE_MS) as control,
    ):
        _run(rig, plan, data, control, news)
    return 0


def _run(rig: Rig, plan: Plan | None, data: Link, control: Link, news: "queue.Queue[News | None]") -> None:
    """Declare everything, then work through the news until it ends."""
    events = data.publish(keys.event(rig.name, "operator"), cache=EVENT_CACHE)
    operation = Operation(rig, plan, partial(_ask, control, rig.name), events.put)
    data.subscribe(keys.summary(rig.name), _teller(news, Summary.FromString, operation.advance))
    data.subscribe(keys.event(rig.name, "daq"), _teller(news, Event.FromString, operation.heed))
    for name in TAKES:
        data.serve(keys.operator_command(rig.name, name), _server(news, operation, name))
    lease = control.publish(keys.lease(rig.name))
    status = data.publish(keys.status(rig.name, "operator"))
    for each in (data, control):
        each.announce(keys.alive(rig.name, "operator"))
    try:
        _loop(operation, lease, status, news)
    finally:
        operation.end("the operator was ended")


def _loop(
    operation: Operation, lease: Publisher, status: Publisher, news: "queue.Queue[News | None]"
) -> None:
    """Do what the news says; renew the lease and publish the status in between."""
    renewed = reported = time.monotonic()
    cpu = time.process_time()
    while True:
        try:
            tell = news.get(timeout=RENEWAL)
        except queue.Empty:
            tell = _nothing
        if tell is None:
            return
        tell()
        now = time.monotonic()
        if operation.lease and now - renewed >= 0.9 * RENEWAL:
            lease.put(operation.lease.encode())
            renewed = now
        if now - reported >= STATUS_PERIOD:
            used = time.process_time()
            _report(operation, status, (used - cpu) / (now - reported))
            reported, cpu = now, used


def _nothing() -> None:
    """Be the news when there is none."""


def _report(operation: Operation, status: Publisher, cpu: float) -> None:
    """Publish the operator's status."""
    message = operation.status()
    message.monotonic_ns, message.utc_ns = time.monotonic_ns(), time.time_ns()
    message.cpu = cpu
    status.put(message.SerializeToString())


def _ask(control: Link, rig: str, command: Command) -> Answer:
    """Send a command to the daq and return its answer. Raises `LinkError`."""
    payload = control.ask(keys.command(rig, command.name), command.SerializeToString(), ANSWER_TIME)
    return Answer.FromString(payload)


def _answer(operation: Operation, request: Request, name: str) -> None:
    """Serve one request for the command `name`."""
    command = Command.FromString(request.payload)
    command.name = name
    request.reply(operation.serve(command).SerializeToString())


def _server(news: "queue.Queue[News | None]", operation: Operation, name: str) -> Callable[[Request], None]:
    """Return a handler that answers requests for the command `name` in the loop's thread."""
    return lambda request: _offer(news, partial(_answer, operation, request, name))


def _teller(
    news: "queue.Queue[News | None]", parse: Callable[[bytes], M], take: Callable[[M], None]
) -> Callable[[str, bytes], None]:
    """Return a subscriber that hands parsed messages to `take` in the loop's thread."""
    return lambda _key, payload: _offer(news, lambda: take(parse(payload)))


def _offer(news: "queue.Queue[News | None]", item: News) -> None:
    """Add a piece of news if there is room; a link's thread must not wait."""
    try:
        news.put_nowait(item)
    except queue.Full:
        return


def _await_end(news: "queue.Queue[News | None]") -> None:
    """Wait on standard input for its end or the word `stop`."""
    for line in sys.stdin:
        if line.strip() == "stop":
            break
    news.put(None)
