"""When a recorder goes on in the next part of its recording: by size or by time."""

import re
from typing import NamedTuple

UNITS = {"s": 1.0, "min": 60.0, "h": 3600.0, "MB": 1e6, "GB": 1e9}
SMALLEST = {"s": 1.0, "MB": 1e6}
"""Least part: one that holds less is not worth a file."""


class RotationError(ValueError):
    """Text that is no size and no time."""


class Rotation(NamedTuple):
    """How large a part of a recording may become."""

    seconds: float = float("inf")  # of the run
    size: float = float("inf")  # bytes

    def is_due(self, seconds: float, size: int) -> bool:
        """Whether a part as long and as large as that is full."""
        return seconds >= self.seconds or size >= self.size


def rotation(text: str) -> Rotation:
    """Return what `10min`, `2h`, `500MB` or `2GB` means.

    Raises:
        RotationError: it means nothing.
    """
    found = re.fullmatch(r"([0-9.]+) ?(s|min|h|MB|GB)", text.strip())
    try:
        value = float(found[1]) * UNITS[found[2]] if found else 0.0
    except ValueError:
        value = 0.0
    is_time = found is not None and found[2] in ("s", "min", "h")
    if value < SMALLEST["s" if is_time else "MB"]:
        raise RotationError(
            f"{text!r} is no size or time of a part: give one of at least 1 s or 1 MB, such as 10min or 500MB"
        )
    return Rotation(seconds=value) if is_time else Rotation(size=value)
