"""How a process learns that its parent wants it to end, or has died."""

import os
import signal
from collections.abc import Callable
from threading import Thread

STANDARD_INPUT = 0
STOP_LINE = b"stop\n"


def follow_parent(end: Callable[[], object]) -> None:
    """Call `end` when standard input ends or says `stop`, or on SIGTERM; let Ctrl-C be the parent's business.

    To be called from the main thread; `end` may be called more than once, from another thread too.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda number, frame: end())
    Thread(target=_follow_input, args=(end,), name="standard input", daemon=True).start()


def _follow_input(end: Callable[[], object]) -> None:
    """Read the descriptor itself: a buffered reader that waits aborts the interpreter when it ends."""
    line = b""
    try:
        while piece := os.read(STANDARD_INPUT, 4096):
            line = (line + piece)[-len(STOP_LINE) :]
            if line == STOP_LINE:
                break
    except OSError:
        pass  # there is no standard input
    end()
