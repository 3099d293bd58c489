import pytest
from hypothesis import given
from hypothesis import strategies as st

from daq import recovery
from daq.inbox import Inbox
from daq.recovery import Cache, Recovery, range_of

KEY = "rig/test/daq/block"


def payload_of(number):
    return str(number).encode()


def recovery_from(cache, reachable=lambda: True):
    def fetch(key, publisher, first, end):
        assert (key, publisher) == (KEY, cache.publisher)
        return cache.pack(range_of(first, end)) if reachable() else None

    return Recovery(fetch)


def publish(cache):
    number = cache.keep(payload_of(cache.sent + 1))
    cache.sent = number
    return number


def received_by(inbox):
    numbers = []
    while (message := inbox.get(0.0)) is not None:
        numbers.append(int(message[1]))
    return numbers


@given(st.lists(st.sampled_from(["arrives", "lost", "twice", "newest", "consume"]), max_size=60))
def test_whatever_is_lost_everything_is_received_once_and_in_order(fates):
    cache, inbox = Cache(100), Inbox(4, "wait")
    subscription = recovery_from(cache)
    received = []
    for fate in fates:
        if fate == "consume":
            received += received_by(inbox)
            continue
        number = cache.sent if fate == "newest" else publish(cache)
        if number < 0 or fate == "lost":
            continue
        payload = None if fate == "newest" else payload_of(number)
        for _ in range(2 if fate == "twice" else 1):
            inbox.offer(KEY, payload, (cache.publisher, number), subscription)
    received += received_by(inbox)
    if cache.sent >= 0:
        inbox.offer(KEY, None, (cache.publisher, cache.sent), subscription)
    received += received_by(inbox)
    assert received == list(range(cache.sent + 1))
    assert subscription.missed == 0


def test_a_cache_gives_what_it_still_has_piece_by_piece():
    cache = Cache(50)
    for _ in range(120):
        cache.sent = cache.keep(bytes(100_000))
    inbox, subscription = Inbox(1, "wait"), recovery_from(cache)
    assert len(cache.pack(range_of(0, 120))) < recovery.PIECE_BYTES + 101_000
    inbox.offer(KEY, None, (cache.publisher, 119), subscription)
    count = 0
    while inbox.get(0.0) is not None:
        count += 1
    assert count == 50


def test_what_no_cache_has_any_more_is_counted():
    cache, inbox = Cache(5), Inbox(10, "wait")
    subscription = recovery_from(cache)
    inbox.offer(KEY, payload_of(0), (cache.publisher, publish(cache)), subscription)
    for _ in range(20):
        newest = publish(cache)
    inbox.offer(KEY, None, (cache.publisher, newest), subscription)
    assert received_by(inbox) == [0, 16, 17, 18, 19, 20]
    assert subscription.missed == 15


def test_history_from_before_the_subscription_is_not_counted_as_missed():
    cache, inbox = Cache(5), Inbox(10, "wait")
    subscription = recovery_from(cache)
    for _ in range(20):
        newest = publish(cache)
    inbox.offer(KEY, None, (cache.publisher, newest), subscription)
    assert received_by(inbox) == [15, 16, 17, 18, 19]
    assert subscription.missed == 0


def test_a_publisher_that_does_not_answer_is_asked_again():
    cache, inbox = Cache(50), Inbox(10, "wait")
    answers = iter([False, False, True])
    subscription = recovery_from(cache, reachable=lambda: next(answers))
    for _ in range(3):
        newest = publish(cache)
    inbox.offer(KEY, None, (cache.publisher, newest), subscription)
    assert inbox.get(0.0) is None
    assert inbox.get(0.0) is None
    assert received_by(inbox) == [0, 1, 2]


def test_a_publisher_that_is_gone_leaves_a_gap(monkeypatch):
    monkeypatch.setattr(recovery, "PATIENCE_S", 0.1)
    cache, inbox = Cache(50), Inbox(10, "wait")
    subscription = recovery_from(cache, reachable=lambda: False)
    for number in (0, 7, 8):
        inbox.offer(KEY, payload_of(number), (cache.publisher, number), subscription)
    assert [int(inbox.get(20.0)[1]) for _ in range(3)] == [0, 7, 8]
    assert subscription.missed == 6


def test_a_question_that_is_none_is_an_error_of_who_asks():
    with pytest.raises(recovery.RecoveryError, match="3 bytes"):
        Cache(5).pack(b"abc")
