"""The regime of runs that were made to be so, revolution by revolution.

How many drawn motions are named right is the matter of `tests.twin.test_regime_accuracy`.
"""

from functools import cache
from math import tau

import numpy as np
import pytest

from analysis.regime import Regime
from daq.rig import load_rig
from simulator.simulation import SIGNALS, Simulation, signals_for
from twin.estimate import STRIDE, Estimated, EstimateStatus
from twin.regime_watch import CONFIRMATIONS, RegimeWatch, end_of_turn

RATE = 25000.0
OVERSAMPLING = 4  # truth each 10 µs
NAMES = ("displacement_x", "displacement_y", "contact_force_x", "contact_force_y", "normal_force")


@cache
def made(rig, hz, seconds=8.0, velocity=(0.0, 0.0), changes=()):
    """Simulate a rig at a held speed; return bearing, shaft angle (n,) and the rows `NAMES` (5, n) at 5 kHz.

    `velocity` (m/s) throws the shaft at the beginning.
    """
    model = load_rig(rig, ["drive.mode=ideal", *changes]).model
    station = model.rotor.bearing_station
    state = Simulation(model, OVERSAMPLING * RATE).state.copy()
    state[10] = tau * hz
    state[2:4] += np.array(velocity) / station
    simulation = Simulation(model, OVERSAMPLING * RATE)
    simulation.go_on_from(0, state, tau * hz)
    parts = []
    for _ in range(round(10 * seconds)):
        simulation.advance(part := signals_for(round(OVERSAMPLING * RATE / 10)))
        parts.append(part[:, :: OVERSAMPLING * STRIDE].copy())
    truth = dict(zip(SIGNALS, np.concatenate(parts, axis=1), strict=True))
    place = [station * truth[f"tilt_{axis}"] - truth[f"house_{axis}"] for axis in "xy"]
    rows = np.array([*place, *(truth[name] for name in NAMES[2:])])
    return model.backup_bearing, truth["angle"], rows


def block(angle, rows, first, size=50, status=0):
    """Return the estimate of one block as the observer gives it, of columns from `first` on."""
    part = slice(first, first + size)
    nothing = np.empty(0)
    return Estimated(
        first * STRIDE, size * STRIDE, RATE, status, STRIDE, NAMES, ("",) * 5,
        rows[:, part], angle[part], None, "", 0.0, 0.0, nothing, nothing,
    )  # fmt: skip


def watched(run):
    """Let a new watch follow a run to its end."""
    bearing, angle, rows = run
    watch = RegimeWatch(bearing)
    for first in range(0, angle.size - 49, 50):
        watch.add(block(angle, rows, first))
    return watch


HEAVY = ("rotor.unbalance=990e-6",)
ROUGH = ("backup_bearing.friction=0.4",)
NO_MAGNET = ("magnetic_bearing.stiffness=1.0", "rotor.coupling_force=-34.0")


@pytest.mark.parametrize(
    ("regime", "run"),
    [
        (Regime.AT_REST, {"rig": "thesis-ball", "hz": 0.0}),
        (Regime.CONTACT_FREE, {"rig": "thesis-ball", "hz": 7.5}),  # below the resonance
        (Regime.CONTACT_FREE, {"rig": "thesis-pinned", "hz": 18.0}),  # above it
        (Regime.ONE_PLACE, {"rig": "thesis-ball", "hz": 14.5, "velocity": (0.3, 0.0)}),
        (Regime.DIAGONAL, {"rig": "thesis-pinned", "hz": 12.0, "velocity": (0.2, -0.2)}),
        (Regime.PERMANENT, {"rig": "thesis-ball", "hz": 12.0, "changes": NO_MAGNET}),  # lies at the bottom
        (Regime.FORWARD_WHIRL, {"rig": "thesis-ball", "hz": 20.0, "velocity": (0.3, 0.0), "changes": HEAVY}),
        (
            Regime.BACKWARD_WHIRL,
            {"rig": "thesis-plain", "hz": 14.0, "velocity": (0.4, 0.0), "changes": ROUGH},
        ),
        (
            Regime.BACKWARD_WHIRL,
            {"rig": "thesis-plain", "hz": -14.0, "velocity": (0.4, 0.0), "changes": ROUGH},
        ),
    ],
)
def test_a_run_that_was_made_so_is_named_so(regime, run):
    watch = watched(made(**run))
    assert watch.regime == regime
    assert watch.confidence >= 0.8


def test_a_change_is_announced_once_it_has_settled_and_confidence_dips_before():
    bearing, angle, rows = made("thesis-ball", 7.5)
    pressed = rows.copy()
    pressed[4, 20000:] = 10.0  # from 4 s on, the 31st revolution, there is contact all the time
    watch, seen = RegimeWatch(bearing), []
    for first in range(0, 30000, 50):
        watch.add(block(angle, pressed, first))
        seen.append((watch.regime, watch.confidence))
    announced = [regime for regime, _ in seen]
    assert sorted(set(announced), key=announced.index) == [
        Regime.UNKNOWN,
        Regime.CONTACT_FREE,
        Regime.PERMANENT,
    ]
    change = announced.index(Regime.PERMANENT)
    assert 400 + CONFIRMATIONS * 13 <= change <= 400 + 7 * 14  # blocks of 10 ms, 13.3 a revolution
    assert seen[change - 1][1] < 0.8
    assert seen[-1][1] == pytest.approx(1.0)


def test_a_shaft_that_trembles_about_its_zero_makes_no_revolutions():
    trembling = 1e-3 * np.random.default_rng(7).normal(size=2000)
    assert end_of_turn(trembling[:500], 5000.0) == 0
    assert end_of_turn(trembling, 5000.0) == 500  # the tenth of a second that stands for one
    assert end_of_turn(trembling[:9] + np.pi * np.arange(9) / 3, 5000.0) in (6, 7)


def test_a_restart_forgets_the_revolutions_but_not_the_regime():
    bearing, angle, rows = made("thesis-ball", 14.5, velocity=(0.3, 0.0))
    watch = watched((bearing, angle, rows))
    watch.add(block(angle, rows, 0, status=EstimateStatus.RESTARTED))
    assert watch.regime == Regime.ONE_PLACE
    for first in range(30000, 33000, 50):
        watch.add(block(angle, rows, first))
    assert watch.regime == Regime.BOUNCING
