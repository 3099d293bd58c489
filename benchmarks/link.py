"""Latency of the link against bare zenoh: blocks from process to process, and commands.

Run `python benchmarks/link.py [--json]`. Both sides of each pair carry the same bytes between the same two
processes, and take turns in changing order. With --json it prints one object {name: {value, unit,
baseline, ratio}}; values are medians over all rounds.
"""

import argparse
import json
import os
import random
import signal
import statistics
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from queue import SimpleQueue
from typing import Any, NamedTuple

import numpy as np
import zenoh

sys.path.insert(0, str(Path(__file__).parents[1]))

from daq.link import Link, free_ports
from daq.link.inbox import Inbox
from daq.messages import SeriesEncoder

STAMP = struct.Struct("<Q")
PERIOD_S = 0.002
OURS, BARE = "rig/bench/daq/block", "bare/block"
OUR_COMMAND, BARE_COMMAND = "rig/bench/daq/command/stop", "bare/command"
COMMAND = bytes(40)


class Result(NamedTuple):
    value: float
    unit: str
    baseline: float
    ratio: float


def bare_session(*, listen: list[str], connect: list[str]) -> zenoh.Session:
    """Open zenoh as its documentation does, only kept on loopback."""
    configuration = zenoh.Config()
    configuration.insert_json5("mode", '"peer"')
    configuration.insert_json5("scouting/multicast/enabled", "false")
    configuration.insert_json5("listen/endpoints", json.dumps(listen))
    configuration.insert_json5("connect/endpoints", json.dumps(connect))
    return zenoh.open(configuration)


def block_content() -> bytes:
    """Return a block of 11 channels by 250 samples without the 8 bytes that the benchmark puts before it."""
    names = [f"channel_{number:02}" for number in range(11)]
    encoder = SeriesEncoder("benchmark", 25000.0, names, ["m"] * 11)
    return encoder.encode(time.time(), 250_000, 0, np.ones((11, 250), dtype=np.float32))


def serve(our_port: int, bare_port: int) -> None:
    """Be the other process: publish stamped blocks as told on stdin and answer commands."""
    content = block_content()
    bare = bare_session(listen=[f"tcp/127.0.0.1:{bare_port}"], connect=[])
    with Link(listen=[f"tcp/127.0.0.1:{our_port}"]) as link:
        ours = link.publish(OURS, cache=3000)
        theirs = bare.declare_publisher(BARE)
        link.serve(OUR_COMMAND, lambda request: request.reply(request.payload))
        queryable = bare.declare_queryable(
            BARE_COMMAND, lambda query: query.reply(BARE_COMMAND, query.payload)
        )
        publish = {"ours": ours.put, "bare": theirs.put}
        print("ready", flush=True)
        for line in sys.stdin:
            variant, count = line.split()
            for _ in range(int(count)):
                time.sleep(PERIOD_S)
                publish[variant](STAMP.pack(time.monotonic_ns()) + content)
        queryable.undeclare()
    bare.close()


def receive_and_stop(port: int) -> None:
    """Be a subscriber that is stopped by the benchmark."""
    inbox = Inbox(100, "wait")
    with Link(connect=[f"tcp/127.0.0.1:{port}"]) as link:
        link.subscribe(OURS, inbox, recover=True)
        print("ready", flush=True)
        while not inbox.closed:
            inbox.get()


def start(*arguments: Any) -> subprocess.Popen[str]:
    """Start this file as another process and wait until it is ready."""
    process = subprocess.Popen(
        [sys.executable, __file__, *map(str, arguments)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    process.stdout.readline()
    return process


def end(process: subprocess.Popen[str]) -> None:
    """End a process that this file started."""
    process.kill()
    process.communicate()


def age(payload: bytes) -> float:
    """Return how long ago a block was published, in µs."""
    return (time.monotonic_ns() - STAMP.unpack_from(payload)[0]) / 1e3


def block_ages(
    server: subprocess.Popen[str], variant: str, take: Callable[[], float], count: int
) -> list[float]:
    """Let the server publish blocks and return their ages where they are consumed."""
    assert server.stdin is not None
    server.stdin.write(f"{variant} {count}\n")
    server.stdin.flush()
    return [take() for _ in range(count)]


def round_trips(ask: Callable[[], Any], count: int) -> list[float]:
    """Return how long each of some questions takes, in µs."""
    durations = []
    for _ in range(count):
        started = time.perf_counter_ns()
        ask()
        durations.append((time.perf_counter_ns() - started) / 1e3)
        time.sleep(PERIOD_S)
    return durations


def compare(ours: Callable[[], list[float]], bare: Callable[[], list[float]], rounds: int) -> Result:
    """Measure both in turns, in random order, and compare their medians."""
    measured: dict[str, list[float]] = {"ours": [], "bare": []}
    variants = {"ours": ours, "bare": bare}
    for _ in range(rounds):
        for name in random.sample(sorted(variants), 2):
            measured[name] += variants[name]()
    value, baseline = (statistics.median(measured[name]) for name in ("ours", "bare"))
    return Result(round(value, 1), "µs", round(baseline, 1), round(value / baseline, 3))


def measure(rounds: int, count: int) -> dict[str, Result]:
    """Run all comparisons."""
    our_port, bare_port = free_ports(2)
    server = start("serve", our_port, bare_port)
    bare = bare_session(listen=[], connect=[f"tcp/127.0.0.1:{bare_port}"])
    inbox = Inbox(1000, "wait")
    bare_ages: SimpleQueue[float] = SimpleQueue()
    subscriber = bare.declare_subscriber(BARE, lambda sample: bare_ages.put(age(sample.payload.to_bytes())))

    def our_age() -> float:
        message = inbox.get()
        assert message is not None
        return age(message[1])

    def bare_ask() -> bytes:
        return next(iter(bare.get(BARE_COMMAND, payload=COMMAND))).ok.payload.to_bytes()

    with Link(connect=[f"tcp/127.0.0.1:{our_port}"]) as link:
        link.subscribe(OURS, inbox, recover=True)
        time.sleep(0.5)

        def blocks() -> Result:
            return compare(
                lambda: block_ages(server, "ours", our_age, count),
                lambda: block_ages(server, "bare", bare_ages.get, count),
                rounds,
            )

        def commands() -> Result:
            return compare(
                lambda: round_trips(lambda: link.ask(OUR_COMMAND, COMMAND), count),
                lambda: round_trips(bare_ask, count),
                rounds,
            )

        results = {"block latency": blocks(), "command round trip": commands()}
        sleeper = start("sleep", our_port)
        os.kill(sleeper.pid, signal.SIGSTOP)
        results["command round trip, a subscriber stopped"] = commands()
    subscriber.undeclare()
    bare.close()
    end(sleeper)
    end(server)
    return results


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--rounds", type=int, default=80)
    parser.add_argument("--count", type=int, default=10, help="blocks or commands a round")
    arguments = parser.parse_args()
    results = measure(arguments.rounds, arguments.count)
    if arguments.json:
        print(json.dumps({name: result._asdict() for name, result in results.items()}, indent=1))
        return
    print(f"{'':<42}{'link':>10}{'bare zenoh':>12}{'ratio':>8}")
    for name, result in results.items():
        ours, bare = (f"{number:.0f} {result.unit}" for number in (result.value, result.baseline))
        print(f"{name:<42}{ours:>10}{bare:>12}{result.ratio:>8.2f}")


if __name__ == "__main__":
    if sys.argv[1:2] == ["serve"]:
        serve(int(sys.argv[2]), int(sys.argv[3]))
    elif sys.argv[1:2] == ["sleep"]:
        receive_and_stop(int(sys.argv[2]))
    else:
        main()
