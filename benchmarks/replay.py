"""How evenly a replay in real time comes out, against a bare loop that sleeps and publishes as much.

Jitter is how far the arrival of a block at a subscriber in another process is from an even spacing, less
the median: half of the blocks are nearer than the first figure, 99 of 100 nearer than the second. The bare
loop publishes messages of a block's size and period through the same link.
"""

import subprocess
import sys
import tempfile
import time
from pathlib import Path
from threading import Event as Flag

import numpy as np

from benchmarks.report import Figure, parser, show
from daq import keys
from daq.commanding.plan import load_plan
from daq.link import Link, free_ports
from daq.recording import Recording
from daq.rig import Rig, load_rig, with_ports
from rigtwin.simulate_command import simulate

RIG = "thesis-ball"
PATIENCE = 120.0
PUBLISH = "--publish"


def publish(endpoint: str, size: int, count: int, period: float) -> None:
    """Be the bare loop: wait for a subscriber, then publish evenly."""
    with Link(listen=[endpoint], wait_for_room=True) as link:
        publisher = link.publish(keys.block(RIG), wait=True)
        while not publisher.has_subscribers:
            time.sleep(0.02)
        payload, begun = bytes(size), time.monotonic()
        for number in range(count):
            time.sleep(max(0.0, begun + number * period - time.monotonic()))
            publisher.put(payload)
        time.sleep(1.0)


def arrivals(rig: Rig, command: list[str], count: int) -> list[float]:
    """Return when each of so many blocks of a publishing process arrives."""
    times: list[float] = []
    enough = Flag()

    def take(_key: str, _payload: bytes) -> None:
        times.append(time.monotonic())
        if len(times) == count:
            enough.set()

    with subprocess.Popen(
        [sys.executable, "-P", "-m", *command], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL
    ) as process:
        with Link(connect=[rig.link.endpoint("daq")]) as link:
            link.subscribe(keys.block(rig.name), take)
            link.announce(keys.alive(rig.name, "twin"))
            enough.wait(PATIENCE)
        process.stdin.close()
        process.wait(PATIENCE)
    return times


def jitter(times: list[float], period: float) -> tuple[float, float]:
    """Return the median and the 99th percentile of the distance from an even spacing, ms."""
    late = np.array(times) - period * np.arange(len(times))
    return tuple(1e3 * np.percentile(np.abs(late - np.median(late)), (50, 99)))


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--plan", default="impacts")
    options.add_argument(PUBLISH, nargs=4, metavar=("ENDPOINT", "SIZE", "COUNT", "PERIOD"))
    chosen = options.parse_args()
    if chosen.publish:
        endpoint, size, count, period = chosen.publish
        publish(endpoint, int(size), int(count), float(period))
        return
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rig = with_ports(load_rig(RIG), free_ports(4))
        toml, path = folder / "rig.toml", folder / "run.mcap"
        toml.write_text(rig.toml)
        simulate(rig, load_plan(chosen.plan, rig), path, twin=False)
        with Recording(path) as recording:
            sizes = [len(message.payload) for message in recording.messages(keys.block(RIG))]
        period = rig.acquisition.block / rig.acquisition.rate
        play = ["replay", "play", str(path), "--rig", str(toml), "--wait-for", "twin"]
        ours = jitter(arrivals(rig, play, len(sizes)), period)
        loop = ["benchmarks.replay", PUBLISH, rig.link.endpoint("daq"), str(sizes[0]), str(len(sizes))]
        bare = jitter(arrivals(rig, [*loop, str(period)], len(sizes)), period)
    figures = {
        "replay_jitter_median": Figure(ours[0], "ms", bare[0], "bare loop"),
        "replay_jitter_p99": Figure(ours[1], "ms", bare[1], "bare loop"),
    }
    show(figures, chosen.json)


if __name__ == "__main__":
    main()
