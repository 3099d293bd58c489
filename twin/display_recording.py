"""Shows recordings in the viewer, from beginning to end, with the pictures of a live run."""

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from daq.recording import Recording, RecordingError
from daq.rig import rig_from_text
from twin.display import Screen
from twin.display_data import Scene
from twin.show import Show
from twin.viewer import View, look_at

PERIOD = 0.1  # s of the run between two pictures


def show_recording(paths: Sequence[Path], view: View) -> None:
    """Show recordings in a window or a browser's page; return when the user has closed it.

    Args:
        paths: of the recordings, each of which becomes one in the viewer.
        view: `web` serves a page on loopback until Ctrl-C; `native` opens the viewer's window.

    Raises:
        RecordingError: a file is missing or no recording.
        ViewerError: the viewer is missing or cannot be started.
    """
    with TemporaryDirectory(prefix="rigtwin-view-") as folder:
        drawn = []
        for number, path in enumerate(paths):
            drawn.append(Path(folder) / f"{number}-{path.stem}.rrd")
            save_recording(path, drawn[-1])
        look_at([str(path) for path in drawn], view)


def save_recording(path: Path, target: Path) -> None:
    """Draw one recording into a file of the viewer (.rrd).

    Raises:
        RecordingError: the file is missing or no recording, or the target exists.
    """
    if target.exists():
        raise RecordingError(f"{target} exists already; name another file")
    with Recording(path) as recording:
        draw(recording, target)


def draw(recording: Recording, target: Path) -> None:
    """Draw a recording's run, frame by frame."""
    rig = rig_from_text(recording.rig_toml, str(recording.path))
    scene = Scene(rig)
    screen = Screen(rig, scene, f"{recording.description.run}-{recording.part}")
    screen.save(target)
    screen.name(recording.path.stem)
    show = Show(rig, scene, screen, f"RECORDED {recording.description.mode}")
    step = round(PERIOD * scene.rate)
    due = recording.description.first_sample + step
    for message in recording.messages(*show.topics):
        show.take(message.key, message.payload)
        if scene.next_sample >= due:
            due = scene.next_sample + step
            show.draw()
    show.draw()
    screen.close()
