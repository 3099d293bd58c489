"""A plan performed without a network, as fast as the computer goes: what `simulate` and `plan check` run."""

from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from daq import keys
from daq.acquisition import Acquisition
from daq.backend import make_backend
from daq.commanding.operation import Operation
from daq.commanding.plan import Plan
from daq.events import Publish
from daq.messages_pb2 import Event, Summary
from daq.rig import Rig

REST_TIME = 15.0
"""s that the rotor is given to come to rest at the end."""


class Outcome(NamedTuple):
    """What came of a plan: samples made, and why it was cut short (empty when it was not)."""

    samples: int
    aborted: str


def perform(
    rig: Rig,
    plan: Plan,
    publish: Publish,
    *,
    run: str,
    t0_ns: int,
    progress: Callable[[int], object] = lambda sample: None,
) -> Outcome:
    """Perform a plan on the rig's model and publish what daq and operator would publish live.

    Args:
        rig: with a model, which the emulator stands for whatever the rig's own backend is.
        plan: what to do.
        publish: takes key and payload of each message, in order.
        run: run id.
        t0_ns: UTC given to sample 0, ns since 1970; equal inputs then give equal bytes.
        progress: called with the sample index after each read.

    Raises:
        RigError: the rig has no model.
        BackendError: the model cannot be simulated.
    """
    backend = make_backend("emulator", paced=False)
    backend.open(rig)
    try:
        return _Performance(rig, plan, publish, progress).run(
            lambda tap: Acquisition(rig, backend, tap, run=run, t0_ns=t0_ns)
        )
    finally:
        backend.close()


class _Performance:
    """Daq and operator in one thread: each hears what the other publishes after every read."""

    def __init__(self, rig: Rig, plan: Plan, publish: Publish, progress: Callable[[int], object]) -> None:
        self._publish = publish
        self._progress = progress
        self._rate = rig.acquisition.rate
        self._summary_key, self._event_key = keys.summary(rig.name), keys.event(rig.name, "daq")
        self._operator_key = keys.event(rig.name, "operator")
        self._rig, self._plan = rig, plan
        self._heard: deque[Summary | Event] = deque()
        self._reason: str | None = None  # why the plan ended; None as long as it has not

    def run(self, make: Callable[[Publish], Acquisition]) -> Outcome:
        """Perform the plan on the acquisition that `make` gives for what is to hear all it publishes."""
        acquisition = make(self._hear)
        operation = Operation(self._rig, self._plan, acquisition.serve, self._hear_operator)
        acquisition.begin()
        while self._reason is None:
            self._step(acquisition, operation)
        acquisition.rest()
        latest = acquisition.sample + round(REST_TIME * self._rate)
        while not acquisition.at_rest and acquisition.sample < latest:
            self._step(acquisition, operation)
        acquisition.end()
        return Outcome(acquisition.sample, self._reason)

    def _step(self, acquisition: Acquisition, operation: Operation) -> None:
        acquisition.step()
        while self._heard:
            message = self._heard.popleft()
            if isinstance(message, Summary):
                operation.advance(message)
            else:
                operation.heed(message)
        self._progress(acquisition.sample)

    def _hear(self, key: str, payload: bytes) -> None:
        self._publish(key, payload)
        if key == self._summary_key:
            self._heard.append(Summary.FromString(payload))
        elif key == self._event_key:
            self._heard.append(Event.FromString(payload))

    def _hear_operator(self, payload: bytes) -> None:
        self._publish(self._operator_key, payload)
        event = Event.FromString(payload)
        if event.kind == "plan_end":
            self._reason = event.details["reason"] if event.details["completed"] == "no" else ""
