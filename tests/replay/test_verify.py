"""Running the twin again over recordings: as simulated, and as a live twin leaves them."""

import json
from pathlib import Path

import numpy as np
import pytest

import replay.verify
from daq import keys
from daq.messages import SeriesEncoder, decode_series
from daq.messages_pb2 import Description
from daq.recording import Recording, RecordingWriter
from daq.rig import rig_from_text
from recordings.reference import REFERENCES
from replay.verify import BOUND, DIFFERENT, EQUIVALENT, IDENTICAL, verify
from rigtwin.cli import main
from tests.daq.recorded_run import record
from twin.estimation import Twin
from twin.service import SHED

BALL = REFERENCES[0].path
RIG = "thesis-ball"
BLOCKS = 60  # of the reference recording that the runs below are made of
BLOCK = 250


@pytest.fixture(scope="module")
def blocks() -> list[bytes]:
    with Recording(BALL) as recording:
        return [message.payload for message in recording.messages(keys.block(RIG))][:BLOCKS]


@pytest.fixture(scope="module")
def description() -> Description:
    with Recording(BALL) as recording:
        return recording.description


def twin_of(description: Description) -> Twin:
    return Twin(rig_from_text(description.toml), description.run, description.t0_ns)


def observed(description: Description, blocks: list[bytes]) -> list[list[tuple[str, bytes]]]:
    """What a twin that sees every block publishes, block by block."""
    twin = twin_of(description)
    return [twin.process(payload) for payload in blocks]


def write(path: Path, description: Description, messages: list[tuple[str, bytes]], part: int = 1) -> Path:
    with RecordingWriter(path, description, part=part) as writer:
        for message in messages:
            writer.add(*message)
    return path


def shifted(payload: bytes, channel: str, column: int, by: float) -> bytes:
    """The same estimate with one value changed."""
    series = decode_series(payload)
    samples = series.samples.copy()
    samples[series.names.index(channel), column] += np.float32(by)
    encoder = SeriesEncoder(series.run, series.rate, series.names, series.units, series.stride)
    return encoder.encode(series.timestamp, series.first_sample, series.status, samples)


@pytest.fixture
def touched(tmp_path, description, blocks):
    """Return a function that records a run with one value of the estimate of block 40 changed."""

    def make(by: float) -> Path:
        messages = []
        for number, (block, made) in enumerate(zip(blocks, observed(description, blocks), strict=True)):
            messages.append((keys.block(RIG), block))
            for key, payload in made:
                if number == 40 and key == keys.estimate(RIG):
                    payload = shifted(payload, "displacement_x", 7, by)
                messages.append((key, payload))
        return write(tmp_path / "touched.mcap", description, messages)

    return make


@pytest.fixture
def elsewhere(monkeypatch):
    """Let this be another computer than the one that recorded."""
    real = replay.verify.numeric_fingerprint
    monkeypatch.setattr(replay.verify, "numeric_fingerprint", lambda: real() | {"functions": "others"})


@pytest.mark.parametrize("late_events", [False, True])
def test_what_a_live_twin_missed_is_missed_again(tmp_path, description, blocks, late_events):
    """It joins late, sheds blocks, is killed and started anew with blocks from the cache, and stops early."""
    first, second = twin_of(description), twin_of(description)
    messages = []
    for number, payload in enumerate(blocks):
        messages.append((keys.block(RIG), payload))
        if 5 <= number < 15 or 22 <= number < 40:
            messages += first.process(payload, SHED if number == 22 else "not received")
        if number == 44:  # the second one begins where the first one still was
            messages += [each for past in blocks[37:44] for each in second.process(past)]
        if 44 <= number < 55:
            messages += second.process(payload)
    if late_events:
        messages.sort(key=lambda message: message[0] == keys.event(RIG, "twin"))
    path = write(tmp_path / "live.mcap", description, messages)
    found = verify(path)
    assert (found.verdict, found.first, found.notes) == (IDENTICAL, None, ())
    assert (found.sessions, found.estimates) == (2, 10 + 18 + 15)


def test_blocks_that_were_recorded_late_come_in_their_order(tmp_path, description, blocks):
    made = observed(description, blocks)
    order = [*range(10), 12, 13, 10, 11, *range(14, BLOCKS)]
    messages = [(keys.block(RIG), blocks[number]) for number in order]
    path = write(tmp_path / "late.mcap", description, messages + [each for some in made for each in some])
    assert verify(path).verdict == IDENTICAL
    assert main(["twin", str(path), "-o", str(tmp_path / "again.mcap")]) == 0
    assert estimate_digest(tmp_path / "again.mcap") == estimate_digest(path)


def test_a_recording_in_parts_is_repeated_as_one(tmp_path, description, blocks, capsys):
    both = [
        [(keys.block(RIG), block), *made]
        for block, made in zip(blocks, observed(description, blocks), strict=True)
    ]
    whole = write(tmp_path / "run.mcap", description, [each for some in both[:30] for each in some])
    rest = Description.FromString(description.SerializeToString())
    rest.first_sample = 30 * BLOCK
    following = tmp_path / "run.part2.mcap"
    write(following, rest, [each for some in both[30:] for each in some], part=2)
    found = verify(whole)
    assert (found.verdict, found.estimates) == (IDENTICAL, BLOCKS)
    assert main(["verify", str(following)]) == 2
    assert "name the first one" in capsys.readouterr().err


def test_what_only_the_twin_saw_is_told(tmp_path, description, blocks):
    messages = []
    for number, (block, made) in enumerate(zip(blocks, observed(description, blocks), strict=True)):
        messages += [*([] if number in (30, 31) else [(keys.block(RIG), block)]), *made]
    found = verify(write(tmp_path / "lost.mcap", description, messages))
    assert found.verdict == DIFFERENT
    assert found.first is not None
    assert found.first.sample == 30 * BLOCK
    assert any("samples 7500 to 7999 reached the twin but not the recording" in note for note in found.notes)


def test_an_estimate_that_was_not_recorded_is_told(tmp_path, description, blocks):
    messages = []
    for number, (block, made) in enumerate(zip(blocks, observed(description, blocks), strict=True)):
        messages += [(keys.block(RIG), block), *([] if number == 30 else made)]
    found = verify(write(tmp_path / "lost.mcap", description, messages))
    assert found.verdict == IDENTICAL
    assert found.notes == ("estimates that the twin made but the recording lacks: 1",)


def test_one_changed_value_is_found(touched, capsys):
    path = touched(1e-9)
    assert main(["verify", str(path), "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert found["verdict"] == DIFFERENT
    assert (found["first"]["sample"], found["first"]["channel"]) == (40 * BLOCK + 7 * 5, "displacement_x")
    assert found["first"]["size"] == pytest.approx(1e-9, rel=0.1)
    assert main(["verify", str(path)]) == 1
    assert "first difference: sample 10035, displacement_x: recorded" in capsys.readouterr().out


@pytest.mark.usefixtures("elsewhere")
def test_another_computer_is_never_identical(touched, capsys):
    assert verify(BALL).verdict == EQUIVALENT
    assert main(["verify", str(BALL)]) == 0
    assert "every bit is equal" in capsys.readouterr().out


@pytest.mark.usefixtures("elsewhere")
@pytest.mark.parametrize(("share", "verdict"), [(0.7, EQUIVALENT), (1.4, DIFFERENT)])
def test_another_computer_has_a_bound(touched, share, verdict):
    with Recording(BALL) as recording:
        largest = np.abs(
            recording.series("estimate", ["displacement_x"], last=BLOCKS * BLOCK - 1).samples
        ).max()
    found = verify(touched(share * BOUND * largest))
    assert found.verdict == verdict
    assert found.largest > 0.0
    assert (found.largest <= BOUND) == (verdict == EQUIVALENT)
    assert (found.first is None) == (verdict == EQUIVALENT)


def test_an_altered_recording_proves_nothing(tmp_path, capsys):
    content = bytearray(BALL.read_bytes())
    content[len(content) // 2] ^= 1
    (tmp_path / "altered.mcap").write_bytes(content)
    assert main(["verify", str(tmp_path / "altered.mcap")]) == 1
    assert "the recording was altered" in capsys.readouterr().out


def test_a_recording_that_was_cut_off_is_repeated_as_far_as_it_goes(tmp_path, capsys):
    content = BALL.read_bytes()
    (tmp_path / "cut.mcap").write_bytes(content[: len(content) // 2])
    wanted = verify(BALL).verdict  # what it was made with stands at its beginning
    assert main(["verify", str(tmp_path / "cut.mcap")]) == 0
    said = capsys.readouterr().out
    assert f"cut.mcap: {wanted}" in said
    assert "cut.mcap is incomplete" in said
    main(["recover", str(tmp_path / "cut.mcap"), "-o", str(tmp_path / "mended.mcap")])
    assert verify(tmp_path / "mended.mcap").verdict == wanted


def test_the_twin_afresh_gives_what_it_gave(tmp_path, capsys):
    out = tmp_path / "again.mcap"
    assert main(["twin", str(BALL), "-o", str(out)]) == 0
    assert "certificate valid" in capsys.readouterr().out
    assert estimate_digest(out) == estimate_digest(BALL) or verify(BALL).verdict == EQUIVALENT
    with Recording(out) as made, Recording(BALL) as source:
        now, then = made.check().certificate.messages, source.check().certificate.messages
        told = keys.event(RIG, "twin")  # of which a later twin may tell more
        assert now | {told: 0} == then | {told: 0}
        assert made.notes["twin"]["source"] == BALL.name
    assert verify(out).verdict == IDENTICAL
    assert main(["twin", str(BALL), "-o", str(out)]) == 2
    assert "exists" in capsys.readouterr().err


def test_wrong_use_is_one_line(tmp_path, description, blocks, capsys):
    bare = write(tmp_path / "bare.mcap", description, [(keys.block(RIG), payload) for payload in blocks])
    record(tmp_path / "other.mcap", blocks=4)  # with other channels than its rig description's
    for arguments in (
        ["verify", str(bare)],
        ["verify", str(tmp_path / "none.mcap")],
        ["verify", str(tmp_path / "other.mcap")],
        ["twin", str(tmp_path / "other.mcap"), "-o", str(tmp_path / "out.mcap")],
    ):
        assert main(arguments) == 2
        said = capsys.readouterr().err
        assert said.startswith("rigtwin: ")
        assert said.count("\n") == 1
    assert main(["twin", str(bare), "-o", str(tmp_path / "made.mcap")]) == 0
    assert verify(tmp_path / "made.mcap").verdict == IDENTICAL


def estimate_digest(path: Path) -> str:
    with Recording(path) as recording:
        return recording.check().certificate.signal_digests["estimate"]
