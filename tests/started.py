"""Child processes of a test, whose output goes to files and which do not outlive it."""

import subprocess
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

Start = Callable[..., subprocess.Popen]


@contextmanager
def started(folder: Path, name: str) -> Iterator[Start]:
    """Give a function that starts processes, each with the path of its output as `log`; end those left."""
    children: list[subprocess.Popen] = []

    def start(words: Sequence[object], before: Callable[[], None] | None = None) -> subprocess.Popen:
        with (folder / f"{name}{len(children)}.log").open("w") as log:
            process = subprocess.Popen(
                [str(word) for word in words],
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=subprocess.STDOUT,
                preexec_fn=before,
            )
        process.log = Path(log.name)
        children.append(process)
        return process

    yield start
    for process in children:
        process.kill()
        process.stdin.close()
        process.wait()
