"""Run-time records: which rig runs in which process, on which ports, so that others find it.

A claimed rig has a locked file `<rig>.lock` and a record `<rig>.json` in the run-time folder:
`$RIGTWIN_RUNTIME_DIR`, else `$XDG_RUNTIME_DIR/rigtwin`, else `rigtwin-<user id>` in the folder for
temporary files. The lock ends with its process, however that ends; a record without a lock is stale.
"""

import fcntl
import json
import os
import tempfile
import time
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

from daq import keys

Record = dict[str, Any]

ATTEMPTS = 20
PAUSE_S = 0.01
"""A reader holds the lock for an instant while it looks whether it is free, so a claim tries again."""


class RuntimeRecordError(RuntimeError):
    """The run-time records cannot give or take what was asked; the message says what to do."""


class AlreadyRunning(RuntimeRecordError):
    """Another process runs this rig."""


class NotRunning(RuntimeRecordError):
    """No rig, not this one or more than one is running."""


class Claim:
    """The right to run a rig, held by one process until it closes it or dies; a context manager."""

    def __init__(self, rig: str, lock: IO[str], path: Path, record: Record) -> None:
        self.rig = rig
        self.record = record
        self._lock = lock
        self._path = path

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def update(self, **fields: Any) -> None:
        """Change fields of the record."""
        self.record = {**self.record, **fields}
        _write(self._path, self.record)

    def close(self) -> None:
        """Remove the record and let others run the rig; the second time does nothing."""
        if not self._lock.closed:
            self._path.unlink(missing_ok=True)
            self._lock.close()


def runtime_folder() -> Path:
    """Return the folder of the records, made for this user alone if it was not there.

    Raises:
        RuntimeRecordError: it cannot be made, or belongs to another user.
    """
    folder = _folder_path()
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        owner = folder.stat().st_uid
    except OSError as error:
        raise RuntimeRecordError(
            f"{folder}: {error.strerror}; set RIGTWIN_RUNTIME_DIR to another folder"
        ) from None
    if owner != os.getuid():
        raise RuntimeRecordError(
            f"{folder} belongs to another user: set RIGTWIN_RUNTIME_DIR to a folder of yours"
        )
    return folder


def claim(rig: str, record: Record) -> Claim:
    """Claim a rig for this process and write its record.

    Args:
        rig: name of the rig.
        record: what others need to find it: mode, host, ports, ...; `rig` and `pid` are added.

    Raises:
        AlreadyRunning: another process runs this rig.
        RuntimeRecordError: the run-time folder cannot be used.
    """
    if rig == "*":
        raise ValueError("'*' cannot be the name of a rig")
    name = keys.part(rig)
    folder = runtime_folder()
    lock = (folder / f"{name}.lock").open("w")
    try:
        if not _locked(lock, fcntl.LOCK_EX, ATTEMPTS):
            raise AlreadyRunning(_already_running(rig, _read(folder / f"{name}.json")))
        complete = {"pid": os.getpid(), **record, "rig": rig}
        _write(folder / f"{name}.json", complete)
    except BaseException:
        lock.close()
        raise
    return Claim(rig, lock, folder / f"{name}.json", complete)


def all_running() -> dict[str, Record]:
    """Return the records of all rigs that run now, by name; those that died are left out."""
    folder = _folder_path()
    if not folder.is_dir():
        return {}
    records = ((path.stem, _read(path)) for path in sorted(folder.glob("*.json")))
    return {rig: record for rig, record in records if record and _is_held(folder / f"{rig}.lock")}


def running(rig: str | None = None) -> Record:
    """Return the record of a running rig, or of the only one when `rig` is None.

    Raises:
        NotRunning: it does not run, or which one is meant is not clear; the message lists what runs.
    """
    records = all_running()
    names = ", ".join(records)
    if rig is not None:
        if rig in records:
            return records[rig]
        what_runs = f"running now: {names}" if records else "no rig is running"
        raise NotRunning(
            f"rig {rig!r} is not running ({what_runs}): start it with 'rigtwin live --rig {rig}'"
        )
    if not records:
        raise NotRunning("no rig is running: start one with 'rigtwin live'")
    if len(records) > 1:
        raise NotRunning(f"several rigs are running ({names}): name one with --rig")
    return next(iter(records.values()))


def refuse_second(rig: str) -> None:
    """Raise `AlreadyRunning` when a process runs this rig: an early look, before anything is started."""
    record = all_running().get(rig)
    if record is not None:
        raise AlreadyRunning(_already_running(rig, record))


def _folder_path() -> Path:
    chosen = os.environ.get("RIGTWIN_RUNTIME_DIR")
    if chosen:
        return Path(chosen)
    session = os.environ.get("XDG_RUNTIME_DIR")
    if session:
        return Path(session) / "rigtwin"
    return Path(tempfile.gettempdir()) / f"rigtwin-{os.getuid()}"


def _locked(lock: IO[str], kind: int, attempts: int) -> bool:
    """Try to lock an open file; tell whether it worked."""
    for attempt in range(attempts):
        if attempt:
            time.sleep(PAUSE_S)
        try:
            fcntl.flock(lock, kind | fcntl.LOCK_NB)
        except BlockingIOError:
            continue
        return True
    return False


def _is_held(path: Path) -> bool:
    """Tell whether a process holds the lock."""
    try:
        with path.open() as lock:
            return not _locked(lock, fcntl.LOCK_SH, 1)
    except FileNotFoundError:
        return False


def _already_running(rig: str, record: Record | None) -> str:
    process = f"process {record['pid']}" if record else "another process"
    return f"rig {rig!r} is already running in {process}: end it with 'rigtwin shutdown --rig {rig}' first"


def _read(path: Path) -> Record | None:
    """Return a record; None when there is none that can be read."""
    try:
        record = json.loads(path.read_text())
    except (OSError, ValueError):
        return None
    return record if isinstance(record, dict) and "pid" in record else None


def _write(path: Path, record: Record) -> None:
    """Write a record so that nobody ever reads half of it."""
    draft = path.with_suffix(".new")
    draft.write_text(json.dumps(record, indent=1))
    draft.replace(path)
