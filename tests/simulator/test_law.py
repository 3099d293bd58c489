"""Contact laws against their published formulas, written down here a second time for scipy."""

from math import atan2, exp, pi, sqrt

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from simulator.law import friction, friction_coefficient, normal_damping, normal_force, normal_stiffness
from simulator.rig import ContactLaw, RigError
from simulator.simulation import Simulation
from tests.simulator.rigs import changed, ideal, model_of, rebound

MASS = 0.07714 / 0.211**2  # kg, of the shaft at the bearing's plane
STIFFNESS = 5e7

# Bracket of N = k d^1.5 (1 + ...), as the papers write it: of d' / v and e, v being the closing speed.
PUBLISHED = {
    ContactLaw.HERTZ: lambda ratio, e: 0.0,
    ContactLaw.HUNT_CROSSLEY: lambda ratio, e: 1.5 * (1 - e) * ratio,
    ContactLaw.LANKARANI_NIKRAVESH: lambda ratio, e: 3 * (1 - e**2) / 4 * ratio,
    ContactLaw.FLORES: lambda ratio, e: 8 * (1 - e) / (5 * e) * ratio,
    ContactLaw.GONTHIER: lambda ratio, e: (1 - e**2) / e * ratio,
}


def with_law(law: ContactLaw, restitution: float = 0.7, **fields):
    """Return the plain rig, its speed prescribed, with a law that takes its damping from a restitution."""
    data = {"law": law, "damping_mode": 1, "restitution": restitution, **fields}
    return changed(ideal("plain"), backup_bearing=data)


def outcome(force, speed: float) -> float:
    """Throw the shaft's mass at a rigid wall with force(d, d'), N; return the coefficient of restitution."""

    def rates(_time, y):
        return [y[1], -force(max(y[0], 0.0), y[1]) / MASS]

    def leaves(_time, y):
        return y[0]

    leaves.terminal, leaves.direction = True, -1
    # A law whose clipped force lets go before the wall is left goes on at the speed it has then.
    found = solve_ivp(
        rates, (0.0, 0.1), [0.0, speed], "DOP853", rtol=1e-10, atol=1e-14, events=leaves, max_step=1e-4
    )
    assert len(found.t_events[0])
    return -found.y[1, -1] / speed


def published(law: ContactLaw, restitution: float, speed: float) -> float:
    """Return the coefficient of restitution that a law's published formula has as its outcome."""
    bracket = PUBLISHED[law]
    return outcome(
        lambda d, rate: max(0.0, STIFFNESS * d**1.5 * (1 + bracket(rate / speed, restitution))), speed
    )


@pytest.mark.parametrize("speed", [0.03, 0.3])
@pytest.mark.parametrize("law", list(PUBLISHED))
def test_restitution_is_that_of_the_published_formula(law, speed):
    # The closing speed is that of the last substep before, not of the closing itself; the wall is a house
    # of 1e6 kg. Demanded is 1e-3.
    assert rebound(with_law(law), speed) == pytest.approx(published(law, 0.7, speed), abs=2e-5)


def test_hertz_gives_all_energy_back():
    assert rebound(with_law(ContactLaw.HERTZ), 0.2) == pytest.approx(1.0, abs=5e-6)  # the house's mass


@pytest.mark.parametrize("restitution", [0.3, 0.5, 0.8])
@pytest.mark.parametrize("law", [ContactLaw.FLORES, ContactLaw.GONTHIER])
def test_the_later_laws_keep_the_restitution_they_are_given(law, restitution):
    # Both papers show outcomes near the diagonal over the whole range.
    assert rebound(with_law(law, restitution), 0.2) == pytest.approx(restitution, abs=0.07)


@pytest.mark.parametrize("law", [ContactLaw.HUNT_CROSSLEY, ContactLaw.LANKARANI_NIKRAVESH])
def test_the_older_laws_hold_for_nearly_elastic_impacts_only(law):
    assert rebound(with_law(law, 0.95), 0.2) == pytest.approx(0.95, abs=0.01)
    assert rebound(with_law(law, 0.1), 0.2) > 0.4


@pytest.mark.parametrize("damping", [200.0, 2000.0])
@pytest.mark.parametrize("speed", [0.05, 0.5])
def test_kelvin_voigt_s_restitution_is_the_closed_form_at_every_speed(damping, speed):
    stiffness = 5e6
    model = changed(
        ideal("plain"),
        backup_bearing={"law": ContactLaw.KELVIN_VOIGT, "stiffness": stiffness, "damping": damping},
    )
    decay = damping / (2 * MASS)
    turn = sqrt(stiffness / MASS - decay**2)
    # It lets go when k d + c d' is zero (Schwager and Poeschel 2007, Granular Matter 9, 465).
    lets_go = (pi - atan2(2 * decay * turn, turn**2 - decay**2)) / turn
    # Its force jumps at closing, within a substep of 0.6 us of a contact of 2 ms. Demanded is 1e-3.
    assert rebound(model, speed) == pytest.approx(exp(-decay * lets_go), rel=5e-4)


@pytest.mark.parametrize("law", list(ContactLaw))
def test_no_law_pulls_and_none_gives_energy(law):
    bearing = with_law(law, damping=500.0).backup_bearing
    for depth in (1e-6, 1e-4, 1e-3):
        for factor in (0.0, 2.0, 100.0):
            elastic = normal_force(bearing, factor, depth, 0.0)
            assert elastic > 0.0
            for rate in (-10.0, -0.1, 1e-3, 1.0):
                force = normal_force(bearing, factor, depth, rate)
                assert force >= 0.0
                assert (force - elastic) * rate >= 0.0
        assert normal_force(bearing, 1.0, -depth, 1.0) == 0.0


@pytest.mark.parametrize("law", list(ContactLaw))
def test_slopes_are_those_of_the_force(law):
    bearing, step = with_law(law, damping=500.0).backup_bearing, 1e-9
    along = normal_force(bearing, 3.0, 1e-4 + step, 0.0) - normal_force(bearing, 3.0, 1e-4 - step, 0.0)
    assert normal_stiffness(bearing, 1e-4) == pytest.approx(along / (2 * step), rel=1e-6)
    closing = normal_force(bearing, 3.0, 1e-4, 1e-3) - normal_force(bearing, 3.0, 1e-4, 0.0)
    assert normal_damping(bearing, 3.0, 1e-4) == pytest.approx(closing / 1e-3, rel=1e-9)


def test_static_friction_falls_to_that_of_sliding():
    bearing = model_of("ball").backup_bearing
    assert [friction_coefficient(bearing, slip) for slip in (0.0, 0.1, 10.0)] == [0.4, 0.4, 0.4]
    bearing = bearing._replace(static_friction=0.6, stribeck_speed=0.05)
    assert friction_coefficient(bearing, 0.0) == pytest.approx(0.6)
    assert friction_coefficient(bearing, 0.05) == pytest.approx(0.5)
    assert friction_coefficient(bearing, 50.0) == pytest.approx(0.4, abs=1e-6)
    for slip in np.linspace(-1.0, 1.0, 41):
        along_t, along_z = friction(bearing, 100.0, slip, -0.3 * slip)
        assert along_t * slip - along_z * 0.3 * slip <= 0.0


def test_a_law_says_what_it_needs():
    with pytest.raises(RigError, match=r'damping_mode = "fixed" does not go with law = "flores".*"latched"'):
        Simulation(changed(ideal("plain"), backup_bearing={"law": ContactLaw.FLORES}))
    with pytest.raises(RigError, match=r'restitution = 0 is below 0\.01, where law = "gonthier"'):
        Simulation(with_law(ContactLaw.GONTHIER, 0.0))
    Simulation(with_law(ContactLaw.LANKARANI_NIKRAVESH, 0.0))
