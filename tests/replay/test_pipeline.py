from threading import Event

import pytest

from replay.pipeline import WAITING, ahead, behind


def broken_after(count):
    yield from range(count)
    raise ValueError("no more")


def test_items_made_ahead_come_in_order_and_all():
    with ahead(range(5 * WAITING)) as items:
        assert list(items) == list(range(5 * WAITING))


@pytest.mark.parametrize("count", [0, 1, WAITING - 1, 3 * WAITING])
def test_an_error_comes_after_all_that_was_made_before_it(count):
    seen = []
    with pytest.raises(ValueError, match="no more"), ahead(broken_after(count)) as items:
        seen.extend(items)
    assert seen == list(range(count))


def test_not_more_is_made_ahead_than_may_wait():
    made = []
    with ahead(made.append(number) or number for number in range(10 * WAITING)) as items:
        assert next(items) == 0
    assert len(made) == WAITING + 1


def test_calls_left_behind_are_made_in_order_and_all():
    done = []
    with behind(lambda *call: done.append(call)) as put:
        for number in range(5 * WAITING):
            put(number, -number)
    assert done == [(number, -number) for number in range(5 * WAITING)]


def test_what_a_call_raises_is_raised_at_the_end_at_the_latest():
    with pytest.raises(ZeroDivisionError), behind(lambda number: 1 / number) as put:
        put(0)


def test_what_a_call_raises_ends_the_calls_that_follow():
    numbers = iter(range(2 * WAITING))
    with pytest.raises(ZeroDivisionError), behind(lambda: 1 / 0) as put:
        all(put() is None for _ in numbers)
    assert next(numbers) == WAITING + 1


def test_leaving_by_an_exception_makes_the_calls_first():
    may_begin, done = Event(), []

    def act(number):
        may_begin.wait(30)
        done.append(number)

    def interrupted():
        yield from range(3)
        may_begin.set()
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), behind(act) as put:
        all(put(number) is None for number in interrupted())
    assert done == [0, 1, 2]
