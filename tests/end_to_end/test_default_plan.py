"""The default plan on the default rig: what its samples say of the rig, and that its limits fit it."""

import numpy as np
import pytest

import rigtwin
from analysis.decay import fit_decay
from analysis.synchronous import synchronous

RATE = 25_000.0
HIT, HIT_END = 2.0, 2.05  # s: the free decay begins when the 10 ms pulse is surely over
DECAYED = 6.9  # s: before the run-up begins at 7 s
NATURAL_FREQUENCY, DAMPING = 10.0596, 0.02268  # Hz, 1: physics of the shipped parameters at rest
AMPLITUDE_20_HZ = 84.45e-6  # m at the backup bearing: synchronous response, closed form


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The default plan with an unbalance angle of its own, simulated."""
    rig = rigtwin.load_rig("thesis-ball", ["emulator.seed=5", "emulator.actual.rotor.unbalance_angle=0.8"])
    path = tmp_path_factory.mktemp("default") / "run.mcap"
    outcome = rigtwin.simulate(rig, rigtwin.load_plan(rig.plan, rig), path, twin=False)
    return rigtwin.Recording(path), outcome


def test_default_plan_does_not_trip(run):
    recording, outcome = run
    assert outcome.aborted == ""
    assert "trip" not in {event.kind for event in recording.events()}


def test_free_decay_gives_natural_frequency_and_damping(run):
    """Within 0.1 % and 2 %: a decay of 6 µm to 100 µm over 5 s in noise of 1 µm."""
    probes = run[0].series("block", ["proximity_x", "proximity_y"], first=int(HIT_END * RATE)).samples
    x, y = probes[:, : int((DECAYED - HIT_END) * RATE)].astype(float)
    decay = fit_decay(x + 1j * y, RATE)
    assert decay.frequency == pytest.approx(NATURAL_FREQUENCY, rel=1e-3)
    assert decay.damping == pytest.approx(DAMPING, rel=0.02)


def test_response_at_20_hz_gives_its_amplitude(run):
    """Within 1 %: what is left of the transient after 6 s is below 0.1 %."""
    recording = run[0]
    step = next(event for event in recording.events() if "contact-free at 20 Hz" in event.text)
    first = step.sample + round(5.5 * RATE)
    names = ["proximity_x", "proximity_y", "encoder_angle", "encoder_turns"]
    x, y, angle, turns = recording.series("block", names, first=first, last=first + int(RATE)).samples
    rotor = rigtwin.load_rig("thesis-ball").model.rotor
    scale = rotor.bearing_station / rotor.disk_station
    found = synchronous(2 * np.pi * turns.astype(float) + angle, scale * np.stack([x, y]).astype(float))
    assert found.amplitude == pytest.approx(AMPLITUDE_20_HZ, rel=0.01)


FASTER = """
[plan]
name = "faster"
description = "to 22.5 Hz: the thesis ends at 20 Hz"
[[step]]
do = "speed"
speed_hz = 22.5
[[step]]
do = "wait"
duration = 1.0
"""


def test_a_speed_beyond_the_thesis_trips(tmp_path):
    (tmp_path / "faster.toml").write_text(FASTER)
    assert "speed" in trip_of("thesis-ball", str(tmp_path / "faster.toml"), tmp_path)


def test_a_ring_that_does_not_turn_trips(tmp_path):
    """A seized ball bearing is a plain wall with friction: backward whirl with hundreds of newtons."""
    assert "force" in trip_of(
        "thesis-ball", "resonance", tmp_path, "emulator.actual.backup_bearing.kind=plain"
    )


def trip_of(name, plan, folder, *changes):
    """What tripped first when a plan is simulated."""
    rig = rigtwin.load_rig(name, changes)
    outcome = rigtwin.simulate(rig, rigtwin.load_plan(plan, rig), folder / "run.mcap", twin=False)
    trip = next(event for event in rigtwin.Recording(folder / "run.mcap").events() if event.kind == "trip")
    assert outcome.aborted
    return trip.details["first_out"]
