"""The published run-up: 0.5 Hz steps of 10 s, speed prescribed (P2 fig 10, P3 section 5)."""

from math import tau

import numpy as np
import pytest

from simulator.simulation import Simulation, signals_for
from tests.simulator.rigs import ideal, signals

RAMP = tau * 26.7  # rad/s2, P2 table 3
RESULTANT = 2.0 * 8.3e7  # N/m: of the two transducers of a direction


class Dwell:
    """What happened at one speed: last contact (s into the dwell) and largest transducer resultant (N)."""

    def __init__(self, simulation: Simulation, hz: float):
        simulation.set_speed(tau * hz, RAMP)
        self.hz, self.last_contact, self.peak = hz, 0.0, 0.0
        truth = signals_for(2500)
        for tenth in range(100):
            simulation.advance(truth)
            closed = np.flatnonzero(truth[13])
            if len(closed):
                self.last_contact = 0.1 * tenth + (closed[-1] + 1) / simulation.rate
            if tenth >= 50:
                self.peak = max(self.peak, RESULTANT * np.hypot(truth[4], truth[5]).max())

    @property
    def free(self) -> bool:
        """Whether the last five seconds, far more than a period, had no contact."""
        return self.last_contact < 5.0


def staircase(simulation: Simulation, *speeds: float) -> dict[float, Dwell]:
    """Dwell at each speed in turn."""
    return {hz: Dwell(simulation, hz) for hz in speeds}


@pytest.fixture(scope="module")
def ball() -> tuple[dict[float, Dwell], dict[float, Dwell]]:
    """Return the dwells of a run-up and of the run-down after it."""
    simulation = Simulation(ideal("ball"))
    simulation.set_speed(tau * 8.0, RAMP)
    signals(simulation, 3.0)
    up = staircase(simulation, *np.arange(8.5, 16.6, 0.5))
    return up, staircase(simulation, *np.arange(16.0, 8.9, -0.5))


def test_ball_run_up_has_contact_from_9_5_to_15_5_hz_and_none_at_16(ball):
    up, _ = ball
    assert [hz for hz, dwell in up.items() if not dwell.free] == list(np.arange(9.5, 15.6, 0.5))
    assert up[16.0].last_contact > 0.0  # last touches in the transient


def test_ball_run_up_s_peak_forces(ball):
    # 71 N and 86 N in the specification; the largest of 5 s on an orbit that repeats to a few per cent.
    up, _ = ball
    assert up[15.0].peak == pytest.approx(71.0, rel=0.05)
    assert up[15.5].peak == pytest.approx(86.0, rel=0.05)


def test_ball_run_down_is_free_until_11_hz(ball):
    # Published 12 Hz; the specification's model gives 11.0 with the published coupling force.
    _, down = ball
    assert max(hz for hz, dwell in down.items() if not dwell.free) == 11.0


def test_pinned_run_up_is_free_one_step_earlier():
    # Contact to 14.0 Hz, free at 14.5, both within the +-0.5 Hz that chance decides.
    simulation = Simulation(ideal("pinned"))
    up = staircase(simulation, *np.arange(9.0, 15.6, 0.5))
    last = max(hz for hz, dwell in up.items() if not dwell.free)
    assert 13.5 <= last <= 14.5
    assert not simulation.beyond_pins
