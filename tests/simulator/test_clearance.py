"""Pins as parameters, and the edge of what they leave to the shaft, against brute force."""

import numpy as np
import pytest

from simulator.clearance import bearing_edge
from simulator.contact import penetration
from simulator.rig import RigError, model_from_mapping
from simulator.simulation import Simulation, checked
from simulator.state import State
from tests.simulator.rigs import changed, hanging, ideal, model_of, signals, state

VARIANTS = {
    "as shipped": {},
    "turned": {"pin_angle_deg": 0.0},
    "three": {"pin_count": 3, "pin_angle_deg": 90.0},
    "eight": {"pin_count": 8, "pin_angle_deg": 11.0},
    "worn": {"worn_pin": 3, "pin_wear": 0.4e-3},
    "too long": {"worn_pin": 2, "pin_wear": -0.3e-3},
    "square gap": {"pin_tip_radius": 10.0},
    "points": {"pin_tip_radius": 0.0},
}


def pinned(**bearing):
    """Return the pinned rig with other pins, ready for kernels."""
    return checked(changed(ideal("pinned"), backup_bearing=bearing))


def depth(model, x: float, y: float) -> float:
    """Return the penetration with the shaft's centre at (x, y), m."""
    station = model.rotor.bearing_station
    return penetration(model, State(*state(tilt_x=x / station, tilt_y=y / station)))


@pytest.mark.parametrize("bearing", VARIANTS.values(), ids=VARIANTS.keys())
def test_every_point_of_the_edge_just_touches(bearing):
    model = pinned(**bearing)
    arcs = bearing_edge(model)
    assert len(arcs) == model.backup_bearing.pin_count
    for arc in arcs:
        for x, y in arc[::6]:
            assert abs(depth(model, x, y)) < 1e-13  # rounding: metres of tip radius cancel
    for arc, following in zip(arcs, [*arcs[1:], arcs[0]], strict=True):
        assert arc[-1] == pytest.approx(following[0], abs=1e-12)  # neighbours meet in a cusp


@pytest.mark.parametrize("bearing", VARIANTS.values(), ids=VARIANTS.keys())
def test_the_edge_is_where_a_walk_from_the_middle_first_touches(bearing):
    model = pinned(**bearing)
    edge = np.concatenate(bearing_edge(model))
    for x, y in edge[::31]:
        inside = [depth(model, share * x, share * y) for share in np.linspace(0.0, 0.999, 40)]
        assert max(inside) < 0.0
        assert depth(model, 1.001 * x, 1.001 * y) > 0.0


def test_flat_pins_leave_a_square():
    edge = np.concatenate(bearing_edge(pinned(pin_tip_radius=10.0, pin_angle_deg=0.0)))
    assert abs(edge).max() == pytest.approx(1.5e-3, rel=1e-3)
    assert np.hypot(*edge.T).max() == pytest.approx(1.5e-3 * np.sqrt(2.0), rel=1e-3)


def test_a_worn_pin_s_gap_is_wider_by_its_wear():
    model = pinned(worn_pin=3, pin_wear=0.4e-3)
    diagonal = np.sqrt(0.5)
    assert depth(model, -1.9e-3 * diagonal, -1.9e-3 * diagonal) == pytest.approx(0.0, abs=1e-15)
    assert depth(model, 1.5e-3 * diagonal, 1.5e-3 * diagonal) == pytest.approx(0.0, abs=1e-15)


def test_turning_the_rig_turns_the_answer():
    # Pins a quarter turn on are the same bearing; shaft angle and loads are as they were.
    truth = [
        signals(Simulation(pinned(pin_angle_deg=angle), state=hanging(model_of("pinned"), 10.5)), 1.5)
        for angle in (45.0, 135.0)
    ]
    assert truth[0][13].max() > 5.0
    assert np.array_equal(*truth)


def test_pins_carry_a_shaft_without_its_magnet():
    model = changed(ideal("pinned"), magnetic_bearing={"stiffness": 0.0})
    simulation = Simulation(model)
    assert -2.4e-3 < simulation.state[1] * 0.211 < -2.2e-3
    truth = signals(simulation, 0.2)
    assert abs(truth[1] - truth[1, 0]).max() < 1e-12


def test_bad_pins_are_refused():
    with pytest.raises(RigError, match=r"worn_pin = 5 is not one of the pin_count = 4 pins"):
        Simulation(changed(model_of("pinned"), backup_bearing={"worn_pin": 5}))
    tables = {name: dict(part._asdict()) for name, part in model_of("pinned")._asdict().items()}
    tables = {
        name: {k: v for k, v in part.items() if not k.startswith("pin_")} for name, part in tables.items()
    }
    tables["backup_bearing"] |= {
        "kind": "pinned",
        "law": "hertz",
        "damping_mode": "fixed",
        "pin_tip_radius": 0.0,
    }
    tables["drive"]["mode"] = "ideal"
    assert model_from_mapping(tables).backup_bearing.pin_count == 4
    tables["backup_bearing"]["pin_count"] = 2
    with pytest.raises(RigError, match=r"pin_count = 2 is outside 3 to 8"):
        model_from_mapping(tables)
    del tables["backup_bearing"]["pin_count"]
    tables["backup_bearing"]["pin_x"] = 1.0
    with pytest.raises(RigError, match=r"\[backup_bearing\] pin_x is not a key of this table"):
        model_from_mapping(tables)
