"""Time from a limit's crossing to the device's reaction, idle and loaded, and what protection costs.

A trip's time is counted in samples on the device's own clock: from the sample on which the limit was crossed
for the whole persistence to the one at which the safe state takes effect. Baseline of the latency: one read,
the device's own latency and nothing else, which no software can be faster than. Baseline of protection's
cost: the duration of the read that it checks.
"""

import multiprocessing
import os
import time
import timeit
from collections.abc import Iterator
from contextlib import contextmanager
from random import Random

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Figure, parser, show
from daq.acquisition import Acquisition
from daq.backend import Reading
from daq.backends.emulator import Emulator
from daq.guard import guard_of
from daq.link import Link, free_ports
from daq.messages_pb2 import Command, Event
from daq.protection import check, initial_state
from daq.rig import Rig, load_rig, with_ports
from daq.service import Outlet
from rigtwin.crew import NICENESS, set_niceness

CROSSING = 450.0  # N, above the shipped trip level of 400 N
PATIENCE = 10.0  # s for one trip
FIRST, LAST = 100, 399  # samples from one arming to its crossing: any place within a read, equally often
CALLS, ROUNDS = 500, 5
Samples = NDArray[np.float64]


class Crossing(Emulator):
    """The emulated rig with a force that steps above its limit at a given sample, until told otherwise."""

    def __init__(self, rig: Rig) -> None:
        super().__init__()
        self.at: int | None = None
        self._row = rig.channels.index("force_top")
        self._volts = rig.channels["force_top"].sensitivity * CROSSING

    def read(self, out: Samples) -> Reading:
        """Read, and let the force be above its limit from the crossing on."""
        reading = super().read(out)
        if self.at is not None:
            begin = max(0, self.at - reading.first_sample)
            out[self._row, begin : reading.n_samples] += self._volts
        return reading


class Trips:
    """Trips the acquisition again and again; publishes over a real link, as the daq does."""

    def __init__(self, link: Link, rig: Rig) -> None:
        self._rig = rig
        self._device = Crossing(rig)
        self._outlet = Outlet(link)
        self._trip: Event | None = None
        self._lease = ""
        self._acquisition = Acquisition(rig, self._device, self._hear, run="benchmark")
        self._declared: set[str] = set()

    def run(self, count: int) -> list[int]:
        """Return for each trip the samples from the persistence's end to the device's reaction."""
        self._device.open(self._rig)
        self._acquisition.begin()
        random, found = Random(1), []
        persistence = guard_of(self._rig).conditions[1].persistence
        for _ in range(count):
            self._ask("arm")
            self._ask("speed", speed_hz=5.0)
            self._device.at = self._device.clock() + random.randint(FIRST, LAST)
            found.append(self._reaction() - (self._device.at + persistence - 1))
            self._device.at = None
            self._go(1)
            self._ask("reset")
        self._acquisition.end()
        self._device.close()
        return found

    def _reaction(self) -> int:
        """Acquire until the trip and return the sample at which the safe state takes effect."""
        self._trip = None
        deadline = time.monotonic() + PATIENCE
        while self._trip is None:
            if time.monotonic() > deadline:
                raise RuntimeError("the rig did not trip")
            self._go(1)
        return int(self._trip.details["effect_sample"])

    def _go(self, reads: int) -> None:
        for _ in range(reads):
            time.sleep(self._acquisition.due())
            self._acquisition.step()

    def _ask(self, name: str, **values: float) -> None:
        command = Command(name=name, who="benchmark", lease=self._lease, values=values)
        answer = self._acquisition.serve(command)
        if not answer.accepted:
            raise RuntimeError(f"{name}: {answer.text}")
        self._lease = answer.lease or self._lease

    def _hear(self, key: str, payload: bytes) -> None:
        if key not in self._declared:
            self._declared.add(key)
            self._outlet.declare(key)
        self._outlet(key, payload)
        if key.endswith("/event"):
            event = Event.FromString(payload)
            if event.kind == "trip":
                self._trip = event


def burn() -> None:
    """Use a whole core, as any other program would."""
    os.setpriority(os.PRIO_PROCESS, 0, 0)
    while True:
        pass


@contextmanager
def load(cores: int) -> Iterator[None]:
    """Keep so many cores busy."""
    burners = [multiprocessing.Process(target=burn, daemon=True) for _ in range(cores)]
    for each in burners:
        each.start()
    yield
    for each in burners:
        each.kill()
        each.join()


def latencies(rig: Rig, count: int, cores: int) -> dict[str, Figure]:
    """Return the distribution of the trips' times, ms."""
    with load(cores), Link(listen=[rig.link.endpoint("daq")]) as link:
        samples = np.array(Trips(link, rig).run(count))
    times = 1e3 * samples / rig.acquisition.rate
    least = 1e3 * rig.acquisition.read / rig.acquisition.rate + 1e3 * rig.emulator.latency
    state = f"{cores} cores loaded" if cores else "idle"
    shown = {f"p{share:g}": np.percentile(times, share) for share in (50, 99, 99.9)}
    shown["maximum"] = times.max()
    return {
        f"trip to reaction, {state}, {name}": Figure(
            float(value), "ms", least, "a read and the device's latency"
        )
        for name, value in shown.items()
    }


def cost(rig: Rig) -> Figure:
    """Return what protection adds to a read, µs."""
    guard = guard_of(rig)
    state = initial_state(guard)
    size = (len(rig.channels), rig.acquisition.read)
    samples = (1e-3 * np.random.default_rng(1).normal(size=size)).astype(np.float32)
    times = timeit.repeat(lambda: check(samples, 0, state, guard), number=CALLS, repeat=ROUNDS)
    return Figure(1e6 * min(times) / CALLS, "µs", 1e6 * rig.acquisition.read / rig.acquisition.rate, "a read")


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--trips", type=int, default=1000, help="of each kind (default: 1000)")
    options.add_argument("--cores", type=int, default=multiprocessing.cpu_count(), help="to load")
    chosen = options.parse_args()
    set_niceness(os.getpid(), NICENESS["daq"])  # as `rigtwin live` does
    rig = with_ports(load_rig("thesis-ball"), free_ports(4))
    figures = {"protection of one read": cost(rig)}
    for cores in (0, chosen.cores):
        figures |= latencies(rig, chosen.trips, cores)
    show(figures, chosen.json)


if __name__ == "__main__":
    main()
