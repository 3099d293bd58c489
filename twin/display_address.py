"""Where a running display is found: a small file `<rig>.display` beside the run-time records."""

import json
import os
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Self

from daq.runtime import runtime_folder


class NotShown(RuntimeError):
    """No display runs for the rig."""


class Address(NamedTuple):
    """A running display."""

    pid: int
    data: str
    """For a viewer: rerun+http://..."""
    page: str
    """For a browser; empty when the display serves no page."""


class Announcement:
    """Tells where a display is found, for as long as the context lasts."""

    def __init__(self, rig: str, address: Address) -> None:
        self._path = path_of(rig)
        self._address = address

    def __enter__(self) -> Self:
        draft = self._path.with_suffix(".display-new")
        draft.write_text(json.dumps(self._address._asdict()), encoding="utf-8")
        draft.replace(self._path)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._path.unlink(missing_ok=True)


def find(rig: str) -> Address:
    """Return where the display of a running rig is found. Raises `NotShown`."""
    remedy = "start the run with --view web, or look at its recording with 'rigtwin view FILE'"
    try:
        address = Address(**json.loads(path_of(rig).read_text(encoding="utf-8")))
        os.kill(address.pid, 0)
    except (OSError, ValueError, TypeError):
        raise NotShown(f"rig {rig!r} runs without a display: {remedy}") from None
    return address


def path_of(rig: str) -> Path:
    """Return the file of a rig's display."""
    return runtime_folder() / f"{rig}.display"
