"""Which processes of a rig are there, told by the link."""

from collections.abc import Callable

from daq import keys
from daq.link import Link


class Presence:
    """Follows the announcements of a rig's processes on one or more links."""

    def __init__(self, rig: str, *links: Link) -> None:
        self._there: list[set[str]] = []
        self._seen: set[str] = set()
        for link in links:
            there: set[str] = set()
            self._there.append(there)
            link.watch(keys.alive(rig, "*"), _follow(there, self._seen))

    def __contains__(self, process: str) -> bool:
        return any(process in there for there in self._there)

    def has_seen(self, process: str) -> bool:
        """Tell whether a process is there or has been."""
        return process in self._seen

    def missing(self, processes: tuple[str, ...]) -> list[str]:
        """Return those of `processes` that are not there."""
        return [process for process in processes if process not in self]


def _follow(there: set[str], seen: set[str]) -> Callable[[str, bool], None]:
    def change(key: str, is_there: bool) -> None:
        process = keys.process_of(key)
        if is_there:
            there.add(process)
            seen.add(process)
        else:
            there.discard(process)

    return change
