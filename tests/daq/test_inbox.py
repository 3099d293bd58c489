import threading
from queue import SimpleQueue

import pytest

from daq.link.inbox import Inbox

PATIENCE = 30.0


def put_numbers(inbox, numbers):
    for number in numbers:
        inbox.put("key", str(number).encode())


def drain(inbox):
    numbers = []
    while (message := inbox.get(0.0)) is not None:
        numbers.append(int(message[1]))
    return numbers


def in_thread(function):
    thread = threading.Thread(target=function, daemon=True)
    thread.start()
    return thread


@pytest.mark.parametrize("when_full", ["wait", "drop_oldest"])
def test_messages_come_out_in_order(when_full):
    inbox = Inbox(5, when_full)
    assert inbox.get(0.0) is None
    assert inbox.get(0.01) is None
    put_numbers(inbox, range(5))
    assert inbox.fill == 1.0
    assert drain(inbox) == list(range(5))
    assert (inbox.fill, inbox.dropped) == (0.0, 0)


def test_drop_oldest_keeps_the_newest_and_counts_the_others():
    inbox = Inbox(5, "drop_oldest")
    put_numbers(inbox, range(17))
    assert inbox.fill == 1.0
    assert drain(inbox) == list(range(12, 17))
    assert inbox.dropped == 12


def test_drops_by_several_threads_are_all_counted():
    inbox = Inbox(10, "drop_oldest")
    threads = [in_thread(lambda: put_numbers(inbox, range(2000))) for _ in range(4)]
    received = 0
    while any(thread.is_alive() for thread in threads):
        received += inbox.get(0.001) is not None
    received += len(drain(inbox))
    assert received + inbox.dropped == 8000


def test_wait_holds_the_producer_until_there_is_room():
    inbox = Inbox(3, "wait")
    producer = in_thread(lambda: put_numbers(inbox, range(1000)))
    received = [int(inbox.get(PATIENCE)[1]) for _ in range(1000)]
    producer.join(PATIENCE)
    assert received == list(range(1000))
    assert inbox.dropped == 0


def test_a_consumer_that_waits_is_woken():
    inbox = Inbox(3, "wait")
    got = SimpleQueue()
    consumer = in_thread(lambda: got.put(inbox.get()))
    inbox.put("key", b"x")
    assert got.get(timeout=PATIENCE) == ("key", b"x")
    consumer.join(PATIENCE)


@pytest.mark.parametrize("when_full", ["wait", "drop_oldest"])
def test_close_releases_a_consumer(when_full):
    inbox = Inbox(3, when_full)
    got = SimpleQueue()
    in_thread(lambda: got.put(inbox.get()))
    inbox.close()
    assert got.get(timeout=PATIENCE) is None
    assert inbox.closed


def test_close_releases_all_producers():
    inbox = Inbox(1, "wait")
    producers = [in_thread(lambda: put_numbers(inbox, range(100))) for _ in range(3)]
    assert inbox.get(PATIENCE) is not None
    inbox.close()
    for producer in producers:
        producer.join(PATIENCE)
        assert not producer.is_alive()


def test_a_producer_that_is_no_longer_wanted_is_released():
    inbox = Inbox(1, "wait")
    inbox.put("key", b"kept")
    inbox.put("key", b"given up", abandoned=lambda: True)
    assert inbox.get(0.0) == ("key", b"kept")
    assert inbox.get(0.0) is None


def test_what_was_put_before_close_can_still_be_got():
    inbox = Inbox(5, "drop_oldest")
    put_numbers(inbox, range(3))
    inbox.close()
    put_numbers(inbox, range(3, 30))
    assert drain(inbox) == [0, 1, 2]
    assert inbox.get() is None


def test_an_inbox_that_holds_nothing_is_refused():
    with pytest.raises(ValueError, match="an inbox of 0 messages"):
        Inbox(0, "wait")
