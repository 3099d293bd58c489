"""Plays recordings on a rig's endpoints: opens them, claims the rig, and says what was missing."""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from threading import Event as Flag

from daq.describe import REPLAY
from daq.link import Link
from daq.recording import parts
from daq.recording.recorded_run import RecordedRun
from daq.rig import Rig
from daq.runtime import claim
from replay.player import Player, PlayerError
from replay.transport import Transport


def play(
    rig: Rig,
    paths: Sequence[Path],
    transport: Transport | None = None,
    *,
    recorded_twin: bool = False,
    wait_for: Sequence[str] = (),
    told_to_end: Flag | None = None,
) -> int:
    """Play recordings on a rig's endpoints, one after another, and return the samples played.

    Args:
        rig: whose ports are all given.
        paths: the recordings, or part 1 of each that has several parts.
        transport: rate, loop, and where to begin; by default in real time from the beginning.
        recorded_twin: whether what the twin said is played too.
        wait_for: processes that must be there before the first message.
        told_to_end: ends the replay when it is set.

    Raises:
        AlreadyRunning: this rig is live.
        RecordingError: a file cannot be read.
        PlayerError: the recordings are not of one rig, or a process that was waited for did not come.
        LinkError: a port is in use.
    """
    told_to_end = told_to_end or Flag()
    record = {"mode": REPLAY, **rig.link._asdict(), "toml": rig.toml}
    with ExitStack() as stack:
        runs = [stack.enter_context(RecordedRun(path)) for path in whole_runs(paths)]
        refuse_others(runs)
        stack.enter_context(claim(rig.name, record))
        link = stack.enter_context(Link(listen=[rig.link.endpoint("daq")], wait_for_room=True))
        control = stack.enter_context(Link(listen=[rig.link.endpoint("control")]))
        player = Player(link, control, runs, transport or Transport(), recorded_twin=recorded_twin)
        player.wait_for(wait_for, told_to_end)
        samples = player.play(told_to_end)
        player.see_off(wait_for, told_to_end)
    for warning in player.warnings:
        print(f"replay: warning: {warning}", flush=True)
    return samples


def whole_runs(paths: Sequence[Path]) -> list[Path]:
    """Return the paths without those that are continuations of another one of them."""
    continuations = {following for path in paths for following in parts(path)[1:]}
    return [path for path in paths if path not in continuations]


def refuse_others(runs: Sequence[RecordedRun]) -> None:
    """Raise `PlayerError` when the recordings are not all of one rig."""
    first = runs[0]
    for run in runs[1:]:
        if run.description.rig != first.description.rig:
            raise PlayerError(
                f"{run.path} is of rig {run.description.rig}, and {first.path} of {first.description.rig}: "
                "replay them one at a time"
            )
