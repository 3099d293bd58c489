"""Compilation of the numeric kernels and where their machine code is kept.

`kernel` and `inlined` are the decorators of the product's compiled functions: `inlined` puts a small one into
each of its callers, which saves passing the model's sixty numbers but costs compile time where the
function is large or called in many places. The machine code is cached in the user's cache folder, so that
it survives a restart and works where the installed package is read-only.
numba notices an edit of a cached function's own file but not of a function that it calls from another
file; therefore the folder is named after a digest of all sources that a kernel may call.
"""

import hashlib
import os
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., Any])

HERE = Path(__file__).parent


def kernel(function: Function) -> Function:
    """Compile `function` on its first call; release the interpreter's lock while it runs.

    Divisions by zero give infinities as in numpy. Floating-point operations are neither reordered nor
    fused, so that equal inputs give equal bits. It can make no array: without numba's runtime nobody counts
    who uses one, which for the observer's thirty took as long as its arithmetic.
    """
    return compiled(function, inline=False)


def inlined(function: Function) -> Function:
    """Compile `function` as `kernel` does, into each of its callers."""
    return compiled(function, inline=True)


def compiled(function: Function, inline: bool) -> Function:
    """Return numba's dispatcher for a function; to a type checker it is the function."""
    folder = cache_folder(Path(function.__code__.co_filename).parent)
    settings: Any = numba.config
    previous = settings.CACHE_DIR
    settings.CACHE_DIR = str(folder or "")
    try:
        options: Any = {"cache": folder is not None, "nogil": True, "error_model": "numpy", "_nrt": False}
        return cast(Function, numba.njit(forceinline=inline, **options)(function))
    finally:
        settings.CACHE_DIR = previous


@cache
def cache_folder(package: Path) -> Path | None:
    """Return the writable folder for the kernels in `package`, or None where nothing can be written."""
    name = source_digest(package)
    for base in cache_bases():
        folder = base / "kernels" / name
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK | os.X_OK) and owned(base):
            return folder
    return None


def cache_bases() -> list[Path]:
    """Return the folders to try in turn: the one asked for, the user's cache, a private temporary one."""
    bases = [user_cache() / "rigtwin", Path(tempfile.gettempdir()) / f"rigtwin-{user_name()}"]
    asked = os.environ.get("NUMBA_CACHE_DIR")
    return [Path(asked) / "rigtwin", *bases] if asked else bases


def user_cache() -> Path:
    """Return the operating system's folder for a user's caches."""
    if os.environ.get("XDG_CACHE_HOME"):
        return Path(os.environ["XDG_CACHE_HOME"])
    if sys.platform == "win32" and os.environ.get("LOCALAPPDATA"):
        return Path(os.environ["LOCALAPPDATA"])
    if sys.platform == "darwin":
        return Path("~/Library/Caches").expanduser()
    return Path("~/.cache").expanduser()


def user_name() -> str:
    """Return what tells users of one machine apart."""
    return str(os.getuid()) if hasattr(os, "getuid") else os.environ.get("USERNAME", "user")


def owned(folder: Path) -> bool:
    """Tell whether the folder is this user's own: machine code is loaded from it."""
    return not hasattr(os, "getuid") or folder.stat().st_uid == os.getuid()


def source_digest(package: Path) -> str:
    """Return a digest of the sources that a kernel in the folder `package` may be made of.

    Those are all of this package, and in another package the files that use this module.
    """
    sources = [path.read_bytes() for path in sorted(HERE.glob("*.py"))]
    if package != HERE:
        others = (path.read_bytes() for path in sorted(package.glob("*.py")))
        sources += [source for source in others if b"simulator.compile" in source]
    return hashlib.sha256(b"\0".join(sources)).hexdigest()[:16]
