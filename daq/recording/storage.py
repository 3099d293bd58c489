"""The file under a recording: written without a buffer, synced in a helper thread, watched for space."""

import errno
import os
import queue
import tempfile
import threading
from pathlib import Path

RESERVE = 4_000_000  # bytes of free space that are left for closing the file in order

REMEDIES = {
    errno.ENOTDIR: "a file, not a folder: record elsewhere",
    errno.ENOSPC: "the disk is full: free some space or record elsewhere",
    errno.EDQUOT: "the disk quota is used up: free some space or record elsewhere",
    errno.EFBIG: "the file has reached the largest size allowed here: raise the limit or record elsewhere",
    errno.EROFS: "the file system is read-only: record elsewhere",
    errno.EACCES: "no permission to write there: change it or record elsewhere",
    errno.EPERM: "no permission to write there: change it or record elsewhere",
    errno.ENOENT: "no file can be made there: record elsewhere",
}


class RecordingError(RuntimeError):
    """A recording that cannot be read or written: says which file, why, and what to do."""


def refusal(path: Path, error: OSError) -> RecordingError:
    """Return an operating system's error in plain words."""
    reason = REMEDIES.get(error.errno or 0, os.strerror(error.errno) if error.errno else str(error))
    return RecordingError(f"{path}: {reason}")


def prepare(path: str | Path) -> Path:
    """Make sure that a recording can be written at `path`: create its folder, overwrite nothing.

    Raises:
        RecordingError: something is there already, or the folder cannot be made or written.
    """
    path = Path(path).expanduser()
    if path.is_dir():
        raise RecordingError(f"{path} is a folder: name a file in it, such as {path / 'run.mcap'}")
    if path.exists():
        raise RecordingError(f"{path} exists already: recordings are never overwritten, choose another name")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path.parent) as file:
            full = free_space(file.fileno()) < 0
    except FileExistsError:
        raise RecordingError(f"{path.parent}: {REMEDIES[errno.ENOTDIR]}") from None
    except OSError as error:
        raise refusal(path.parent, error) from error
    if full:
        raise RecordingError(f"{path.parent}: {REMEDIES[errno.ENOSPC]}")
    return path


def free_space(fd: int) -> int:
    """Return how many bytes more an open file may take and be closed in order; below 0 when it may not."""
    space = os.fstatvfs(fd)
    return space.f_bavail * space.f_frsize - RESERVE


def part_path(path: str | Path, part: int) -> Path:
    """Return the file of a continuation: part 2 of `run.mcap` is `run.part2.mcap`."""
    path = Path(path)
    return path if part == 1 else path.with_name(f"{path.stem}.part{part}{path.suffix}")


def parts(path: str | Path) -> list[Path]:
    """Return the recording and its continuations, as far as they exist, in order."""
    found = [Path(path)]
    while (following := part_path(path, len(found) + 1)).exists():
        found.append(following)
    return found


class Storage:
    """A new file that takes bytes at its end; the MCAP writer's stream.

    What was written up to the last `mark` is kept whole: when a write fails, the file is cut back to it.

    Raises:
        RecordingError: the file exists, or the system refuses.
    """

    def __init__(self, path: Path) -> None:
        self.path = prepare(path)
        try:
            self._fd = os.open(self.path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise refusal(self.path, error) from error
        self.broken = False
        """Whether a write failed: the file then ends at the last mark."""
        self.space: float = float("inf")
        """Bytes that are free for more, as of the last sync."""
        self._position = 0
        self._marked = 0
        self._syncer = _Syncer(self._fd)

    def write(self, data: bytes) -> int:
        """Append bytes; on failure cut the file back to the last mark."""
        view = memoryview(data)
        try:
            while view:
                view = view[os.write(self._fd, view) :]
        except OSError as error:
            self.broken = True
            os.ftruncate(self._fd, self._marked)
            raise refusal(self.path, error) from error
        self._position += len(data)
        return len(data)

    def tell(self) -> int:
        """Bytes written."""
        return self._position

    def flush(self) -> None:
        """Do nothing: there is no buffer."""

    def mark(self) -> None:
        """Declare that the file is whole up to here."""
        self._marked = self._position

    def sync(self) -> None:
        """Have the helper thread bring what was written to the disk.

        Raises:
            RecordingError: an earlier sync failed, the disk is nearly full, or the file was removed.
        """
        self._syncer.request()
        if self._syncer.failure is not None:
            raise refusal(self.path, self._syncer.failure)
        if os.fstat(self._fd).st_nlink == 0:
            raise RecordingError(f"{self.path}: the file was removed while it was being written")
        self.space = free_space(self._fd)
        if self.space < 0:
            raise RecordingError(f"{self.path}: {REMEDIES[errno.ENOSPC]}")

    def close(self) -> None:
        """Sync and close the file and its folder's entry."""
        self._syncer.end()
        os.close(self._fd)
        folder = os.open(self.path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)


class _Syncer(threading.Thread):
    """Calls fdatasync when asked, so that the writing thread never waits for the disk."""

    def __init__(self, fd: int) -> None:
        super().__init__(name="sync", daemon=True)
        self.failure: OSError | None = None
        self._fd = fd
        self._requests: queue.Queue[bool] = queue.Queue(maxsize=1)
        self.start()

    def request(self) -> None:
        """Ask for one more sync; a request that is still waiting does for both."""
        try:
            self._requests.put_nowait(True)
        except queue.Full:
            return

    def end(self) -> None:
        """Sync a last time and end the thread."""
        self._requests.put(True)
        self._requests.put(False)
        self.join()

    def run(self) -> None:
        """Serve requests."""
        while self._requests.get():
            try:
                getattr(os, "fdatasync", os.fsync)(self._fd)
            except OSError as error:
                self.failure = error
