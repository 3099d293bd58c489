"""Overlaps reading, computing and writing: each in a thread of its own, every item in its order."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any, ParamSpec, TypeVar

Item = TypeVar("Item")
Arguments = ParamSpec("Arguments")

WAITING = 64  # items that may wait between two threads
END: Any = object()


@contextmanager
def ahead(items: Iterable[Item]) -> Iterator[Iterator[Item]]:
    """Have `items` made in a thread, `WAITING` of them in advance.

    What making one raises is raised where its turn comes. Leaving the context waits for the thread.
    """
    iterator = iter(items)

    def taken() -> Iterator[Item]:
        waiting = deque(reader.submit(next, iterator, END) for _ in range(WAITING))
        while (item := waiting.popleft().result()) is not END:
            waiting.append(reader.submit(next, iterator, END))
            yield item

    with ThreadPoolExecutor(1) as reader:
        yield taken()


@contextmanager
def behind(action: Callable[Arguments, object]) -> Iterator[Callable[Arguments, None]]:
    """Yield a function that has `action` called in a thread; `WAITING` calls may be behind.

    What a call raises is raised by a later one or at the context's end. Leaving the context, even by an
    exception, waits for all calls.
    """
    waiting: deque[Future[object]] = deque()

    def put(*arguments: Arguments.args, **named: Arguments.kwargs) -> None:
        waiting.append(worker.submit(action, *arguments, **named))
        if len(waiting) > WAITING:
            waiting.popleft().result()

    with ThreadPoolExecutor(1) as worker:
        yield put
        while waiting:
            waiting.popleft().result()
