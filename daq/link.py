"""The link between processes: publish, subscribe, command and presence over one zenoh session.

This is the only file that touches zenoh. A link never listens or looks around by itself: it listens on
the endpoints it is given and connects, again and again, to those it is given.
"""

import json
import random
import re
import socket
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar

import zenoh
import zenoh.ext

from daq.inbox import Inbox

__all__ = [
    "Declaration",
    "Inbox",
    "Link",
    "LinkError",
    "NoAnswer",
    "NoAnswerInTime",
    "Publisher",
    "Refused",
    "Request",
    "Subscription",
    "free_ports",
]

RETRY = {"period_init_ms": 50, "period_max_ms": 500, "period_increase_factor": 2.0}
DATA_QUEUE = 16
"""Batches a link holds back for a slow subscriber; with zenoh's 2, healthy subscribers lose blocks."""
PATIENCE_US = 24 * 3600 * 1_000_000
"""How long a waiting publisher stands a subscriber that takes nothing."""
HEARTBEAT_S = 0.1
"""Period at which a caching publisher tells its last number, so that a lost last message is noticed."""
REFUSAL = "rigtwin/refusal"
"""Encoding of an error reply that is a refusal, not zenoh's own error."""
EPHEMERAL_RANGE = Path("/proc/sys/net/ipv4/ip_local_port_range")
ENDPOINT = re.compile(r"[a-z][a-z0-9_-]*/[^/\s]+:\d{1,5}([?#].*)?")


class LinkError(RuntimeError):
    """The link cannot do what was asked; the message is one line that says what to do."""


class NoAnswer(LinkError):
    """Nobody serves the key that was asked."""


class NoAnswerInTime(LinkError):
    """Whoever serves the key did not answer before the time was over."""


class Refused(LinkError):
    """The answer to a query is an error."""


class Declaration:
    """Something a link has declared; `close` takes it back."""

    def __init__(self, entity: Any) -> None:
        self._entity = entity

    def close(self) -> None:
        """Take it back; the second time does nothing."""
        entity, self._entity = self._entity, None
        if entity is not None:
            entity.undeclare()


class Publisher(Declaration):
    """Publishes payloads under one key."""

    def put(self, payload: bytes) -> None:
        """Send a payload to whoever subscribes; without `wait`, a subscriber that takes nothing misses it.

        Raises:
            LinkError: publisher or link are closed.
        """
        try:
            self._entity.put(payload)
        except (zenoh.ZError, AttributeError) as error:
            raise LinkError(f"cannot publish: {_first_line(error) if self._entity else 'closed'}") from None


class Subscription(Declaration):
    """Receives what is published under a key."""


class Request:
    """A question to a served key; answer it once with `reply`, on any thread.

    A request that is thrown away unanswered leaves who asked with `NoAnswer`.
    """

    def __init__(self, key: str, payload: bytes, query: zenoh.Query) -> None:
        self.key = key
        self.payload = payload
        self._query = query

    def reply(self, payload: bytes) -> None:
        """Answer; a second answer, or one when who asked has gone, is not sent."""
        try:
            self._query.reply(self.key, payload, express=True)
            self._query.drop()
        except zenoh.ZError:
            return


_Kept = TypeVar("_Kept", bound=Declaration)


class Link:
    """One zenoh session, peer to peer, used as a context manager or closed with `close`.

    Callbacks run on the link's own threads: they must hand on what they get and return.

    Args:
        listen: endpoints to listen on, such as `tcp/127.0.0.1:7447`; empty to listen nowhere.
        connect: endpoints to connect to, retried for ever; those that answer within half a second are
            connected when the constructor returns.
        lease_ms: after this long without a sign of life the other side gives this one up.
        wait_for_room: whether publishers with `wait` bear with slow subscribers without an end.

    Raises:
        LinkError: an endpoint is malformed, taken or not this machine's.
    """

    def __init__(
        self,
        *,
        listen: Sequence[str] = (),
        connect: Sequence[str] = (),
        lease_ms: int = 10_000,
        wait_for_room: bool = False,
    ) -> None:
        for endpoint in (*listen, *connect):
            if not ENDPOINT.fullmatch(endpoint):
                raise LinkError(f"endpoint {endpoint!r}: expected protocol/host:port, as tcp/127.0.0.1:7447")
        self._declarations: list[Declaration] = []
        try:
            self._session = zenoh.open(_configuration(listen, connect, lease_ms, wait_for_room))
        except zenoh.ZError as error:
            raise LinkError(_reason(error, listen, connect)) from None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def publish(self, key: str, *, cache: int = 0, wait: bool = False) -> Publisher:
        """Return a publisher for a key.

        Args:
            key: what to publish under.
            cache: messages kept for subscribers that recover what they missed; 0 for none.
            wait: `put` waits for slow subscribers instead of passing them over. For replay only.
        """
        congestion = zenoh.CongestionControl.BLOCK if wait else zenoh.CongestionControl.DROP
        if not cache:
            entity: Any = self._session.declare_publisher(
                key, congestion_control=congestion, express=not wait
            )
        else:
            entity = zenoh.ext.declare_advanced_publisher(
                self._session,
                key,
                congestion_control=congestion,
                express=not wait,
                cache=zenoh.ext.CacheConfig(cache),
                sample_miss_detection=zenoh.ext.MissDetectionConfig(
                    heartbeat=None, sporadic_heartbeat=HEARTBEAT_S
                ),
                publisher_detection=True,
            )
        return self._keep(Publisher(entity))

    def subscribe(
        self, key: str, inbox: Inbox | Callable[[str, bytes], None], *, recover: bool = False
    ) -> Subscription:
        """Receive what is published under a key, which may hold wildcards.

        Args:
            key: key or key expression.
            inbox: where to put key and payload, or a quick function that takes them.
            recover: fetch what was published before and what was missed from the publishers' caches, so
                that all messages arrive once and in order as long as the caches reach back.
        """
        take = inbox.put if isinstance(inbox, Inbox) else inbox

        def deliver(sample: zenoh.Sample) -> None:
            take(str(sample.key_expr), sample.payload.to_bytes())

        callback = zenoh.handlers.Callback(deliver, indirect=False)
        if not recover:
            entity: Any = self._session.declare_subscriber(key, callback)
        else:
            entity = zenoh.ext.declare_advanced_subscriber(
                self._session,
                key,
                callback,
                history=zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1_000_000),
                recovery=zenoh.ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
            )
        return self._keep(Subscription(entity))

    def serve(self, key: str, handler: Callable[[Request], None]) -> Declaration:
        """Answer queries on exactly this key; any other selector that reaches it is refused.

        The handler may answer at once or hand the request to another thread.
        """

        def receive(query: zenoh.Query) -> None:
            if str(query.selector) != key:
                _refuse(query, f"{query.selector} is not the exact key {key}")
                return
            payload = query.payload
            try:
                handler(Request(key, payload.to_bytes() if payload else b"", query))
            except Exception as error:
                _refuse(query, f"{key} failed: {error}")
                raise

        return self._keep(
            Declaration(
                self._session.declare_queryable(key, zenoh.handlers.Callback(receive, indirect=False))
            )
        )

    def ask(self, key: str, payload: bytes, timeout: float = 0.5) -> bytes:
        """Send a query and return the first answer.

        Args:
            key: the exact key that someone serves.
            payload: what to send.
            timeout: s.

        Raises:
            NoAnswer: nobody serves the key.
            NoAnswerInTime: the one who serves it is stopped, busy or cut off.
            Refused: the answer is an error.
        """
        try:
            replies = self._session.get(key, payload=payload, timeout=timeout, express=True)
            reply = replies.recv()
        except zenoh.ZError as error:
            if self._session.is_closed():
                raise LinkError(f"cannot ask {key}: the link is closed") from None
            raise NoAnswer(f"nobody answers on {key} ({_first_line(error)})") from None
        answer = reply.result
        if isinstance(answer, zenoh.Sample):
            return answer.payload.to_bytes()
        if str(answer.encoding) == REFUSAL:
            raise Refused(answer.payload.to_string())
        raise NoAnswerInTime(f"no answer on {key} within {timeout:g} s")

    def announce(self, key: str) -> Declaration:
        """Show that this process is there until the declaration or the link is closed.

        Whoever sees this already has this link's earlier subscriptions and served keys.
        """
        return self._keep(Declaration(self._session.liveliness().declare_token(key)))

    def watch(self, key: str, callback: Callable[[str, bool], None]) -> Declaration:
        """Call back with (key, whether it is there) for each announcement that matches, now and later."""

        def change(sample: zenoh.Sample) -> None:
            callback(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        subscriber = self._session.liveliness().declare_subscriber(
            key, zenoh.handlers.Callback(change, indirect=False), history=True
        )
        return self._keep(Declaration(subscriber))

    def alive(self, key: str, timeout: float = 0.5) -> set[str]:
        """Return the announced keys that match; who does not answer within `timeout` (s) is left out."""
        replies = self._session.liveliness().get(key, timeout=timeout)
        return {str(reply.ok.key_expr) for reply in replies if reply.ok is not None}

    def close(self) -> None:
        """Take back everything and close the session; the second time does nothing."""
        while self._declarations:
            self._declarations.pop().close()
        self._session.close()

    def _keep(self, declaration: _Kept) -> _Kept:
        self._declarations.append(declaration)
        return declaration


def free_ports(count: int) -> list[int]:
    """Return TCP ports that are free on loopback now and that the system gives to no outgoing connection."""
    lowest_ephemeral = 32768
    if EPHEMERAL_RANGE.exists():
        lowest_ephemeral = int(EPHEMERAL_RANGE.read_text().split()[0])
    candidates = random.sample(range(min(20_000, lowest_ephemeral - 5_000), lowest_ephemeral), 4_000)
    ports: list[int] = []
    for port in candidates:
        if len(ports) == count:
            break
        with socket.socket() as probe:
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue
            ports.append(port)
    return ports


def _configuration(
    listen: Sequence[str], connect: Sequence[str], lease_ms: int, wait_for_room: bool
) -> zenoh.Config:
    settings: dict[str, Any] = {
        "mode": "peer",
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "listen/endpoints": list(listen),
        "connect/endpoints": list(connect),
        "connect/retry": RETRY,
        "transport/shared_memory/enabled": False,
        "transport/link/tx/lease": lease_ms,
        "transport/link/tx/queue/size/data": DATA_QUEUE,
    }
    if wait_for_room:
        settings["transport/link/tx/queue/congestion_control/block/wait_before_close"] = PATIENCE_US
    configuration = zenoh.Config()
    for name, value in settings.items():
        configuration.insert_json5(name, json.dumps(value))
    return configuration


def _reason(error: zenoh.ZError, listen: Sequence[str], connect: Sequence[str]) -> str:
    """Return one line that says why a session could not be opened, and what to do."""
    text = str(error)
    endpoint = next((each for each in listen if each in text), "")
    if "Address already in use" in text:
        return f"{endpoint} is in use by another process: stop that one or take another port"
    if "Cannot assign requested address" in text:
        return f"{endpoint} is no address of this machine: listen on one of its own, as 127.0.0.1"
    return f"cannot open the link on {[*listen, *connect]}: {_first_line(error)}"


def _first_line(error: BaseException) -> str:
    """Return zenoh's message without the places in its source."""
    return re.sub(r" at /\S+", "", str(error)).splitlines()[0]


def _refuse(query: zenoh.Query, text: str) -> None:
    query.reply_err(text, encoding=REFUSAL)
    query.drop()
