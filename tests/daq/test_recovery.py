import pytest
from hypothesis import given
from hypothesis import strategies as st

from daq.link import recovery
from daq.link.inbox import Inbox
from daq.link.recovery import Cache, Recovery, range_of

KEY = "rig/test/daq/block"


def payload_of(number):
    return str(number).encode()


def recovery_from(cache, reachable=lambda: True):
    def fetch(key, publisher, first, end):
        assert (key, publisher) == (KEY, cache.publisher)
        return cache.pack(range_of(first, end)) if reachable() else None

    return Recovery(fetch)


def publish(cache):
    """Publish the next number's payload; return its stamp."""
    payload = payload_of(cache.newest + 1)
    stamp = cache.stamp(payload)
    cache.keep(payload, stamp)
    return stamp


def newest(cache):
    """Return the stamp that tells the newest number."""
    return cache.publisher, cache.newest, 0


def received_by(inbox):
    numbers = []
    while (message := inbox.get(0.0)) is not None:
        numbers.append(int(message[1]))
    return numbers


@given(st.lists(st.sampled_from(["arrives", "lost", "twice", "damaged", "newest", "consume"]), max_size=60))
def test_whatever_is_lost_everything_is_received_once_and_in_order(fates):
    cache, inbox = Cache(100), Inbox(4, "wait")
    subscription = recovery_from(cache)
    received = []
    for fate in fates:
        if fate == "consume":
            received += received_by(inbox)
        elif fate == "newest" and cache.newest >= 0:
            inbox.offer(KEY, None, newest(cache), subscription)
        elif fate != "newest":
            stamp = publish(cache)
            payload = payload_of(stamp[1])
            copies = {"lost": [], "twice": [payload] * 2, "damaged": [payload[:-1] + b"x"]}
            for copy in copies.get(fate, [payload]):
                inbox.offer(KEY, copy, stamp, subscription)
    received += received_by(inbox)
    if cache.newest >= 0:
        inbox.offer(KEY, None, newest(cache), subscription)
    received += received_by(inbox)
    assert received == list(range(cache.newest + 1))
    assert subscription.missed == 0


def test_a_cache_gives_what_it_still_has_piece_by_piece():
    cache = Cache(50)
    for _ in range(120):
        cache.keep(bytes(100_000), cache.stamp(bytes(100_000)))
    inbox, subscription = Inbox(1, "wait"), recovery_from(cache)
    assert len(cache.pack(range_of(0, 120))) < recovery.PIECE_BYTES + 101_000
    inbox.offer(KEY, None, newest(cache), subscription)
    count = 0
    while inbox.get(0.0) is not None:
        count += 1
    assert count == 50


def test_a_damaged_or_shortened_piece_is_fetched_again():
    cache, inbox = Cache(50), Inbox(10, "wait")
    for _ in range(5):
        publish(cache)
    damages = [
        lambda packed: packed[:-1],
        lambda packed: packed[:3],
        lambda packed: b"x" + packed[1:],
        lambda packed: packed[:8] + bytes(8) + packed[16:],
        lambda packed: packed,
    ]

    def fetch(key, publisher, first, end):
        return damages.pop(0)(cache.pack(range_of(first, end)))

    inbox.offer(KEY, None, newest(cache), Recovery(fetch))
    received = []
    while damages:
        received += received_by(inbox)
    assert received == [0, 1, 2, 3, 4]


@given(st.binary(min_size=1, max_size=20_000), st.data())
def test_an_end_that_belongs_to_others_is_noticed(payload, data):
    stamp = Cache(1).stamp(payload)
    cut = data.draw(st.integers(0, len(payload) - 1))
    damaged = payload[:cut] + bytes(octet ^ 0x5A for octet in payload[cut:])
    assert recovery.is_whole(payload, stamp)
    assert not recovery.is_whole(damaged, stamp)


def test_what_no_cache_has_any_more_is_counted():
    cache, inbox = Cache(5), Inbox(10, "wait")
    subscription = recovery_from(cache)
    inbox.offer(KEY, payload_of(0), publish(cache), subscription)
    for _ in range(20):
        publish(cache)
    inbox.offer(KEY, None, newest(cache), subscription)
    assert received_by(inbox) == [0, 16, 17, 18, 19, 20]
    assert subscription.missed == 15


def test_history_from_before_the_subscription_is_not_counted_as_missed():
    cache, inbox = Cache(5), Inbox(10, "wait")
    subscription = recovery_from(cache)
    for _ in range(20):
        publish(cache)
    inbox.offer(KEY, None, newest(cache), subscription)
    assert received_by(inbox) == [15, 16, 17, 18, 19]
    assert subscription.missed == 0


def test_a_publisher_that_does_not_answer_is_asked_again():
    cache, inbox = Cache(50), Inbox(10, "wait")
    answers = iter([False, False, True])
    subscription = recovery_from(cache, reachable=lambda: next(answers))
    for _ in range(3):
        publish(cache)
    inbox.offer(KEY, None, newest(cache), subscription)
    assert inbox.get(0.0) is None
    assert inbox.get(0.0) is None
    assert received_by(inbox) == [0, 1, 2]


def test_a_publisher_that_is_gone_leaves_a_gap(monkeypatch):
    monkeypatch.setattr(recovery, "PATIENCE_S", 0.1)
    cache, inbox = Cache(50), Inbox(10, "wait")
    subscription = recovery_from(cache, reachable=lambda: False)
    stamps = [publish(cache) for _ in range(9)]
    for number in (0, 7, 8):
        inbox.offer(KEY, payload_of(number), stamps[number], subscription)
    assert [int(inbox.get(20.0)[1]) for _ in range(3)] == [0, 7, 8]
    assert subscription.missed == 6


def test_a_question_that_is_none_is_an_error_of_who_asks():
    with pytest.raises(recovery.RecoveryError, match="3 bytes"):
        Cache(5).pack(b"abc")
