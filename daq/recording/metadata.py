"""What people tell of a run: `key=value` texts that go into the recording as they are."""

import re
from collections.abc import Sequence

from daq.recording.records import SEAL
from simulator.validation import RigError

KEY = re.compile(r"[a-z][a-z0-9_]{0,63}")
LONGEST = 1000
"""Characters of a value."""
USUAL = ("operator", "specimen", "purpose", "mounted_masses")
"""Keys that most laboratories want."""


def metadata_of(settings: Sequence[str]) -> dict[str, str]:
    """Return `key=value` texts as a mapping. Raises `RigError` for one that is none, or is given twice."""
    found: dict[str, str] = {}
    for setting in settings:
        key, equals, value = (part.strip() for part in setting.partition("="))
        if not equals or not KEY.fullmatch(key) or key == SEAL:
            raise RigError(
                f"--meta {setting}: write it as key=value, the key in small letters, digits and _, "
                f"as {', '.join(USUAL)}"
            )
        if key in found:
            raise RigError(f"--meta {setting}: {key} is given twice")
        if not 0 < len(value) <= LONGEST:
            raise RigError(f"--meta {setting}: the value must have 1 to {LONGEST} characters")
        found[key] = value
    return found
