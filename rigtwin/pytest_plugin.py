"""The pytest plugin for tests that need a rig: the fixture `emulated_rig`, which loads nothing until used."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import pytest

if TYPE_CHECKING:
    from rigtwin.emulated_rig import EmulatedRig


class StartRig(Protocol):
    """What the fixture `emulated_rig` gives: a function that starts rigs; all end with the test."""

    def __call__(
        self,
        rig: str | Path = "thesis-ball",
        *,
        settings: Sequence[str] = (),
        faults: Iterable[Mapping[str, object]] = (),
        real_time: bool = False,
    ) -> "EmulatedRig":
        """Start an emulated rig.

        Args:
            rig: name of a shipped rig, or a rig file.
            settings: changes of its description, as `"limits.force.trip=40.0"`.
            faults: what goes wrong, as rows `[[emulator.fault]]`: `{"kind": "late", "at": 0.5, "size": 1}`.
            real_time: run the daq as a process of its own, on free ports; otherwise time passes in the
                rig's `run` alone, and equal tests give equal samples.

        Raises:
            RigError: the description is wrong.
        """


@pytest.fixture
def emulated_rig(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[StartRig]:
    """Start emulated rigs, as many as wanted, independent of all others on this computer."""
    from rigtwin.emulated_rig import started

    with ExitStack() as stack:

        def start(
            rig: str | Path = "thesis-ball",
            *,
            settings: Sequence[str] = (),
            faults: Iterable[Mapping[str, object]] = (),
            real_time: bool = False,
        ) -> "EmulatedRig":
            folder = tmp_path / f"rig-{len(list(tmp_path.glob('rig-*')))}" if real_time else None
            if folder is not None:
                folder.mkdir()
                monkeypatch.setenv("RIGTWIN_RUNTIME_DIR", str(folder))
            running = started(rig, settings, faults, folder)
            stack.callback(running.close)
            return running

        yield start
