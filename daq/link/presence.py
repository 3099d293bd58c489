"""Which processes of a rig are there, told by the link."""

from collections.abc import Callable

from daq import keys
from daq.link import Link


class Presence:
    """Follows the announcements of a rig's processes on one or more links."""

    def __init__(self, rig: str, *links: Link) -> None:
        self._seen: list[set[str]] = []
        for link in links:
            seen: set[str] = set()
            self._seen.append(seen)
            link.watch(keys.alive(rig, "*"), _follow(seen))

    def __contains__(self, process: str) -> bool:
        return any(process in seen for seen in self._seen)

    def missing(self, processes: tuple[str, ...]) -> list[str]:
        """Return those of `processes` that are not there."""
        return [process for process in processes if process not in self]


def _follow(seen: set[str]) -> Callable[[str, bool], None]:
    def change(key: str, is_there: bool) -> None:
        (seen.add if is_there else seen.discard)(keys.process_of(key))

    return change
