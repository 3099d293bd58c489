"""Runs the twin anew over the blocks of a recording.

`Repetition` does it exactly as the live twin did: a block that was shed, a late start and a second
process are in the recording as the twin's events, by sample index. `estimate` does it afresh, over every
block.
"""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from daq import keys
from daq.describe import versions
from daq.messages import Series, read_header
from daq.recording import Message, RecordingError, RecordingWriter
from daq.recording.certificate import Certificate
from daq.recording.withheld import left_out
from daq.rig import Rig, rig_from_text
from daq.series_layout import SeriesDecoder
from replay.history import NOT_RECEIVED, History, RepeatableRun
from replay.pipeline import ahead, behind
from twin.estimation import NOT_RECORDED, SOURCE, Twin

Progress = Callable[[int], object]


def rig_of(run: RepeatableRun) -> Rig:
    """Return the rig that a run was made with.

    Raises:
        RigError: its description is lost, or not one that this version understands.
    """
    return rig_from_text(run.description.toml, f"rig description in {run.path}")


class Repetition:
    """The live twin's processes run again, block by block; `run.check_files` must have been called.

    A process that was killed and its successor may both have been at work on the same blocks, and the
    recording holds one of their estimates. It does not say whose: both are made until `current`
    is set to the successor.

    Args:
        run: the recording.
        history: of the live twin, from `run.history`.
        progress: called with the index behind each block.

    Raises:
        RigError: the rig has no model, or its description is not understood.
    """

    def __init__(
        self, run: RepeatableRun, history: History, progress: Progress = lambda sample: None
    ) -> None:
        self.current = 0
        """Number of the earliest process that may still be at work."""
        self._run, self._history, self._progress = run, history, progress
        self._rig = rig_of(run)
        self._twins: dict[int, Twin] = {}
        self._blocks, self._estimates = SeriesDecoder(), SeriesDecoder()

    def blocks(self) -> Iterator[tuple[int, dict[int, Series]]]:
        """Yield the first sample of each block, and each process' estimate over it by the process' number."""
        for message in self._run.in_order(self._run.messages(keys.block(self._rig.name))):
            block = self._blocks.decode(message.payload)
            sample = block.first_sample
            if sample >= self._history.end:
                return
            yield (
                sample,
                {
                    number: self._estimate(number, message.payload, session.cause(sample))
                    for number, session in enumerate(self._history.sessions)
                    if number >= self.current and session.saw(sample)
                },
            )
            self._progress(sample + block.samples.shape[1])

    def _estimate(self, number: int, payload: bytes, cause: str) -> Series:
        """Return what one process makes of a block."""
        description = self._run.description
        if number not in self._twins:
            self._twins[number] = Twin(self._rig, description.run, description.t0_ns)
        made = dict(_process(self._twins[number], payload, cause))
        return self._estimates.decode(made[keys.estimate(self._rig.name)])


def estimate(
    source: str | Path,
    target: str | Path,
    progress: Progress = lambda sample: None,
    smooth: bool = False,
) -> Certificate:
    """Write a recording anew, with fresh estimates over every block in place of the twin's messages.

    Args:
        source: recording; its continuations are taken along.
        target: recording to write; an existing file is refused.
        progress: called with the index behind each block.
        smooth: whether to write the motion with hindsight as well, a series of its own.

    Returns:
        The certificate of the new recording.

    Raises:
        RecordingError: the source cannot be read or the target cannot be written.
        RigError: the rig has no model, or its description is not understood.
    """
    with RepeatableRun(source) as run:
        run.check_files()
        description = run.description
        twin = Twin(rig_of(run), description.run, description.t0_ns, smooth)
        stretches = left_out(run.events())
        with RecordingWriter(target, description) as writer:
            told = {"smoothed": "yes"} if smooth else {}
            writer.note("twin", {"source": run.path.name, **told, **versions()})
            with ahead(without_twin(run)) as messages, behind(writer.add) as write:
                for message in messages:
                    write(message.key, message.payload)
                    if message.key == keys.block(description.rig):
                        for made in _process(twin, message.payload, _cause(twin, message.payload, stretches)):
                            write(*made)
                        progress(twin.observer.expected or 0)
                for made in twin.finish():
                    write(*made)
            stored = run.files[-1].certificate
            return writer.close(
                expected=stored.first_sample + stored.expected if stored else None,
                clean=stored.clean if stored else writer.ledger.end_sample is not None,
            )


def _process(twin: Twin, payload: bytes, cause: str = NOT_RECEIVED) -> list[tuple[str, bytes]]:
    """Return what the twin makes of a block."""
    try:
        return twin.process(payload, cause)
    except ValueError as error:
        raise RecordingError(f"the twin cannot be run again: {error}") from error


def _cause(twin: Twin, payload: bytes, stretches: Sequence[tuple[int, int]]) -> str:
    """Return why samples before a block are missing, if any are: as live, not lost if some were left out."""
    if not stretches:
        return NOT_RECEIVED
    sample, expected = read_header(payload).sample, twin.observer.expected or 0
    omitted = any(first < sample and last >= expected for first, last in stretches)
    return NOT_RECORDED if omitted else NOT_RECEIVED


def without_twin(run: RepeatableRun) -> Iterator[Message]:
    """Yield all messages but the twin's: blocks by their index, the others as they come in the file."""
    block = keys.block(run.description.rig)
    waiting: list[Message] = []

    def blocks() -> Iterator[Message]:
        for message in run.messages():
            if message.key == block:
                yield message
            elif keys.process_of(message.key) != SOURCE:
                waiting.append(message)

    for message in run.in_order(blocks()):
        yield from waiting
        waiting.clear()
        yield message
    yield from waiting
