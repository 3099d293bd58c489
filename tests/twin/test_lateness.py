"""Readings that come late by a declared delay: the observer compares them with where things were."""

import numpy as np
import pytest

from daq.rig import Rig, load_rig, with_overrides
from tests.twin.accuracy import hindsight_of, observe
from tests.twin.cases import OVERSAMPLING, hidden_rig
from tests.twin.emulated import EmulatedRun, emulate, run_up
from twin.inputs import HOUSE_LATE, too_late
from twin.layout import LONGEST
from twin.observer import EstimateStatus, Observer

LATE = {"proximity_x": 10.0, "proximity_y": 6.5}  # samples
SETTLED = 200  # blocks


@pytest.fixture(scope="module")
def run() -> EmulatedRun:
    """A run-up through impacts, two of whose probes are late, by ten samples and by six and a half."""
    rows = ",".join(
        f'{{name="late",kind="skew",at=0.0,channel="{name}",size={late * OVERSAMPLING}}}'
        for name, late in LATE.items()
    )
    rig = with_overrides(hidden_rig("thesis-ball", "exact", 31), [f"emulator.fault=[{rows}]"])
    return emulate(rig, run_up(8.0, 13.0, 2.5), oversampling=OVERSAMPLING)


def declared(rig: Rig) -> Rig:
    """Return the rig as one describes it who knows of the delays."""
    delays = {name: late / rig.acquisition.rate for name, late in LATE.items()}
    return with_overrides(rig, [f"channel.{name}.delay_s={delay}" for name, delay in delays.items()])


def innovations(run: EmulatedRun, rig: Rig) -> dict[str, tuple[float, float]]:
    """Return for each late channel the innovations' normalised square and their correlation in time."""
    seen = observe(run, Observer(rig))
    names, parts = seen.observer.sensor_names, seen.parts[SETTLED:]
    ratios = np.mean([part.ratios for part in parts], axis=0)
    found = {}
    for name in LATE:
        row = np.concatenate([part.row(f"residual_{name}") for part in parts])
        found[name] = float(ratios[names.index(name)]), float(np.corrcoef(row[1:], row[:-1])[0, 1])
    return found


def test_with_the_delay_declared_innovations_are_white_and_as_large_as_expected(run):
    """Over some thousand numbers a correlation of white noise is within 4 / sqrt(n), below 0.06."""
    for ratio, correlation in innovations(run, declared(run.rig)).values():
        assert 0.9 < ratio < 1.1
        assert abs(correlation) < 0.06


def test_late_readings_are_smoothed_as_well(run):
    found = hindsight_of([observe(run, Observer(declared(run.rig)), smooth=True)])
    assert found.share > 0.8
    assert found.velocity < 0.5 * found.filter_velocity
    assert found.position < found.filter_position


def test_without_it_they_are_not(run):
    for ratio, _ in innovations(run, run.rig).values():
        assert ratio > 1.15


def test_a_late_encoder_s_angle_is_taken_back():
    rig = load_rig("thesis-ball", ["channel.encoder_angle.delay_s=1e-3"])
    run = emulate(rig, run_up(8.0, 10.0, 20.0, dwell=0.5))
    seen = observe(run)
    turned = seen.parts[-1].shaft_angle[-1] - run.truth["angle"][-5]
    # The emulated encoder is not late: the shaft is taken to be where it will be 1 ms later.
    assert (turned + np.pi) % (2.0 * np.pi) - np.pi == pytest.approx(1e-3 * 20.0 * np.pi, abs=2e-3)


@pytest.mark.parametrize(("quantity", "late"), [("displacement", LONGEST), ("force", HOUSE_LATE)])
def test_the_state_is_not_lost_by_the_longest_delays(quantity, late):
    rig = hidden_rig("thesis-ball", "exact", 31)
    channels = [each.name for each in rig.channels if each.quantity == quantity]
    rows = ",".join(
        f'{{name="late",kind="skew",at=0.0,channel="{name}",size={late * OVERSAMPLING}}}' for name in channels
    )
    run = emulate(
        with_overrides(rig, [f"emulator.fault=[{rows}]"]), run_up(8.0, 13.0, 2.5), oversampling=OVERSAMPLING
    )
    delay = late / rig.acquisition.rate
    seen = observe(
        run, Observer(with_overrides(rig, [f"channel.{name}.delay_s={delay}" for name in channels]))
    )
    assert not any(part.status & EstimateStatus.LOST for part in seen.parts)


def test_a_longer_delay_is_taken_as_none_and_said():
    rig = load_rig("thesis-ball", ["channel.proximity_x.delay_s=0.01", "channel.force_top.delay_s=8e-5"])
    assert not Observer(rig).sensors.late.any()
    assert too_late(rig) == ["proximity_x", "force_top"]
