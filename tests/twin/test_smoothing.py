"""Smoothing leaves the filter's motion where it does not help, and every other message as it is."""

import numpy as np
import pytest

from daq import keys
from daq.recording import Recording
from recordings.reference import REFERENCES
from replay.verify import IDENTICAL, verify
from rigtwin.cli import main
from tests.twin.cases import hidden_rig
from tests.twin.emulated import EmulatedRun, emulate
from twin.estimate import STRIDE, Estimated
from twin.observer import Observer
from twin.smoothing import AHEAD, NAMES, UNREST, WINDOW, Smoothed, Smoothing

BLOCK = 250
RATE = 25_000.0
HIT, LOST, DEAF, DEAF_END = 2.0, 2.5, 2.8, 3.0  # s: a hit, a gap, a probe that is left out, and its return
PLAN = f"""
[plan]
name = "eventful"
description = "a run-up to bouncing with a hit"

[[step]]
do = "speed"
speed_hz = 11.0
ramp_hz_per_s = 10.0

[[step]]
do = "wait"
duration = {HIT - 1.1}

[[step]]
do = "hit"
solenoid = "horizontal"
force = 20.0
duration = 0.01

[[step]]
do = "wait"
duration = 1.4
"""


def smoothed(run: EmulatedRun, observer: Observer) -> tuple[list[Estimated], list[Smoothed]]:
    """The filter's and the smoothed account of a run with a gap, in a part of which a probe is left out."""
    smoothing, estimates, told = Smoothing(observer), [], []
    for block in run.blocks:
        time = block.first_sample / RATE
        if LOST <= time < LOST + 0.02:
            continue
        if time == DEAF:
            observer.leave_out("proximity_x")
        if time == DEAF_END:
            observer.take_in("proximity_x")
        estimates.append(observer.update(block))
        told += smoothing.add(block, estimates[-1])
        waiting = len(estimates) - len(told)
        assert waiting * BLOCK <= (WINDOW + AHEAD) * RATE
    return estimates, told + smoothing.finish()


@pytest.fixture(scope="module")
def eventful() -> EmulatedRun:
    return emulate(hidden_rig("thesis-ball", "mm", 7501), PLAN)


def test_where_it_does_not_help_the_filter_s_values_stand(eventful):
    estimates, told = smoothed(eventful, Observer(eventful.rig))
    assert [each.first_sample for each in told] == [each.first_sample for each in estimates]
    assert [each.status for each in told] == [each.status for each in estimates]
    rows = np.concatenate([each.samples for each in told], axis=1)
    filtered = np.stack([np.concatenate([each.row(name) for each in estimates]) for name in NAMES[:-1]])
    chosen = rows[-1] == 1.0
    assert set(rows[-1]) == {0.0, 1.0}
    assert np.isfinite(rows).all()
    assert (rows[:-1, ~chosen] == filtered[:, ~chosen]).all()
    assert (rows[:4, chosen] != filtered[:4, chosen]).mean() > 0.99
    assert (rows[4:8, chosen].mean(axis=1) < 0.8 * filtered[4:, chosen].mean(axis=1)).all()
    force = np.concatenate([each.row("normal_force") for each in estimates])
    assert force.max() > 5.0
    assert not chosen[force > 0.0].any()
    settled = np.repeat([each.settled and not each.restarted for each in estimates], BLOCK // STRIDE)
    assert not chosen[~settled].any()
    time = np.concatenate(
        [(each.first_sample + STRIDE * np.arange(BLOCK // STRIDE)) / RATE for each in estimates]
    )
    for begin, end in ((HIT, HIT + UNREST), (LOST, LOST + 0.1), (DEAF, DEAF_END)):
        within = (time >= begin) & (time < end)
        assert within.any()
        assert not chosen[within].any()
        assert chosen[time > end].any()


def test_equal_blocks_give_equal_bits(eventful):
    first, again = (smoothed(eventful, Observer(eventful.rig))[1] for _ in range(2))
    for one, other in zip(first, again, strict=True):
        assert one.samples.tobytes() == other.samples.tobytes()


def messages(path, of: str) -> list[bytes]:
    with Recording(path) as recording:
        return [each.payload for each in recording.messages(of)]


def test_the_command_adds_a_series_and_changes_nothing_else(tmp_path, capsys):
    reference = next(each.path for each in REFERENCES if each.name == "ball")
    plain, smooth = tmp_path / "plain.mcap", tmp_path / "smooth.mcap"
    assert main(["twin", str(reference), "-o", str(plain)]) == 0
    assert main(["twin", str(reference), "-o", str(smooth), "--smooth"]) == 0
    assert verify(smooth).verdict == IDENTICAL
    with Recording(plain) as without, Recording(smooth) as recording:
        assert recording.check().verdict == "valid"
        rig = recording.description.rig
        assert set(recording.topics()) - set(without.topics()) == {keys.smoothed(rig)}
        for key in without.topics():
            assert messages(smooth, key) == messages(plain, key), key
        estimate, found = recording.series("estimate", NAMES[:-1]), recording.series("smoothed")
        truth = recording.series("truth", ["tilt_rate_x"])
        station = 0.211  # m, thesis, of the backup bearing
    assert (found.first_sample, found.stride, found.names) == (estimate.first_sample, estimate.stride, NAMES)
    assert found.units[:-1] == estimate.units
    chosen = found["smoothed"] == 1.0
    assert chosen.any()
    assert (found.samples[:-1, ~chosen] == estimate.samples[:, ~chosen]).all()
    error, before = (
        (each["velocity_x"] - station * truth["tilt_rate_x"])[chosen] for each in (found, estimate)
    )
    assert np.mean(error**2) < np.mean(before**2)
