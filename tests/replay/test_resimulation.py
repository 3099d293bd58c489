"""The same commands at the same samples give the same signals, bit by bit."""

import pytest

from daq.backend import HitOutput, RestOutput, SpeedOutput
from daq.messages_pb2 import Event
from daq.recording import Recording, RecordingError, RecordingWriter
from daq.rig import load_rig
from recordings.reference import REFERENCES
from replay.outputs import Written, outputs_of
from replay.resimulation import resimulate
from replay.verify import IDENTICAL, verify
from tests.daq.recorded_run import Maker, description


@pytest.mark.parametrize("reference", REFERENCES, ids=lambda each: each.name)
def test_a_simulation_is_repeated_by_its_seed_and_by_its_commands(tmp_path, reference):
    paths = [tmp_path / "one.mcap", tmp_path / "two.mcap"]
    for path in paths:
        reference.simulate(path)
    resimulate(paths[0], tmp_path / "three.mcap")
    found = []
    for path in [*paths, tmp_path / "three.mcap"]:
        with Recording(path) as recording:
            assert recording.check().verdict == "valid"
            found.append((recording.certificate.received, recording.certificate.signal_digests))
    assert len(found[0][1]) == 3
    assert found[0] == found[1] == found[2]
    assert verify(tmp_path / "three.mcap").verdict == IDENTICAL


def event(kind: str, sample: int, effect: int, **details: str) -> Event:
    return Event(source="daq", kind=kind, sample=sample, details=details | {"effect_sample": str(effect)})


def test_a_rest_cancels_what_was_still_to_come():
    rig = load_rig("thesis-ball")
    hit = {"force": "20.0", "duration": "0.01", "solenoid": "horizontal"}
    events = [
        event("arm", 0, 0),
        event("speed", 10, 35, speed_hz="10.0"),
        event("hit", 40, 65, **hit),
        event("hit", 90, 400, **hit),
        event("stop", 100, 125),
        event("mark", 110, 110),
        Event(source="operator", kind="step", sample=120),
    ]
    turn = 6.283185307179586
    rest = RestOutput(rig.safe_state.ramp)
    assert outputs_of(events, rig) == [
        Written(10, 35, SpeedOutput(10.0 * turn, rig.command.default_ramp_hz_per_s * turn)),
        Written(40, 65, HitOutput("horizontal", 20.0, 0.01)),
        Written(100, 125, rest),
    ]


@pytest.mark.parametrize(
    ("changes", "end", "words"),
    [({"mode": "LIVE"}, True, "is of a real rig"), ({}, False, "breaks off before the run's end")],
)
def test_what_cannot_be_simulated_again_is_refused(tmp_path, changes, end, words):
    path = tmp_path / "run.mcap"
    with RecordingWriter(path, description(**changes)) as writer:
        writer.add(*Maker().block(0))
        if end:
            writer.add(*Maker().end(1))
    with pytest.raises(RecordingError, match=words):
        resimulate(path, tmp_path / "again.mcap")
