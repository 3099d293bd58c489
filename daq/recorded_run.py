"""A recording with its continuations, read as one."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Self

from daq.messages_pb2 import Description, Event
from daq.recording_reader import Message, Recording
from daq.signals import Signals, joined
from daq.storage import RecordingError, parts
from daq.timing import SampleClock


class RecordedRun:
    """A recording in one part or several, read as one.

    Args:
        path: of the first part; those that follow it are found by their names.

    Raises:
        RecordingError: a file cannot be read.
    """

    def __init__(self, path: str | Path) -> None:
        first, *rest = parts(path)
        self.files = [Recording(first)]
        self.unreadable: list[str] = []
        """Continuations that hold nothing, as one that was cut off before its first block, and why."""
        for part in rest:
            try:
                self.files.append(Recording(part))
            except RecordingError as error:
                self.unreadable.append(str(error))
        self.path = self.files[0].path

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the files."""
        for file in self.files:
            file.close()

    @property
    def description(self) -> Description:
        """What the daq said of the run."""
        return self.files[0].description

    @property
    def clock(self) -> SampleClock:
        """Turns the run's sample indices into time."""
        return self.files[0].clock

    def messages(self, *topics: str) -> Iterator[Message]:
        """Yield the messages of some topics, or of all, in the order of the files."""
        for file in self.files:
            yield from file.messages(*topics)

    def messages_between(self, *topics: str, first: int = 0, last: int | None = None) -> Iterator[Message]:
        """Yield the messages, of all topics or of some, of samples `first` to `last`, in the files' order."""
        for file in self.files:
            yield from file.messages_between(*topics, first=first, last=last)

    def last(self, *topics: str) -> dict[str, Message]:
        """Return the last sound message of each topic."""
        return {key: message for file in self.files for key, message in file.last(*topics).items()}

    def events(self) -> list[Event]:
        """Return all events, in the order of the files."""
        return [event for file in self.files for event in file.events()]

    def series(
        self,
        key: str = "block",
        names: Sequence[str] | None = None,
        *,
        first: int = 0,
        last: int | None = None,
    ) -> Signals:
        """Return channels as one array, see `Recording.series`.

        Raises:
            RecordingError: there are no such samples, or no such channel.
        """
        found = [piece for file in self.files for piece in file.pieces(key, first, last)]
        return joined(found, names, first, last, f"{self.path}: {key}")
