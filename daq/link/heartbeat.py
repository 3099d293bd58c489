"""A thread that calls again and again until it is stopped."""

from collections.abc import Callable
from queue import Empty, SimpleQueue
from threading import Thread


class Heartbeat:
    """Calls functions once a period, on a thread of its own that starts with the first of them.

    Args:
        period: s.
    """

    def __init__(self, period: float) -> None:
        self._period = period
        self._beats: list[Callable[[], None]] = []
        self._stopping: SimpleQueue[None] = SimpleQueue()
        self._thread: Thread | None = None

    def add(self, beat: Callable[[], None]) -> None:
        """Call this one too from now on."""
        self._beats.append(beat)
        if self._thread is None:
            self._thread = Thread(target=self._run, name="link heartbeat", daemon=True)
            self._thread.start()

    def stop(self) -> None:
        """Call nothing more; returns when the thread has ended."""
        thread, self._thread = self._thread, None
        if thread is not None:
            self._stopping.put(None)
            thread.join()

    def _run(self) -> None:
        while True:
            try:
                self._stopping.get(timeout=self._period)
            except Empty:
                for beat in tuple(self._beats):
                    beat()
            else:
                return
