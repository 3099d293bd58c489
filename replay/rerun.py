"""Runs the twin anew over the blocks of a recording.

`repeat` does it exactly as the live twin did: a block that was shed, a late start and a second process are
in the recording as the twin's events, by sample index. `estimate` does it afresh, over every block.
"""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from daq import keys
from daq.certificate import Certificate
from daq.describe import versions
from daq.messages import Series, decode_series
from daq.recording import Message, RecordingError, RecordingWriter
from daq.rig import Rig, rig_from_text
from replay.history import NOT_RECEIVED, RecordedRun, Session
from twin.estimation import SOURCE, Twin

Progress = Callable[[int], object]


def rig_of(run: RecordedRun) -> Rig:
    """Return the rig that a run was made with.

    Raises:
        RigError: its description is lost, or not one that this version understands.
    """
    return rig_from_text(run.description.toml, f"rig description in {run.path}")


def repeat(
    run: RecordedRun, sessions: Sequence[Session], progress: Progress = lambda sample: None
) -> Iterator[Series]:
    """Yield the estimates that the live twin published, made anew; `run.check` must have been called.

    Args:
        run: the recording.
        sessions: of the live twin, from `run.sessions`.
        progress: called with the index behind each block.

    Raises:
        RigError: the rig has no model, or its description is not understood.
    """
    rig, description = rig_of(run), run.description
    twins: dict[int, Twin] = {}
    topic = keys.estimate(rig.name)
    for message in run.in_order(run.messages(keys.block(description.rig))):
        block = decode_series(message.payload)
        for number, session in enumerate(sessions):
            if not session.saw(block.first_sample):
                continue
            twin = twins.setdefault(number, Twin(rig, description.run, description.t0_ns))
            made = _process(twin, message.payload, session.cause(block.first_sample))
            if block.first_sample >= session.recorded_from:
                yield from (decode_series(payload) for key, payload in made if key == topic)
        progress(block.first_sample + block.samples.shape[1])


def estimate(source: str | Path, target: str | Path, progress: Progress = lambda sample: None) -> Certificate:
    """Write a recording anew, with fresh estimates over every block in place of the twin's messages.

    Args:
        source: recording; its continuations are taken along.
        target: recording to write; an existing file is refused.
        progress: called with the index behind each block.

    Returns:
        The certificate of the new recording.

    Raises:
        RecordingError: the source cannot be read or the target cannot be written.
        RigError: the rig has no model, or its description is not understood.
    """
    with RecordedRun(source) as run:
        run.check()
        description = run.description
        twin = Twin(rig_of(run), description.run, description.t0_ns)
        with RecordingWriter(target, description) as writer:
            writer.note("twin", {"source": run.path.name, **versions()})
            for message in _others(run):
                writer.add(message.key, message.payload)
                if message.key == keys.block(description.rig):
                    for made in _process(twin, message.payload):
                        writer.add(*made)
                    progress(twin.observer.expected or 0)
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


def _others(run: RecordedRun) -> Iterator[Message]:
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
