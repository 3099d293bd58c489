"""Cost of recording against a bare mcap writer of the same messages, and speed of replay and check.

The messages are those of a simulated run. The bare writer takes them as the mcap package offers: chunks of
256 kB, zstd, no flush, no account of what came. Replay goes through a real link to another process'
subscriber, that reads every message; its baseline is real time. The recorder process, at real time, is
compared with a process that is a zenoh subscriber and a bare mcap writer and nothing else.
"""

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from statistics import mean

import zenoh
from mcap.writer import CompressionType, Writer

from benchmarks.report import Figure, medians, parser, rotated, show
from daq import keys
from daq.commanding.plan import load_plan
from daq.link import Inbox, Link, free_ports
from daq.messages_pb2 import Event, Status
from daq.recording import Message, Recording, RecordingWriter
from daq.rig import Rig, load_rig, with_ports
from rigtwin.simulate_command import simulate

RIG = "thesis-ball"
PATIENCE = 120.0
LIVE_SECONDS = 10.0


def bare(messages: list[Message], source: Recording, path: Path) -> None:
    """Write the messages as the mcap package's example does."""
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=256 * 1024, compression=CompressionType.ZSTD)
        writer.start()
        schema = writer.register_schema("rigtwin", "protobuf", b"")
        topics: dict[str, int] = {}
        for message in messages:
            if message.key not in topics:
                topics[message.key] = writer.register_channel(message.key, "protobuf", schema)
            writer.add_message(
                topics[message.key], message.log_time, message.payload, message.log_time, message.sequence
            )
        writer.finish()


def ours(messages: list[Message], source: Recording, path: Path) -> None:
    """Write the messages as the recorder does, flushed each 100 ms of the run."""
    with RecordingWriter(path, source.description) as writer:
        due = messages[0].log_time
        for message in messages:
            writer.add(message.key, message.payload)
            if message.log_time >= due:
                writer.flush()
                due += 100_000_000


def measure_writers(source: Recording, folder: Path, rounds: int) -> tuple[dict[str, float], dict[str, int]]:
    """Return CPU seconds and size in bytes of each writer."""
    messages = list(source.messages())
    writers: dict[str, Callable[[list[Message], Recording, Path], None]] = {"ours": ours, "bare": bare}
    seconds: dict[str, list[float]] = {name: [] for name in writers}
    sizes = {}
    for order in rotated(list(writers), rounds):
        for name in order:
            path = folder / "written.mcap"
            began = time.process_time()
            writers[name](messages, source, path)
            seconds[name].append(time.process_time() - began)
            sizes[name] = path.stat().st_size
            path.unlink()
    return medians(seconds), sizes


def listen(rig: Rig) -> float:
    """Read a replay to its end; return the seconds from the first block to the last."""
    inbox = Inbox(1024, "wait")
    times = []
    with Link(connect=[rig.link.endpoint("daq")]) as link:
        link.subscribe(keys.everything(rig.name), inbox, recover=True)
        link.announce(keys.alive(rig.name, "twin"))
        while (item := inbox.get(PATIENCE)) is not None:
            if item[0] == keys.block(rig.name):
                times.append(time.monotonic())
            if item[0] == keys.event(rig.name, "daq") and Event.FromString(item[1]).kind == "end":
                break
        inbox.close()
    return times[-1] - times[0]


def replay_seconds(path: Path, folder: Path) -> float:
    """Play a recording as fast as it is taken; return how long that takes."""
    rig = with_ports(load_rig(RIG), free_ports(4))
    toml = folder / "replay.toml"
    toml.write_text(rig.toml)
    command = [sys.executable, "-P", "-m", "replay", "play", str(path), "--rig", str(toml)]
    options = ["--rate", "max", "--wait-for", "twin"]
    with (
        subprocess.Popen([*command, *options], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL) as player,
        ThreadPoolExecutor(1) as pool,
    ):
        seconds = pool.submit(listen, rig).result()
        player.wait(PATIENCE)
    return seconds


def recorder_shares(messages: list[Message], source: Recording, folder: Path) -> dict[str, float]:
    """Publish at real time to a recorder process and to a bare one; return the share of a core of each."""
    rig = with_ports(load_rig(RIG), free_ports(4))
    toml, path = folder / "record.toml", folder / "recorded.mcap"
    toml.write_text(rig.toml)
    endpoint = rig.link.endpoint("daq")
    record = [sys.executable, "-P", "-m", "twin", "record", "--rig", str(toml), "--file", str(path)]
    bare_record = [
        sys.executable,
        "-m",
        "benchmarks.recording",
        "--bare",
        endpoint,
        str(folder / "bare.mcap"),
    ]
    here: set[str] = set()
    with Link(listen=[endpoint]) as link:
        link.serve(
            keys.description(rig.name), lambda request: request.reply(source.description.SerializeToString())
        )
        link.announce(keys.alive(rig.name, "daq"))
        link.watch(keys.alive(rig.name, "*"), lambda key, alive: here.add(keys.process_of(key)))
        with (
            subprocess.Popen(record, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL) as recorder,
            subprocess.Popen(bare_record, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other,
        ):
            while not {"recorder", "bare"} <= here:
                time.sleep(0.05)
            publish(link, messages)
            recorder.stdin.close()
            bare_share = float(other.communicate()[0])
            link.close()
            recorder.wait(PATIENCE)
    with Recording(path) as recorded:
        statuses = [
            Status.FromString(m.payload) for m in recorded.messages(keys.status(rig.name, "recorder"))
        ]
    share = mean(status.cpu for status in statuses if status.sample > source.description.rate)
    return {"ours": share, "bare": bare_share}


def record_bare(endpoint: str, path: Path) -> None:
    """Be a recorder made of nothing but zenoh and mcap; print the share of a core that it takes."""
    configuration = zenoh.Config()
    configuration.insert_json5("mode", '"peer"')
    configuration.insert_json5("scouting/multicast/enabled", "false")
    configuration.insert_json5("listen/endpoints", "[]")
    configuration.insert_json5("connect/endpoints", json.dumps([endpoint]))
    topics: dict[str, int] = {}
    with path.open("wb") as file, zenoh.open(configuration) as session:
        writer = Writer(file, chunk_size=256 * 1024, compression=CompressionType.ZSTD)
        writer.start()
        schema = writer.register_schema("rigtwin", "protobuf", b"")

        def take(sample: zenoh.Sample) -> None:
            key = str(sample.key_expr)
            if key not in topics:
                topics[key] = writer.register_channel(key, "protobuf", schema)
            now = time.time_ns()
            writer.add_message(topics[key], now, sample.payload.to_bytes(), now)

        subscriber = session.declare_subscriber("rig/**", take)
        token = session.liveliness().declare_token(keys.alive(RIG, "bare"))
        while not topics:
            time.sleep(0.05)
        time.sleep(1.0)
        wall, cpu = time.monotonic(), time.process_time()
        sys.stdin.read()
        print((time.process_time() - cpu) / (time.monotonic() - wall))
        token.undeclare()
        subscriber.undeclare()
        writer.finish()


def publish(link: Link, messages: list[Message]) -> None:
    """Publish the messages at the pace of the run."""
    publishers = {key: link.publish(key, cache=keys.topic(key).cache) for key in {m.key for m in messages}}
    begun = time.monotonic()
    for message in messages:
        wait = begun + (message.log_time - messages[0].log_time) / 1e9 - time.monotonic()
        if wait > 0.0:
            time.sleep(wait)
        publishers[message.key].put(message.payload)


def check_seconds(path: Path) -> float:
    """Return how long it takes to make the account of a recording anew."""
    began = time.monotonic()
    with Recording(path) as recording:
        recording.check()
    return time.monotonic() - began


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--rounds", type=int, default=5)
    options.add_argument("--plan", default="resonance")
    options.add_argument(
        "--bare", nargs=2, metavar=("ENDPOINT", "FILE"), help="be the recorder compared with"
    )
    chosen = options.parse_args()
    if chosen.bare:
        record_bare(chosen.bare[0], Path(chosen.bare[1]))
        return
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rig, path = load_rig(RIG), folder / "run.mcap"
        outcome = simulate(rig, load_plan(chosen.plan, rig), path)
        duration = outcome.samples / rig.acquisition.rate
        with Recording(path) as source:
            seconds, sizes = measure_writers(source, folder, chosen.rounds)
            last = source.description.t0_ns + int(LIVE_SECONDS * 1e9)
            live = [message for message in source.messages() if message.log_time < last]
            shares = recorder_shares(live, source, folder)
        speeds = [duration / replay_seconds(path, folder) for _ in range(chosen.rounds)]
        checks = [duration / check_seconds(path) for _ in range(chosen.rounds)]
    per_second = {name: value / duration for name, value in seconds.items()}
    figures = {
        "writer_cpu": Figure(per_second["ours"], "core", per_second["bare"], "bare mcap writer"),
        "file_size": Figure(sizes["ours"] / 1e6, "MB", sizes["bare"] / 1e6, "bare mcap writer"),
        "recorder_cpu": Figure(
            shares["ours"], "core", shares["bare"], "bare zenoh subscriber and mcap writer"
        ),
        "replay_speed": Figure(sorted(speeds)[len(speeds) // 2], "s/s", 1.0, "real time"),
        "check_speed": Figure(sorted(checks)[len(checks) // 2], "s/s", 1.0, "real time"),
    }
    show(figures, chosen.json)


if __name__ == "__main__":
    main()
