"""The live acquisition process: one thread owns the hardware, the link's threads only hand it orders."""

import gc
import time
from collections.abc import Mapping
from contextlib import ExitStack
from datetime import UTC, datetime
from typing import Any
from uuid import uuid4

from daq import keys
from daq.acquisition import Acquisition
from daq.backend import Backend, BackendError, make_backend
from daq.commanding.orders import CommandOrder, EndOrder, LeaseOrder, Order, Orders
from daq.describe import EMULATED, LIVE, describe
from daq.link import Link, Publisher, Request
from daq.link.presence import Presence
from daq.parent import follow_parent
from daq.ports import with_free_ports
from daq.rig import Rig
from daq.runtime import claim

PROCESS = "daq"
STATUS_PERIOD = 0.1
CONTROL_LEASE_MS = 200
"""ms after which a process that is silent on the control link is given up."""
PATIENCE = 300.0
"""s that the processes waited for may take to come."""
REST_TIME = 15.0
"""s that the rotor may take to come to rest at the end."""
LINGER = 5.0
"""s that the recorder may take at the end to fetch what it missed."""
FAREWELL = 0.3
"""s that the last messages have to leave when nobody records."""
AWAY = 3.0
"""s at the end in which a recorder may come back that the link gave up, because it was stopped for long."""


class ServiceError(RuntimeError):
    """The acquisition process cannot start or go on; the message says why and what to do."""


class Outlet:
    """Publishes by key, with the cache that the service table gives to each."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._publishers: dict[str, Publisher] = {}

    def declare(self, *names: str) -> None:
        """Make the publishers of these keys before they are needed."""
        for key in names:
            self._publishers[key] = self._link.publish(key, cache=keys.topic(key).cache)

    def __call__(self, key: str, payload: bytes) -> None:
        """Publish one message."""
        self._publishers[key].put(payload)


class Service:
    """Runs an acquisition against the link until it is told to end.

    Args:
        rig: with the ports to listen on.
        backend: the device, not opened yet.
        run: run id.
        data: link for what is published.
        control: link for commands and the lease.
        meta: what people tell of the run.
    """

    def __init__(
        self, rig: Rig, backend: Backend, run: str, data: Link, control: Link, meta: Mapping[str, str]
    ) -> None:
        self._rig = rig
        self._meta = meta
        self._backend = backend
        self._data = data
        self._control = control
        self._orders = Orders()
        self._outlet = Outlet(data)
        self._run = run
        self._acquisition: Acquisition  # once the device is open, which tells what it can do
        self._presence = Presence(rig.name, data, control)
        self._told_to_end = False
        self._description = b""
        self._heard = time.monotonic()
        self._status_due = self._heard
        self._status_wall, self._status_cpu = self._heard, time.process_time()

    def run(self, wait_for: tuple[str, ...], duration: float | None) -> None:
        """Wait for others, acquire until the end, bring the rig to rest. Raises `ServiceError`."""
        self._declare()
        follow_parent(self._orders.end)
        self._backend.open(self._rig)
        self._acquisition = Acquisition(self._rig, self._backend, self._outlet, run=self._run)
        self._control.announce(keys.alive(self._rig.name, PROCESS))
        self._data.announce(keys.alive(self._rig.name, PROCESS))
        self._wait_for(wait_for)
        if self._told_to_end:
            return
        gc.collect()
        gc.freeze()
        self._begin()
        try:
            self._acquire(duration)
        except BackendError as error:
            self._acquisition.fail(str(error))
            self._finish()
            raise
        self._finish()

    def _declare(self) -> None:
        name = self._rig.name
        self._outlet.declare(
            keys.block(name),
            keys.event(name, PROCESS),
            keys.summary(name),
            keys.status(name, PROCESS),
            *([keys.truth(name)] if self._backend.capabilities.emulated else []),
            *(keys.channel_summary(name, channel) for channel in self._rig.channels.names),
        )
        self._data.serve(keys.description(name), self._describe)
        self._orders.take_commands(self._control, name)
        self._orders.hear_holder(self._control, name)

    def _describe(self, request: Request) -> None:
        """Answer with the run's description, once there is one."""
        if self._description:
            request.reply(self._description)

    def _wait_for(self, processes: tuple[str, ...]) -> None:
        deadline = time.monotonic() + PATIENCE
        while (missing := self._presence.missing(processes)) and not self._told_to_end:
            if time.monotonic() > deadline:
                names = " and ".join(missing)
                raise ServiceError(f"{names} did not come within {PATIENCE:.0f} s: nothing was started")
            self._serve(0.02)

    def _begin(self) -> None:
        acquisition = self._acquisition
        acquisition.begin()
        assert acquisition.start_time is not None
        emulated = self._backend.capabilities.emulated
        description = describe(self._rig, acquisition.run, acquisition.start_time, emulated, self._meta)
        self._description = description.SerializeToString(deterministic=True)
        print("ready", flush=True)

    def _acquire(self, duration: float | None) -> None:
        """Acquire until told to end, then until the rotor is at rest."""
        last = None if duration is None else round(duration * self._rig.acquisition.rate)
        while not self._told_to_end and (last is None or self._acquisition.sample < last):
            self._cycle()
        self._acquisition.rest()
        deadline = time.monotonic() + REST_TIME
        while not self._acquisition.at_rest and time.monotonic() < deadline:
            self._cycle()

    def _finish(self) -> None:
        """Publish the end and stay until the recorder has everything."""
        self._acquisition.end()
        patience = AWAY if self._presence.has_seen("recorder") else FAREWELL
        begun = last_there = time.monotonic()
        while not self._presence.has_seen(keys.RECORDED):
            now = time.monotonic()
            if "recorder" in self._presence:
                last_there = now
            if now > last_there + patience or now > begun + LINGER:
                return
            self._serve(0.02)

    def _cycle(self) -> None:
        """Serve an order or wait until a read is there; then read it."""
        self._serve(self._acquisition.due())
        if self._acquisition.due() <= 0.0:
            self._acquisition.step()

    def _serve(self, timeout: float) -> None:
        """Wait for an order at most so long and obey it; keep lease and status up to date."""
        order = self._orders.get(timeout)
        if order is not None:
            self._obey(order)
        now = time.monotonic()
        self._acquisition.elapse(now - self._heard)
        self._heard = now
        if now >= self._status_due:
            self._publish_status(now)

    def _obey(self, order: Order) -> None:
        if isinstance(order, CommandOrder):
            self._acquisition.serve(order.command, order.reply)
        elif isinstance(order, LeaseOrder):
            self._acquisition.renew(order.lease)
        elif isinstance(order, EndOrder):
            self._told_to_end = True

    def _publish_status(self, now: float) -> None:
        cpu = time.process_time()
        status = self._acquisition.status()
        status.monotonic_ns, status.utc_ns = time.monotonic_ns(), time.time_ns()
        status.queue_fill = self._orders.fill
        status.cpu = (cpu - self._status_cpu) / max(now - self._status_wall, 1e-9)
        self._outlet(keys.status(self._rig.name, PROCESS), status.SerializeToString())
        self._status_wall, self._status_cpu = now, cpu
        self._status_due = max(self._status_due + STATUS_PERIOD, now)


def acquire(
    rig: Rig,
    run: str = "",
    wait_for: tuple[str, ...] = (),
    duration: float | None = None,
    meta: Mapping[str, str] | None = None,
) -> None:
    """Acquire a run of a rig and return after its orderly end.

    Args:
        rig: ports that are 0 are replaced by free ones.
        run: run id; empty to make one.
        wait_for: processes that must be there before sample 0.
        duration: s after which the run ends by itself.
        meta: what people tell of the run: operator, specimen, purpose, ...

    Raises:
        AlreadyRunning: another process acquires this rig.
        LinkError: a port is in use.
        BackendError: the device is missing, busy or has failed.
        ServiceError: a process that was waited for did not come.
    """
    rig = with_free_ports(rig)
    link = rig.link
    with ExitStack() as stack:
        backend = make_backend(rig.acquisition.backend)
        stack.callback(backend.close)
        stack.enter_context(claim(rig.name, _record(rig, backend)))
        data = stack.enter_context(Link(listen=[link.endpoint("daq")]))
        control = stack.enter_context(Link(listen=[link.endpoint("control")], lease_ms=CONTROL_LEASE_MS))
        service = Service(rig, backend, run or new_run_id(), data, control, meta or {})
        service.run(wait_for, duration)


def new_run_id() -> str:
    """Return an id that no other run has and that sorts by time."""
    return f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}-{uuid4().hex[:4]}"


def _record(rig: Rig, backend: Backend) -> dict[str, Any]:
    """Return what others need to find this run."""
    mode = EMULATED if backend.capabilities.emulated else LIVE
    return {"mode": mode, **rig.link._asdict(), "toml": rig.toml}
