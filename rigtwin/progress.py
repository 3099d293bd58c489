"""The bar that shows how far a recording has been run through."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def progress(path: Path, first: int = 0, last: int | None = None) -> Iterator[Callable[[int], object]]:
    """Show a bar on standard error; gives a function that is to be called with the sample index reached.

    Args:
        path: recording.
        first: index of the first sample.
        last: index of the last sample; None: the last that its certificate tells of, if it has one.
    """
    from rich.console import Console
    from rich.progress import Progress

    from replay.history import expected_end

    end = expected_end(path) if last is None else last + 1
    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(path.name, total=None if end is None else end - first)
        yield lambda sample: bar.update(task, completed=sample - first)
