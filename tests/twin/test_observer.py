"""The observer against the truth of the emulated rig, and when it is given rubbish."""

from itertools import pairwise

import numpy as np
import pytest

from analysis.impacts import Comparison, compare_impacts, correlation, find_impacts
from daq.commanding.plan import load_plan
from daq.rig import RigError, load_rig
from tests.twin.emulated import EmulatedRun, emulate, run_up
from twin.estimate import STRIDE, Estimated, EstimateStatus
from twin.observer import Observer

ACTUAL = "emulator.actual.rotor"
SETTLED = 0.3  # s


class Result:
    """An observer's estimate of a whole run, beside the truth at the same samples."""

    def __init__(self, run: EmulatedRun, observer: Observer | None = None) -> None:
        observer = observer or Observer(run.rig)
        self.parts = [observer.update(block) for block in run.blocks]
        self.run = run
        self.index = np.concatenate(
            [each.first_sample + STRIDE * np.arange(each.samples.shape[1]) for each in self.parts]
        )
        self.settled = self.index > SETTLED * run.rig.acquisition.rate

    def __getitem__(self, name: str) -> np.ndarray:
        return np.concatenate([part.row(name) for part in self.parts])

    def truth(self, name: str) -> np.ndarray:
        return self.run.truth[name][self.index]

    def error(self, name: str) -> float:
        """Return the rms error of an output once it has settled."""
        return float(np.sqrt(np.mean((self[name] - self.truth(name))[self.settled] ** 2)))

    def impacts(self) -> Comparison:
        rate = self.run.rig.acquisition.rate
        seen = find_impacts(self["normal_force"], rate / STRIDE)
        seen = seen._replace(start=seen.start * STRIDE, end=seen.end * STRIDE)
        return compare_impacts(find_impacts(self.run.truth["normal_force"], rate), seen, tolerance=25)

    def unbalance(self) -> complex:
        return complex(self["unbalance_x"][-1], self["unbalance_y"][-1])


def hidden(seed: int, rig: str = "thesis-ball", *more: str) -> list[str]:
    """Return settings of an emulated rig whose unbalance and noise the twin is not told."""
    draw = np.random.default_rng(seed)
    unbalance = load_rig(rig).model.rotor.unbalance * draw.uniform(0.8, 1.2)
    angle = draw.uniform(-np.pi, np.pi)
    return [
        f"{ACTUAL}.unbalance={unbalance}",
        f"{ACTUAL}.unbalance_angle={angle}",
        f"emulator.seed={seed}",
        *more,
    ]


@pytest.fixture(scope="module")
def short() -> EmulatedRun:
    """1.5 s up to 10 Hz, with first impacts."""
    return emulate(load_rig("thesis-ball", hidden(3)), run_up(10.0, 12.0, 2.0), seconds=1.5)


@pytest.mark.parametrize("rig", ["thesis-ball", "thesis-pinned", "thesis-plain"])
def test_force_and_motion_through_a_run_up_with_impacts(rig):
    described = load_rig(rig, hidden(11, rig, f"{ACTUAL}.coupling_force=-11.5"))
    result = Result(emulate(described, run_up(8.0, 13.0, 2.5)))
    assert correlation(result["normal_force"], result.truth("normal_force")) > 0.999
    assert correlation(result["contact_force_x"], result.truth("contact_force_x")) > 0.99
    impacts = result.impacts()
    assert len(impacts.pairs) > 10
    assert np.median(np.abs(impacts.peak_error)) < 0.02
    assert np.quantile(np.abs(impacts.peak_error), 0.9) < 0.05
    assert np.median(np.abs(impacts.impulse_error)) < 0.02
    assert len(impacts.missed) + len(impacts.false_alarms) <= 1
    station = described.model.rotor.bearing_station
    for axis in "xy":
        assert station * result.error(f"tilt_{axis}") < 0.2e-6
        assert station * result.error(f"tilt_rate_{axis}") < 0.08e-3
        assert result.error(f"house_{axis}") < 5e-9
    hidden_rotor = described.emulated_model.rotor
    truth = hidden_rotor.unbalance * np.exp(1j * hidden_rotor.unbalance_angle)
    assert abs(result.unbalance() / truth - 1.0) < 0.005


def test_the_shipped_plan_with_impacts():
    rig = load_rig("thesis-ball", hidden(21))
    result = Result(emulate(rig, load_plan("impacts", rig)))
    assert correlation(result["normal_force"], result.truth("normal_force")) > 0.999
    impacts = result.impacts()
    assert np.median(np.abs(impacts.peak_error)) < 0.02
    assert result.error("speed") < 0.1
    assert result.error("ring_speed") < 1.0
    assert len(impacts.missed) == len(impacts.false_alarms) == 0


def test_a_contact_that_differs_from_the_description_is_told_by_the_transducers():
    bearing = "emulator.actual.backup_bearing"
    more = [f"{bearing}.stiffness=6e7", f"{bearing}.damping_factor=1.7", f"{bearing}.friction=0.33"]
    rig = load_rig("thesis-ball", hidden(5, "thesis-ball", *more))
    result = Result(emulate(rig, run_up(9.0, 13.0, 2.0)))
    impacts = result.impacts()
    assert np.median(np.abs(impacts.peak_error)) < 0.03
    assert np.quantile(np.abs(impacts.impulse_error), 0.9) < 0.05
    assert rig.model.rotor.bearing_station * result.error("tilt_rate_y") < 0.1e-3


def test_probes_alone_do_too():
    rig = load_rig("thesis-ball", hidden(8))
    run = emulate(rig, run_up(9.0, 12.0, 2.0))
    rows = [rig.channels.index(name) for name in rig.channels.names if name.startswith("force")]
    for block in run.blocks:
        block.samples[rows] = np.nan
    result = Result(run)
    assert np.isnan(result["residual_force_top"]).all()
    assert np.median(np.abs(result.impacts().impulse_error)) < 0.05
    assert rig.model.rotor.bearing_station * result.error("tilt_x") < 1e-6


def test_a_hit_at_standstill_is_known_from_the_solenoids_current():
    rig = load_rig("thesis-ball", hidden(2))
    plan = """
[plan]
name = "hit"
description = "a small hit at standstill"

[[step]]
do = "wait"
duration = 0.5

[[step]]
do = "hit"
solenoid = "horizontal"
force = 6.0
duration = 0.01

[[step]]
do = "wait"
duration = 0.5
"""
    result = Result(emulate(rig, plan))
    station = rig.model.rotor.bearing_station
    assert np.ptp(station * result.truth("tilt_x")) > 0.5e-3
    assert station * result.error("tilt_rate_x") < 0.1e-3
    assert result.error("speed") < 0.01
    assert not result["normal_force"].any()


def test_residuals_are_the_sensors_noise(short):
    result = Result(short)
    assert np.std(result["residual_proximity_x"][result.settled]) == pytest.approx(1.01e-6, rel=0.05)
    assert np.std(result["residual_force_left"][result.settled]) == pytest.approx(0.5, rel=0.05)
    assert all(part.residual_rms.shape == (6,) for part in result.parts)


def test_equal_blocks_give_equal_bits(short):
    one, other = Result(short), Result(short)
    assert one["normal_force"].tobytes() == other["normal_force"].tobytes()
    assert one["tilt_rate_x"].tobytes() == other["tilt_rate_x"].tobytes()


def test_blocks_follow_without_a_seam(short):
    result = Result(short)
    steps = np.abs(np.diff(result["displacement_x"]))
    seams = np.flatnonzero(np.diff(result.index) == STRIDE)[49::50]
    assert steps[seams].mean() < 2 * steps.mean()
    assert result.parts[0].status == EstimateStatus.RESTARTED | EstimateStatus.SETTLING
    assert [part.settled for part in result.parts[8:12]] == [False, False, True, True]
    assert all(before.missing is after.missing is None for before, after in pairwise(result.parts))


def test_a_gap_starts_the_moving_states_anew_and_keeps_the_unbalance(short):
    observer = Observer(short.rig)
    for block in short.blocks[:110]:
        before = observer.update(block)
    unbalance = before.row("unbalance_x")[-1]
    after = observer.update(short.blocks[118])
    assert after.missing == (27500, 29499)
    assert after.restarted
    assert not after.settled
    assert after.row("unbalance_x")[-1] == pytest.approx(unbalance, rel=0.1)
    for block in short.blocks[119:]:
        after = observer.update(block)
    assert after.settled
    index = after.first_sample + STRIDE * np.arange(after.samples.shape[1])
    assert after.row("tilt_x") == pytest.approx(short.truth["tilt_x"][index], abs=2e-6)


def estimate_with(run: EmulatedRun, name: str, value: float, first: int, last: int) -> list[Estimated]:
    """Return the estimates when one channel reads `value` in blocks `first` to before `last`."""
    observer, row = Observer(run.rig), run.rig.channels.index(name)
    parts = []
    for number, block in enumerate(run.blocks):
        samples = block.samples.copy()
        if first <= number < last:
            samples[row] = value
        parts.append(observer.update(block._replace(samples=samples)))
    return parts


@pytest.mark.parametrize("value", [np.nan, np.inf, -4.0e-3])
def test_a_probe_out_of_range_is_left_out(short, value):
    parts = estimate_with(short, "proximity_x", value, 60, 64)
    assert all(np.isfinite(part.samples[:19]).all() for part in parts)
    assert not any(part.status & EstimateStatus.LOST for part in parts)
    assert parts[66].settled


@pytest.mark.parametrize("channel", ["encoder_angle", "solenoid_current", "proximity_y", "force_top"])
def test_no_number_comes_in_none_goes_out(short, channel):
    parts = estimate_with(short, channel, np.nan, 60, 70)
    assert all(np.isfinite(part.samples[:19]).all() for part in parts)
    assert parts[-1].settled


def test_a_sensor_that_contradicts_the_model_is_said_and_survived(short):
    parts = estimate_with(short, "proximity_x", 3.0e-3, 60, 64)
    assert parts[60].status & EstimateStatus.LOST
    assert parts[61].restarted
    assert all(np.isfinite(part.samples[:19]).all() for part in parts)
    assert parts[-1].settled
    index = parts[-1].first_sample + STRIDE * np.arange(50)
    assert parts[-1].row("tilt_x") == pytest.approx(short.truth["tilt_x"][index], abs=2e-6)


def test_a_violent_backward_whirl_is_followed():
    rig = load_rig("thesis-plain", ["backup_bearing.friction=0.4", f"{ACTUAL}.unbalance=9e-5"])
    result = Result(emulate(rig, run_up(10.0, 11.5, 0.5, dwell=1.0)))
    assert result.truth("normal_force").max() > 500.0
    assert correlation(result["normal_force"], result.truth("normal_force")) > 0.999
    assert rig.model.rotor.bearing_station * result.error("tilt_x") < 0.3e-6


def test_blocks_of_another_rig_or_from_the_past_are_refused(short):
    observer = Observer(short.rig)
    observer.update(short.blocks[5])
    with pytest.raises(ValueError, match="before sample 1500"):
        observer.update(short.blocks[4])
    with pytest.raises(ValueError, match="other channels or another rate"):
        observer.update(short.blocks[6]._replace(rate=10_000.0))


def test_rigs_that_cannot_be_observed_are_refused():
    with pytest.raises(RigError, match="no model to run alongside"):
        Observer(load_rig("thesis-ball", ['twin.model="none"']))
    with pytest.raises(RigError, match="not in one line"):
        Observer(load_rig("thesis-ball", ["channel.proximity_y.angle_deg=180.0"]))
