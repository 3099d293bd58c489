"""The emulated rig once more, with given outputs at given samples in place of anybody's commands."""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq import keys
from daq.acquisition import Acquisition
from daq.backend import Output, Reading
from daq.backends.emulator import Emulator
from daq.messages_pb2 import Description, Event
from daq.recording import RecordingError, RecordingWriter
from daq.recording.certificate import Certificate
from daq.recording.recorded_run import RecordedRun
from daq.recording.withheld import Withheld, calls, left_out
from daq.rig import Rig, rig_from_text
from replay.outputs import Written, outputs_of
from twin.estimation import Twin

Progress = Callable[[int], object]


class Scripted(Emulator):
    """An emulated device that follows a script and leaves out what else is written to it."""

    def __init__(self, script: Sequence[Written]) -> None:
        super().__init__(paced=False)
        self._script = list(script)
        self._begin: tuple[int, NDArray[np.float64], float, float] | None = None

    def begin_at(self, sample: int, state: NDArray[np.float64], set_point: float, closing: float) -> None:
        """Begin at another sample than 0: with a state (12,), a set-point of the speed in rad/s, and the
        speed (m/s) at which a contact that is under way closed.
        """
        self._begin = sample, state, set_point, closing

    def start(self) -> None:
        """Begin at sample 0 with the shaft hanging still, or where it was told to begin."""
        super().start()
        if self._begin is not None:
            self.go_on_from(*self._begin)

    def write(self, output: Output, at_sample: int | None = None) -> int:
        """Do nothing; return when it would have taken effect."""
        return at_sample if at_sample is not None else self.clock()

    def read(self, out: NDArray[np.float64]) -> Reading:
        """Compute the next samples, with what the script says for them."""
        while self._script and self._script[0].effect < self.clock() + out.shape[1]:
            following = self._script.pop(0)
            self.schedule(following.effect, following.output)
        return super().read(out)


class Pauses:
    """Recording switched off and on as in a run, of which `events` tell, and what its trips called for."""

    def __init__(self, events: Iterable[Event], rig: Rig) -> None:
        told = list(events)
        self._stretches = left_out(told)
        self.withheld = Withheld(rig.toml, rig.acquisition.rate)
        for event in filter(calls, told):
            self.withheld.release(keys.event(rig.name, "daq"), event.SerializeToString())

    def switch(self, acquisition: Acquisition) -> None:
        """Switch recording as far as the acquisition has come; called before each of its steps."""
        if self._stretches and acquisition.sample > self._stretches[0][1]:
            acquisition.switch_recording(True)
            self._stretches.pop(0)
        if self._stretches:
            acquisition.switch_recording(False, self._stretches[0][0])


def acquire(
    rig: Rig,
    device: Scripted,
    writer: RecordingWriter,
    end: int,
    *,
    twin: Twin | None = None,
    told: Iterable[Event] = (),
    progress: Progress = lambda sample: None,
) -> None:
    """Acquire from an opened device into a recording, from the description's first sample to before `end`.

    Recording is off where the events `told` of another run say that it was.
    """
    description = writer.description
    block, pauses = keys.block(rig.name), Pauses(told, rig)

    def record(key: str, payload: bytes) -> None:
        for message in pauses.withheld.release(key, payload):
            writer.add(*message)
        if key == block and twin is not None:
            for made in twin.process(payload):
                writer.add(*made)

    acquisition = Acquisition(rig, device, record, run=description.run, t0_ns=description.t0_ns)
    acquisition.sample = description.first_sample
    acquisition.begin()
    while acquisition.sample < end:
        pauses.switch(acquisition)
        acquisition.step()
        progress(acquisition.sample)
    acquisition.end()


def resimulate(
    source: str | Path, target: str | Path, progress: Progress = lambda sample: None
) -> Certificate:
    """Write what the emulated rig does when it gets a recorded run's outputs at the samples of their effect.

    The signals are the recorded ones bit by bit, on a computer of the same numeric fingerprint, unless the
    device lost samples or the protection tripped: a trip drops the enable output too, at a sample that is
    not told. What was left out of the recording, as commanded, is left out of the new one.

    Raises:
        RecordingError: the source is no emulated run, or cannot be read; the target cannot be written.
    """
    with RecordedRun(source) as run:
        description = run.description
        rig = rig_from_text(description.toml, f"rig description in {run.path}")
        if description.mode != "EMULATED":
            raise RecordingError(f"{run.path} is of a real rig: only an emulated run can be simulated again")
        events = run.events()
        end = max((int(each.details["samples"]) for each in events if each.kind == "end"), default=0)
        if not end:
            raise RecordingError(f"{run.path} breaks off before the run's end: how long it was is not known")
        device = Scripted(outputs_of(events, rig))
        twin = Twin(rig, description.run, description.t0_ns) if rig.twin.model != "none" else None
        device.open(rig)
        with RecordingWriter(target, _copy(description)) as writer:
            acquire(rig, device, writer, end, twin=twin, told=events, progress=progress)
            return writer.close()


def _copy(description: Description) -> Description:
    made = Description()
    made.CopyFrom(description)
    return made
