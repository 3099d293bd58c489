"""The link between processes: publish, subscribe, command and presence over one zenoh session.

This is the only file that touches zenoh. A link never looks around by itself: it listens on the endpoints
it is given, and on no others, and connects, again and again, to those it is given.

Messages of a publisher with a cache are recovered by `daq.link.recovery`, not by zenoh's advanced publisher:
while that one answers a slow or stopped subscriber, its `put` waits (5 s measured), and `put` is called by
the thread that protects the rig.
"""

import ctypes
import json
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from threading import local
from types import TracebackType
from typing import Any, Self, TypeVar

import zenoh

from daq.link.heartbeat import Heartbeat
from daq.link.inbox import Inbox
from daq.link.recovery import STAMP, Cache, Recovery, Stamp, is_whole, range_of, stamp_of
from daq.link.settings import LinkError, reason, settings

HEARTBEAT_S = 0.25
"""Period at which a link tells the newest numbers of its caching publishers."""
FETCH_TIMEOUT_S = 0.5
SETTLING_S = 0.3
"""A new link may be connected and not yet know what the others serve; for so long it asks them again."""
ASK_AGAIN_S = 0.005
RECOVER = "@recover"
"""Part of the keys between a recovering subscription and a caching publisher; no wildcard matches it."""
REFUSAL = "rigtwin/refusal"
"""Encoding of an error reply that is a refusal, not zenoh's own error."""

_UNPACK: Callable[[bytes], Stamp] = STAMP.unpack
_Receive = Callable[[zenoh.Sample], None]
_thread = local()


class NoAnswer(LinkError):
    """Nobody serves the key that was asked."""


class NoAnswerInTime(LinkError):
    """Whoever serves the key did not answer before the time was over."""


class Refused(LinkError):
    """The answer to a query is an error."""


class Declaration:
    """Something a link has declared; `close` takes it back."""

    def __init__(self, *entities: Any) -> None:
        self._entities = entities

    @property
    def closed(self) -> bool:
        """Whether it was taken back."""
        return not self._entities

    def close(self) -> None:
        """Take it back; the second time does nothing."""
        entities, self._entities = self._entities, ()
        for entity in entities:
            entity.undeclare()


class Publisher(Declaration):
    """Publishes payloads under one key; used by one thread."""

    def put(self, payload: bytes) -> None:
        """Send a payload to whoever subscribes.

        Raises:
            LinkError: publisher or link are closed.
        """
        self._send(payload, stamp_of(payload))

    def _send(self, payload: bytes, stamp: Stamp) -> None:
        try:
            self._entities[0].put(payload, attachment=STAMP.pack(*stamp))
        except (zenoh.ZError, IndexError):
            raise LinkError("cannot publish: publisher or link are closed") from None

    @property
    def has_subscribers(self) -> bool:
        """Whether anybody subscribes to the key now."""
        return not self.closed and bool(self._entities[0].matching_status.matching)


class CachingPublisher(Publisher):
    """Publishes payloads and keeps the newest for subscriptions that recover."""

    def __init__(self, cache: Cache, publisher: Any, heartbeat: Any, supply: Any) -> None:
        super().__init__(publisher, heartbeat, supply)
        self._cache = cache

    def put(self, payload: bytes) -> None:
        """Keep a payload and send it to whoever subscribes; never waits for anybody.

        Raises:
            LinkError: publisher or link are closed.
        """
        stamp = self._cache.stamp(payload)
        self._send(payload, stamp)
        self._cache.keep(payload, stamp)

    def beat(self) -> None:
        """Tell the newest number, if there is one."""
        number = self._cache.newest
        if number >= 0:
            with suppress(zenoh.ZError, IndexError):
                self._entities[1].put(b"", attachment=STAMP.pack(self._cache.publisher, number, 0))


class Subscription(Declaration):
    """Receives what is published under a key."""

    def __init__(self) -> None:
        super().__init__()
        self._abandoned = False

    def is_abandoned(self) -> bool:
        """Tell whether nothing more is to be received."""
        return self._abandoned

    def hold(self, *entities: Any) -> None:
        """Close these with the subscription."""
        self._entities = entities

    def close(self) -> None:
        """Receive nothing more; a callback that waits for room in an inbox goes on without it."""
        self._abandoned = True
        super().close()


class Request:
    """A question to a served key; answer it once with `reply`, on any thread.

    A request that is thrown away unanswered leaves who asked with `NoAnswer`.
    """

    def __init__(self, key: str, payload: bytes, query: zenoh.Query) -> None:
        self.key = key
        self.payload = payload
        self._query = query

    def reply(self, payload: bytes) -> None:
        """Answer; a second answer, or one to somebody who has gone, is not sent."""
        with suppress(zenoh.ZError):
            self._query.reply(self.key, payload)
            self._query.drop()


_Kept = TypeVar("_Kept", bound=Declaration)


class Link:
    """One zenoh session, peer to peer; a context manager, or closed with `close`.

    Callbacks run on the link's own threads: they must hand on what they get and return.

    Args:
        listen: endpoints to listen on, such as `tcp/127.0.0.1:7447`; empty to listen nowhere.
        connect: endpoints to connect to, retried for ever; those that answer within half a second are
            connected when the constructor returns.
        lease_ms: after this long without a sign of life the other side gives this one up.
        wait_for_room: whether publishers may wait for slow subscribers.

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
        configuration = zenoh.Config()
        for name, value in settings(listen, connect, lease_ms, wait_for_room).items():
            configuration.insert_json5(name, json.dumps(value))
        self._settled = time.monotonic() + (SETTLING_S if connect else 0.0)
        self._wait_for_room = wait_for_room
        self._declarations: list[Declaration] = []
        self._heart = Heartbeat(HEARTBEAT_S)
        try:
            self._session = zenoh.open(configuration)
        except zenoh.ZError as error:
            raise LinkError(reason(error, listen, connect)) from None

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
            cache: messages kept for subscriptions that recover what they missed; 0 for none.
            wait: `put` waits for slow subscribers, so that they need no cache, instead of passing them
                over. For replay only; the link must be made with `wait_for_room`.
        """
        if wait and (cache or not self._wait_for_room):
            raise ValueError("a publisher that waits has no cache and needs Link(wait_for_room=True)")
        congestion = zenoh.CongestionControl.BLOCK if wait else zenoh.CongestionControl.DROP
        publisher = self._session.declare_publisher(key, congestion_control=congestion, express=not wait)
        if not cache:
            return self._keep(Publisher(publisher))
        kept = Cache(cache)
        recover_key = _recover_key(key, kept.publisher)

        def supply(query: zenoh.Query) -> None:
            _keep_thread_state()
            wanted = query.payload
            query.reply(recover_key, kept.pack(wanted.to_bytes() if wanted else b""))
            query.drop()

        caching = CachingPublisher(
            kept,
            publisher,
            self._session.declare_publisher(recover_key, congestion_control=zenoh.CongestionControl.DROP),
            self._session.declare_queryable(recover_key, zenoh.handlers.Callback(supply, indirect=False)),
        )
        self._heart.add(caching.beat)
        return self._keep(caching)

    def subscribe(
        self, key: str, inbox: Inbox | Callable[[str, bytes], None], *, recover: bool = False
    ) -> Subscription:
        """Receive what is published under a key, which may hold wildcards.

        Args:
            key: key or key expression.
            inbox: where to put key and payload, or a quick function that takes them.
            recover: also get, in order and once, what publishers with a cache published before and what
                was missed, as far as their caches reach back. Needs an inbox.
        """
        subscription = Subscription()
        if not isinstance(inbox, Inbox):
            if recover:
                raise ValueError(
                    "a subscription that recovers needs an Inbox: its consumer does the fetching"
                )
            subscription.hold(self._subscriber(key, _hand_over(inbox)))
        elif recover:
            recovery = Recovery(self._fetch)
            subscription.hold(
                self._subscriber(key, _offer(key, inbox, subscription, recovery)),
                self._subscriber(f"{key}/{RECOVER}/*", _offer_newest(inbox, recovery)),
            )
        else:
            subscription.hold(self._subscriber(key, _put(inbox, subscription)))
        return self._keep(subscription)

    def serve(self, key: str, handler: Callable[[Request], None]) -> Declaration:
        """Answer queries on exactly this key; any other selector that reaches it is refused.

        The handler may answer at once or hand the request to another thread.
        """

        def receive(query: zenoh.Query) -> None:
            _keep_thread_state()
            if str(query.selector) != key:
                _refuse(query, f"{query.selector} is not the exact key {key}")
                return
            payload = query.payload
            try:
                handler(Request(key, payload.to_bytes() if payload else b"", query))
            except Exception as error:
                _refuse(query, f"{key} failed: {error}")
                raise

        queryable = self._session.declare_queryable(key, zenoh.handlers.Callback(receive, indirect=False))
        return self._keep(Declaration(queryable))

    def ask(self, key: str, payload: bytes, timeout: float = 0.5) -> bytes:
        """Send a query and return the first answer.

        A link that was opened less than 0.3 s ago asks again before it says that nobody serves the key.

        Args:
            key: the exact key that someone serves.
            payload: what to send.
            timeout: s.

        Raises:
            NoAnswer: nobody serves the key.
            NoAnswerInTime: whoever serves it is stopped, busy or cut off.
            Refused: the answer is an error.
            LinkError: the link is closed.
        """
        while True:
            try:
                return self._ask(key, payload, timeout, express=True)
            except NoAnswer:
                if time.monotonic() > self._settled:
                    raise
                time.sleep(ASK_AGAIN_S)

    def announce(self, key: str) -> Declaration:
        """Show that this process is there until the declaration or the link is closed, or the process dies.

        Whoever sees this already knows what this link has subscribed to and served before.
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
        self._heart.stop()
        while self._declarations:
            self._declarations.pop().close()
        self._session.close()

    def _keep(self, declaration: _Kept) -> _Kept:
        self._declarations.append(declaration)
        return declaration

    def _subscriber(self, key: str, receive: _Receive) -> Any:
        return self._session.declare_subscriber(key, zenoh.handlers.Callback(receive, indirect=False))

    def _fetch(self, key: str, publisher: int, first: int, end: int) -> bytes | None:
        """Ask a caching publisher for messages without ever holding it up."""
        try:
            return self._ask(
                _recover_key(key, publisher),
                range_of(first, end),
                FETCH_TIMEOUT_S,
                congestion_control=zenoh.CongestionControl.DROP,
                priority=zenoh.Priority.DATA_LOW,
            )
        except LinkError:
            return None

    def _ask(self, key: str, payload: bytes, timeout: float, **quality: Any) -> bytes:
        try:
            reply = self._session.get(key, payload=payload, timeout=timeout, **quality).recv()
        except zenoh.ZError:
            if self._session.is_closed():
                raise LinkError(f"cannot ask {key}: the link is closed") from None
            raise NoAnswer(f"nobody answers on {key}") from None
        answer = reply.result
        if isinstance(answer, zenoh.Sample):
            return answer.payload.to_bytes()
        if str(answer.encoding) == REFUSAL:
            raise Refused(answer.payload.to_string())
        raise NoAnswerInTime(f"no answer on {key} within {timeout:g} s")


def _hand_over(take: Callable[[str, bytes], None]) -> _Receive:
    """Return a callback that calls a user's function with each message that is whole."""

    def receive(sample: zenoh.Sample) -> None:
        _keep_thread_state()
        payload = sample.payload.to_bytes()
        stamp = _stamp(sample)
        if stamp is None or is_whole(payload, stamp):
            take(str(sample.key_expr), payload)

    return receive


def _put(inbox: Inbox, subscription: Subscription) -> _Receive:
    """Return a callback that puts each message into an inbox, and waits for room if its publisher does."""

    def receive(sample: zenoh.Sample) -> None:
        _keep_thread_state()
        _put_whole(sample, _stamp(sample), inbox, subscription)

    return receive


def _put_whole(sample: zenoh.Sample, stamp: Stamp | None, inbox: Inbox, subscription: Subscription) -> None:
    """Put a message into an inbox; count it as dropped if it is not what was published under this stamp."""
    payload = sample.payload.to_bytes()
    if stamp is not None and not is_whole(payload, stamp):
        inbox.count_drop()
    elif sample.congestion_control == zenoh.CongestionControl.BLOCK:
        inbox.put(str(sample.key_expr), payload, subscription.is_abandoned)
    else:
        inbox.offer(str(sample.key_expr), payload)


def _offer(key: str, inbox: Inbox, subscription: Subscription, recovery: Recovery) -> _Receive:
    """Return a callback that offers messages that a cache holds to an inbox, and puts all others."""
    only_key = None if "*" in key else key

    def receive(sample: zenoh.Sample) -> None:
        _keep_thread_state()
        stamp = _stamp(sample)
        if stamp is None or not stamp[0]:
            _put_whole(sample, stamp, inbox, subscription)
        else:
            inbox.offer(only_key or str(sample.key_expr), sample.payload.to_bytes(), stamp, recovery)

    return receive


def _offer_newest(inbox: Inbox, recovery: Recovery) -> _Receive:
    """Return a callback that offers the newest number of a publisher to an inbox."""

    def receive(sample: zenoh.Sample) -> None:
        _keep_thread_state()
        stamp = _stamp(sample)
        if stamp is not None:
            inbox.offer(str(sample.key_expr).split(f"/{RECOVER}/")[0], None, stamp, recovery)

    return receive


def _stamp(sample: zenoh.Sample) -> Stamp | None:
    """Return what came along with a message; None when its publisher is not one of ours."""
    attachment = sample.attachment
    if attachment is None:
        return None
    content = attachment.to_bytes()
    return _UNPACK(content) if len(content) == STAMP.size else None


def _keep_thread_state() -> None:
    """Let a thread of zenoh's keep its Python state between callbacks.

    CPython makes and frees such a state, with memory from the system, for each callback on a thread that
    is not Python's: a third of a block's latency.
    """
    try:
        _thread.kept  # noqa: B018
    except AttributeError:
        _thread.kept = True
        ctypes.pythonapi.PyGILState_Ensure()


def _recover_key(key: str, publisher: int) -> str:
    return f"{key}/{RECOVER}/{publisher:016x}"


def _refuse(query: zenoh.Query, text: str) -> None:
    query.reply_err(text, encoding=REFUSAL)
    query.drop()
