"""Players in processes of their own, and a subscriber that hears all that they publish."""

import time

from daq import keys
from daq.link import Inbox, Link
from daq.messages_pb2 import Event
from tests.daq.broadcast import PATIENCE
from tests.daq.recorded_run import RIG


class Listener:
    """A subscriber to everything that announces itself and goes when it has read the end."""

    def __init__(self, rig, name: str = "twin", pause: float = 0.0) -> None:
        self.link = Link(connect=[rig.link.endpoint("daq")])
        self.got: list[tuple[str, bytes]] = []
        self.arrived: list[float] = []
        self._pause = pause
        self._inbox = Inbox(64, "wait")
        self.link.subscribe(keys.everything(RIG), self._inbox, recover=True)
        self.link.announce(keys.alive(RIG, name))

    def take(self) -> tuple[str, bytes] | None:
        return self._inbox.get(PATIENCE)

    def listen(self) -> list[tuple[str, bytes]]:
        """Take everything up to the end event; return it without the statuses."""
        while True:
            item = self.take()
            assert item is not None, "the replay fell silent"
            if item[0].endswith("/status"):
                continue
            self.got.append(item)
            self.arrived.append(time.monotonic())
            time.sleep(self._pause)
            if item[0] == keys.event(RIG, "daq") and Event.FromString(item[1]).kind == "end":
                self.leave()
                return self.got

    def leave(self) -> None:
        self._inbox.close()
        self.link.close()
