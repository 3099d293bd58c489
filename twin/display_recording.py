"""Shows recordings in the viewer, from beginning to end, with the pictures of a live run.

A fork is drawn into the picture of the run that it comes from, on the same time axis, in other colours.
"""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

from daq.describe import run_before_forks
from daq.recording import Recording, RecordingError
from daq.rig import rig_from_text
from twin.display import Screen, canvas
from twin.display_data import Scene
from twin.display_look import RUN, look_of_fork
from twin.show import Show
from twin.viewer import View, look_at

PERIOD = 0.1  # s of the run between two pictures


def show_recording(paths: Sequence[Path], view: View) -> None:
    """Show recordings in a window or a browser's page; return when the user has closed it.

    Args:
        paths: of the recordings, each of which becomes a picture; forks share that of their run.
        view: `web` serves a page on loopback until Ctrl-C; `native` opens the viewer's window.

    Raises:
        RecordingError: a file is missing or no recording.
        ViewerError: the viewer is missing or cannot be started.
    """
    with TemporaryDirectory(prefix="rigtwin-view-") as folder:
        drawn = []
        for number, together in enumerate(pictures(paths)):
            drawn.append(Path(folder) / f"{number}-{together[0].stem}.rrd")
            save_picture(together, drawn[-1])
        look_at([str(path) for path in drawn], view)


def save_recording(paths: Sequence[Path], target: Path) -> None:
    """Draw a recording, with forks of it or without, into a file of the viewer (.rrd).

    Raises:
        RecordingError: a file is missing or no recording, the target exists, or these are several pictures.
    """
    if target.exists():
        raise RecordingError(f"{target} exists already; name another file")
    together, *others = pictures(paths)
    if others:
        raise RecordingError(
            f"{target} takes one picture, and {others[0][0]} is no fork of {together[0]}: save each alone"
        )
    save_picture(together, target)


def pictures(paths: Sequence[Path]) -> list[list[Path]]:
    """Return which recordings are drawn together: each with those that are forks of it, it before them."""
    made: list[list[Path]] = []
    of_run: dict[tuple[str, str], list[Path]] = {}
    forks: list[tuple[tuple[str, str], Path]] = []
    for path in paths:
        with Recording(path) as recording:
            run = recording.description.rig, run_before_forks(recording.description.run)
            if "fork" in recording.notes:
                forks.append((run, path))
            else:
                made.append([path])
                of_run.setdefault(run, made[-1])
    for run, path in forks:
        if run not in of_run:
            made.append([])
            of_run[run] = made[-1]
        of_run[run].append(path)
    return made


def save_picture(paths: Sequence[Path], target: Path) -> None:
    """Draw recordings of one time axis into one picture, the first in the colours of a live run."""
    others = [look_of_fork(number, path.stem) for number, path in enumerate(paths[1:])]
    with ExitStack() as stack:
        recordings = [stack.enter_context(Recording(path)) for path in paths]
        shared = canvas(f"{recordings[0].description.run}-{recordings[0].part}")
        for recording, look in zip(recordings, (RUN, *others), strict=True):
            rig = rig_from_text(recording.rig_toml, str(recording.path))
            scene = Scene(rig)
            screen = Screen(rig, scene, shared, look)
            if look is RUN:
                screen.save(target, others)
                screen.name(" and ".join(path.stem for path in paths))
            else:
                screen.draw_surroundings()
            mode = f"RECORDED {recording.description.mode}" if look is RUN else look.named("FORK of")
            draw(recording, scene, Show(rig, scene, screen, mode))
        screen.close()


def draw(recording: Recording, scene: Scene, show: Show) -> None:
    """Draw a recording's run, frame by frame."""
    step = round(PERIOD * scene.rate)
    due = recording.description.first_sample + step
    for message in recording.messages(*show.topics):
        show.take(message.key, message.payload)
        if scene.next_sample >= due:
            due = scene.next_sample + step
            show.draw()
    show.draw()
