"""Optional packages: imported when they are needed, and where one is missing, one line that says so."""

from importlib import import_module
from typing import Any


class MissingPackage(RuntimeError):
    """An optional package that is not installed; the message names it and how to install it."""


def optional(module: str, purpose: str, extra: str) -> Any:
    """Return an optional module.

    Args:
        module: its name.
        purpose: what needs it, for the message.
        extra: the extra of this product that installs it.

    Raises:
        MissingPackage: it is not installed.
    """
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        if error.name != module.partition(".")[0]:
            raise
        raise MissingPackage(
            f"{purpose} needs the package {error.name}: pip install 'rigtwin[{extra}]'"
        ) from error
