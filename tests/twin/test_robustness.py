"""The observer where the model fails it, or the stream does: finite, bounded, and back again."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.impacts import correlation
from daq.rig import load_rig
from simulator.faults import Fault, FaultKind
from tests.twin.accuracy import observe
from tests.twin.cases import case_run, hidden_rig
from tests.twin.emulated import EmulatedRun, emulate, run_up
from twin.estimate import Estimated, EstimateStatus
from twin.observer import Observer

LARGEST_PLACE = 5e-3  # m, three times the clearance
LARGEST_FORCE = 5e3  # N
DROP = """
[plan]
name = "drop"
description = "throw the shaft up the wall and let it drop, still and turning"

[[step]]
do = "wait"
duration = 0.3

[[step]]
do = "hit"
solenoid = "horizontal"
force = 60.0
duration = 0.02

[[step]]
do = "wait"
duration = 0.7

[[step]]
do = "speed"
speed_hz = 5.0
ramp_hz_per_s = 10.0

[[step]]
do = "wait"
duration = 1.0
"""


def is_bounded(part: Estimated) -> bool:
    """Tell whether an estimate holds finite numbers only, within what a rig can do."""
    told = [row for row, name in enumerate(part.names) if not name.startswith("residual_")]
    place = np.hypot(part.row("displacement_x"), part.row("displacement_y"))
    return bool(
        np.isfinite(part.samples[told]).all()
        and place.max() < LARGEST_PLACE
        and part.row("normal_force").max() < LARGEST_FORCE
    )


def test_a_rotor_without_its_magnet_is_followed_as_it_drops():
    rig = load_rig("thesis-drop", ["emulator.actual.backup_bearing.stiffness=1e8", "emulator.seed=7"])
    seen = observe(emulate(rig, DROP))
    assert seen.lost == 0
    assert all(is_bounded(part) for part in seen.parts)
    truth = seen.run.truth["normal_force"][::5]
    assert truth.max() > 50.0
    assert correlation(seen.row("normal_force"), truth) > 0.99


def test_a_magnet_that_is_lost_is_survived_and_its_loss_found():
    rig = hidden_rig("thesis-ball", "exact", 7401)
    lost = replace(rig, faults=(Fault(FaultKind.MAGNET_LOST, at=1.5),))
    seen = observe(emulate(lost, run_up(6.0, 6.1, 0.1, dwell=2.5)))
    assert all(is_bounded(part) for part in seen.parts)
    before, after = seen.parts[:145], seen.parts[150:]
    assert not any(part.status & EstimateStatus.LOST for part in before)
    assert all(part.cause for part in after if part.status & EstimateStatus.LOST)
    assert any(part.status & EstimateStatus.LOST for part in after)
    assert all(part.settled for part in seen.parts[-20:])
    found = {each.name: each for each in seen.observer.identified()[0]}
    assert found["magnet_stiffness"].value < 0.1 * rig.model.magnetic_bearing.stiffness


@pytest.mark.parametrize("channels", [["force"], ["proximity_y"], ["force_top", "force_left"]])
def test_sensors_that_are_lost_amid_impacts_leave_an_estimate_with_wider_bands(channels):
    run = case_run("thesis-ball", "mm", 7402)
    whole, observer, parts = observe(run), Observer(run.rig), []
    rows = [k for k, name in enumerate(run.rig.channels.names) if name.startswith(tuple(channels))]
    for number, block in enumerate(run.blocks):
        samples = block.samples.copy()
        if number > 500:
            samples[rows] = np.nan
        parts.append(observer.update(block._replace(samples=samples)))
    assert all(is_bounded(part) for part in parts)
    assert not any(part.status & EstimateStatus.LOST for part in parts)
    axis = "y" if "proximity_y" in channels else "x"
    for name in (f"velocity_{axis}_sigma", "normal_force_sigma"):
        alone = np.concatenate([part.row(name) for part in parts[501:]]).mean()
        assert alone > np.concatenate([part.row(name) for part in whole.parts[501:]]).mean()


def test_without_any_sensor_it_goes_on_by_the_model_and_says_that_it_knows_little():
    run = case_run("thesis-ball", "mm", 7402)
    whole, observer = observe(run), Observer(run.rig)
    rows = [k for k, name in enumerate(run.rig.channels.names) if name.startswith(("force", "proximity"))]
    for number, block in enumerate(run.blocks[:600]):
        samples = block.samples.copy()
        if number > 500:
            samples[rows] = np.nan
        part = observer.update(block._replace(samples=samples))
        assert is_bounded(part)
    assert part.row("displacement_x_sigma").mean() > 10 * whole.row("displacement_x_sigma")[-1]


@pytest.mark.slow
def test_ten_minutes_with_gaps_and_restarts():
    run, draw = case_run("thesis-pinned", "mm", 7403), np.random.default_rng(7403)
    observer, first, parts = Observer(run.rig), 0, []
    while first < 600 * 25_000:
        parts = []
        for block in run.blocks:
            if draw.random() > 0.005:
                parts.append(observer.update(block._replace(first_sample=first + block.first_sample)))
                assert is_bounded(parts[-1])
        first += run.blocks[-1].first_sample + 250 * int(draw.integers(1, 400))
    assert rms_place(run, [part for part in parts if part.settled], first_of(parts, run)) < 1e-6


def first_of(parts: list[Estimated], run: EmulatedRun) -> int:
    """Return the sample at which the last repetition of the run began."""
    return parts[-1].first_sample - run.blocks[-1].first_sample


def rms_place(run: EmulatedRun, parts: list[Estimated], begin: int) -> float:
    """Return the rms error (m) of the place along y."""
    station = run.rig.emulated_model.rotor.bearing_station
    errors = [
        part.row("displacement_y")
        - station * run.truth["tilt_y"][part.first_sample - begin :][: part.n_samples : part.stride]
        for part in parts
    ]
    return float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))
