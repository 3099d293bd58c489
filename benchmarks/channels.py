"""What more channels cost the daq at 25 kHz: its share of a core, and how many channels one core carries.

The device is a copy of noise that is always there, so that only the daq's own work counts: calibration,
protection of every sample, blocks, summaries, encoding and the link. The bare baseline encodes and publishes
the same blocks and does nothing else. The link has no subscriber.
"""

import time
from functools import partial

import numpy as np
import tomli_w
from numpy.typing import NDArray

from benchmarks.report import Figure, in_turns, parser, show
from daq import keys, protection
from daq.acquisition import Acquisition
from daq.backend import Capabilities, Output, Reading, RestOutput
from daq.guard import guard_of
from daq.link import Link, free_ports
from daq.messages import SeriesEncoder
from daq.rig import Rig, rig_from_text
from daq.service import Outlet

RATE, READ, BLOCK = 25_000.0, 50, 250
SECONDS = 2.0  # of samples for each measurement
COUNTS = (12, 48)
MOST = 3072


class NoiseCard:
    """A device that has always samples, the same again and again."""

    capabilities = Capabilities((1.0, 1e9), (RestOutput,), False, None, False, False)

    def open(self, rig: Rig) -> None:
        self._volts = np.random.default_rng(1).normal(0.0, 0.01, (len(rig.channels), READ))

    def start(self) -> None:
        self._next = 0

    def clock(self) -> int:
        return self._next

    def read(self, out: NDArray[np.float64]) -> Reading:
        out[:] = self._volts
        first, self._next = self._next, self._next + READ
        return Reading(first, READ, 0)

    def write(self, output: Output, at_sample: int | None = None) -> int:
        return self._next

    def stop(self) -> None:
        return

    close = stop


def rig_of(count: int) -> Rig:
    """A rig of so many channels: in each dozen four probes, a tachometer, the rest accelerations."""
    rows = [row(number) for number in range(count)]
    level = {"persistence": 0.001, "reason": "a benchmark"}
    tables = {
        "rig": {"name": "many", "description": "for a benchmark"},
        "acquisition": {"backend": "noise", "rate": RATE, "read": READ, "block": BLOCK},
        "command": {"max_speed_hz": 1.0, "max_ramp_hz_per_s": 1.0, "default_ramp_hz_per_s": 1.0},
        "safe_state": {"ramp_hz_per_s": 1.0},
        "channel": rows,
        "limits": {
            "displacement": {"warn": 0.5, "trip": 0.9, **level},
            "speed": {"warn": 500.0, "trip": 900.0, **level},
        },
        "twin": {"model": "none"},
    }
    return rig_from_text(tomli_w.dumps(tables))


def row(number: int) -> dict[str, object]:
    """One row of the channel table."""
    dozen, place = divmod(number, 12)
    common = {"name": f"c{number}", "terminal": f"ai{number}", "sensitivity": 10.0, "offset": 0.0}
    common |= {"range": [-10.0, 10.0], "anti_alias": True}
    if place < 4:
        station = 0.01 + 0.02 * dozen % 4.0 + 0.01 * (place // 2)
        probe = {"quantity": "displacement", "unit": "m", "display_unit": "mm", "ok": [-9.0, 9.0]}
        return common | probe | {"station": station, "angle_deg": 45.0 + 90.0 * (place % 2)}
    if place == 4:
        return common | {"quantity": "speed", "unit": "rad/s", "display_unit": "Hz"}
    return common | {"quantity": "acceleration", "unit": "m/s2", "display_unit": "g"}


def daq_share(count: int) -> float:
    """Return the share of a core that the daq takes for so many channels."""
    rig, device = rig_of(count), NoiseCard()
    device.open(rig)
    with Link(listen=[f"tcp/127.0.0.1:{free_ports(1)[0]}"]) as link:
        outlet = Outlet(link)
        summaries = (keys.channel_summary(rig.name, name) for name in rig.channels.names)
        outlet.declare(keys.block(rig.name), keys.event(rig.name, "daq"), keys.summary(rig.name), *summaries)
        acquisition = Acquisition(rig, device, outlet, run="benchmark")
        acquisition.begin()
        began = time.process_time()
        while acquisition.sample < SECONDS * RATE:
            acquisition.step()
        return (time.process_time() - began) / SECONDS


def bare_share(count: int) -> float:
    """Return the share of a core that encoding and publishing alone take."""
    rig = rig_of(count)
    encoder = SeriesEncoder("benchmark", RATE, rig.channels.names, rig.channels.units)
    samples = np.random.default_rng(1).normal(0.0, 0.01, (count, BLOCK)).astype(np.float32)
    with Link(listen=[f"tcp/127.0.0.1:{free_ports(1)[0]}"]) as link:
        publisher = link.publish(keys.block(rig.name), cache=keys.topic(keys.block(rig.name)).cache)
        began = time.process_time()
        for first in range(0, round(SECONDS * RATE), BLOCK):
            publisher.put(encoder.encode(first / RATE, first, 0, samples))
        return (time.process_time() - began) / SECONDS


def protection_ms(count: int) -> float:
    """Return the time that checking all samples of one block takes, ms."""
    rig = rig_of(count)
    guard = guard_of(rig)
    state = protection.initial_state(guard)
    values = np.random.default_rng(1).normal(0.0, 0.01, (count, READ)).astype(np.float32)
    began, reads = time.process_time(), 2000
    for number in range(reads):
        state = protection.check(values, number * READ, state, guard).state
    return 1e3 * (time.process_time() - began) / reads * (BLOCK / READ)


def largest() -> int:
    """Return the largest number of dozens of channels that one core carries, in channels."""
    low, high = 1, MOST // 12  # dozens
    while high - low > max(1, low // 16):
        middle = (low + high) // 2
        if daq_share(12 * middle) < 1.0:
            low = middle
        else:
            high = middle
    return 12 * low


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--rounds", type=int, default=3)
    chosen = options.parse_args()
    measures = {"daq": daq_share, "bare": bare_share, "protection": protection_ms}
    middle = in_turns(
        {
            f"{name}_{count}": partial(measure, count)
            for name, measure in measures.items()
            for count in COUNTS
        },
        chosen.rounds,
    )
    figures = {}
    for count in COUNTS:
        bare = middle[f"bare_{count}"]
        figures[f"daq_cpu_{count}"] = Figure(
            middle[f"daq_{count}"], "core", bare, "encoding and publishing alone"
        )
        block = 1e3 * BLOCK / RATE
        figures[f"protection_{count}"] = Figure(
            middle[f"protection_{count}"], "ms", block, "a block's length"
        )
    figures["largest"] = Figure(float(largest()), "channels", 12.0, "the thesis' rig")
    show(figures, chosen.json)


if __name__ == "__main__":
    main()
