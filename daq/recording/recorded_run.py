"""A recording with its continuations, read as one."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Self

from daq.messages import Series
from daq.messages_pb2 import Description, Event
from daq.recording.certificate import Certificate, Check, Ledger
from daq.recording.reader import Message, Recording
from daq.recording.signals import Signals, joined
from daq.recording.storage import RecordingError, part_path, parts
from daq.timing import SampleClock

VERDICTS = ("valid", "incomplete", "no certificate", "altered")  # from best to worst


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

    def check(self, on_block: Callable[[Series], None] | None = None) -> Check:
        """Compare each part with its certificate and make the account of all of them as of one.

        Args:
            on_block: called with each block on the way.

        Returns:
            The worst verdict of the parts and, where the parts leave samples out between them, incomplete.
        """
        checks = [file.check(on_block) for file in self.files]
        account = checks[0].certificate if len(checks) == 1 else self._account(checks)
        faults = [
            (check.verdict, f"{file.path.name}: {check.reason}" if len(checks) > 1 else check.reason)
            for file, check in zip(self.files, checks, strict=True)
        ]
        faults += [("incomplete", text) for text in self._missing(account)]
        return Check(*max(faults, key=lambda fault: VERDICTS.index(fault[0])), account)

    def _account(self, checks: Sequence[Check]) -> Certificate:
        """Return the account of all parts, made anew from what they hold."""
        ledger = Ledger(self.description.run, self.description.first_sample)
        for message in self.messages():
            ledger.admit(message.key, message.payload)
        last = checks[-1].certificate
        return ledger.certificate(
            part=self.files[0].part,
            expected=last.first_sample + last.expected,
            clean=last.clean,
            continued=last.continued,
        )

    def _missing(self, account: Certificate) -> Iterator[str]:
        """Yield what is missing although each part is whole, in plain words."""
        if len(self.files) > 1 and account.gaps:
            yield f"{account.lost} samples are missing in {len(account.gaps)} gaps"
        last = self.files[-1]
        if last.certificate is not None and last.certificate.continued:
            following = part_path(self.path, last.part + 1) if self.files[0].part == 1 else "what follows"
            yield f"it goes on in {following}, which is missing"
        yield from self.unreadable

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
