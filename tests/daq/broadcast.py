"""The made-up run of `recorded_run` on the wire, from a link that stands in for daq, twin and operator."""

import time
from collections.abc import Callable, Iterable
from pathlib import Path

from daq import keys
from daq.link import Link, free_ports
from daq.link.presence import Presence
from daq.rig import Rig, load_rig, with_ports
from tests.daq.recorded_run import RIG, Maker, description

PATIENCE = 60.0  # s: bound on every wait


def rig_with_ports(folder: Path) -> tuple[Rig, Path]:
    """A rig on free ports, and the file of its description."""
    rig = with_ports(load_rig(RIG), free_ports(4))
    path = folder / "rig.toml"
    path.write_text(rig.toml)
    return rig, path


def wait_until(condition: Callable[[], object], what: str) -> None:
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, f"waited in vain for {what}"
        time.sleep(0.01)


class Broadcast:
    """Publishes messages with the caches of the service table; a context manager."""

    def __init__(self, rig: Rig) -> None:
        self.link = Link(listen=[rig.link.endpoint("daq")])
        self.sent: list[tuple[str, bytes]] = []
        self.presence = Presence(RIG, self.link)
        self._publishers = {}
        self.link.serve(
            keys.description(RIG), lambda request: request.reply(description().SerializeToString())
        )
        self.link.announce(keys.alive(RIG, "daq"))

    def __enter__(self) -> "Broadcast":
        return self

    def __exit__(self, *_: object) -> None:
        self.link.close()

    def wait_for(self, process: str) -> None:
        wait_until(lambda: process in self.presence, process)

    def put(self, messages: Iterable[tuple[str, bytes]]) -> None:
        for key, payload in messages:
            if key not in self._publishers:
                self._publishers[key] = self.link.publish(key, cache=keys.topic(key).cache)
            self._publishers[key].put(payload)
            self.sent.append((key, payload))

    def put_blocks(self, first: int, end: int, pace: float = 0.002) -> None:
        """Publish everything of blocks `first` to `end - 1`, with a mark at each tenth."""
        make = Maker()
        for number in range(first, end):
            self.put(make.all(number))
            if number % 10 == 0:
                self.put([make.event(number * 250, number // 10, "mark", "operator")])
            time.sleep(pace)

    def finish(self, blocks: int) -> None:
        self.put([Maker().end(blocks)])
