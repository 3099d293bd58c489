"""Answers that were given, so that a request that comes again is answered and not performed a second time."""

from collections import OrderedDict

from daq.messages_pb2 import Answer

KEPT = 256
"""Answers that are remembered; whoever asks again does so within seconds."""


class Answers:
    """The newest answers by the id of their request; a request without an id is not remembered."""

    def __init__(self) -> None:
        self._given: OrderedDict[str, Answer] = OrderedDict()

    def get(self, request: str) -> Answer | None:
        """Return the answer to a request; None when it is new."""
        return self._given.get(request)

    def keep(self, request: str, answer: Answer) -> None:
        """Remember the answer to a request."""
        if not request:
            return
        self._given[request] = answer
        if len(self._given) > KEPT:
            self._given.popitem(last=False)
