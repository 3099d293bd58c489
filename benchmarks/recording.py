"""Cost of recording against a bare mcap writer of the same messages, and speed of replay and check.

The messages are those of a simulated run. The bare writer takes them as the mcap package offers: chunks of
256 kB, zstd, no flush, no account of what came. The recorder process, at real time, is compared with a
process that is a zenoh subscriber and a bare mcap writer and nothing else. Replay goes through a real link to
another process' subscriber, that reads every message; beside real time it is compared, in turns, with a
process that reads the same file with the mcap package and puts each message into zenoh, and nothing else.
"""

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from statistics import mean, median

import zenoh
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from benchmarks.report import Figure, in_turns, medians, parser, rotated, show
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
PLACES = ("ENDPOINT", "FILE")


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
    block, event = keys.block(rig.name), keys.event(rig.name, "daq")
    times = []
    with Link(connect=[rig.link.endpoint("daq")]) as link:
        link.subscribe(keys.everything(rig.name), inbox, recover=True)
        link.announce(keys.alive(rig.name, "twin"))
        while (item := inbox.get(PATIENCE)) is not None:
            if item[0] == block:
                times.append(time.monotonic())
            if item[0] == event and Event.FromString(item[1]).kind == "end":
                break
        inbox.close()
    return times[-1] - times[0]


def play_seconds(path: Path, folder: Path, *, bare: bool) -> float:
    """Play a recording as fast as it is taken; return how long that takes."""
    rig = with_ports(load_rig(RIG), free_ports(4))
    toml = folder / "replay.toml"
    toml.write_text(rig.toml)
    ours = [
        "-P",
        "-m",
        "replay",
        "play",
        str(path),
        "--rig",
        str(toml),
        "--rate",
        "max",
        "--wait-for",
        "twin",
    ]
    loop = ["-m", "benchmarks.recording", "--bare-player", rig.link.endpoint("daq"), str(path)]
    with (
        subprocess.Popen(
            [sys.executable, *(loop if bare else ours)], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL
        ) as player,
        ThreadPoolExecutor(1) as pool,
    ):
        seconds = pool.submit(listen, rig).result()
        player.stdin.close()
        player.wait(PATIENCE)
    return seconds


def play_bare(endpoint: str, path: Path) -> None:
    """Be a player made of nothing but mcap and zenoh: publish what a replay publishes, to whoever comes."""
    with path.open("rb") as file, bare_session(listen=[endpoint]) as session:
        reader = make_reader(file)
        topics = [channel.topic for channel in reader.get_summary().channels.values()]
        publishers = {
            topic: session.declare_publisher(topic, congestion_control=zenoh.CongestionControl.BLOCK)
            for topic in topics
            if keys.process_of(topic) != "twin" and keys.topic(topic).message != "Status"
        }
        while not all(publisher.matching_status.matching for publisher in publishers.values()):
            time.sleep(0.02)
        for _schema, channel, message in reader.iter_messages(list(publishers)):
            publishers[channel.topic].put(message.data)
        sys.stdin.read()


def bare_session(**endpoints: list[str]) -> zenoh.Session:
    """Return zenoh's session that listens or connects there and looks for nobody by itself."""
    configuration = zenoh.Config()
    configuration.insert_json5("mode", '"peer"')
    configuration.insert_json5("scouting/multicast/enabled", "false")
    for way in ("listen", "connect"):
        configuration.insert_json5(f"{way}/endpoints", json.dumps(endpoints.get(way, [])))
    return zenoh.open(configuration)


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
    topics: dict[str, int] = {}
    with path.open("wb") as file, bare_session(connect=[endpoint]) as session:
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
    options.add_argument("--bare", nargs=2, metavar=PLACES, help="be the recorder compared with")
    options.add_argument("--bare-player", nargs=2, metavar=PLACES, help="be the player compared with")
    chosen = options.parse_args()
    if chosen.bare:
        record_bare(chosen.bare[0], Path(chosen.bare[1]))
        return
    if chosen.bare_player:
        play_bare(chosen.bare_player[0], Path(chosen.bare_player[1]))
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
        players = {"ours": False, "bare": True}
        replays = in_turns(
            {name: partial(play_seconds, path, folder, bare=bare) for name, bare in players.items()},
            chosen.rounds,
        )
        checks = median(duration / check_seconds(path) for _ in range(chosen.rounds))
    speeds = {name: duration / value for name, value in replays.items()}
    per_second = {name: value / duration for name, value in seconds.items()}
    figures = {
        "writer_cpu": Figure(per_second["ours"], "core", per_second["bare"], "bare mcap writer"),
        "file_size": Figure(sizes["ours"] / 1e6, "MB", sizes["bare"] / 1e6, "bare mcap writer"),
        "recorder_cpu": Figure(
            shares["ours"], "core", shares["bare"], "bare zenoh subscriber and mcap writer"
        ),
        "replay_speed": Figure(speeds["ours"], "s/s", 1.0, "real time"),
        "replay_against_bare": Figure(
            speeds["ours"], "s/s", speeds["bare"], "bare mcap reader and zenoh put"
        ),
        "check_speed": Figure(checks, "s/s", 1.0, "real time"),
    }
    show(figures, chosen.json)


if __name__ == "__main__":
    main()
