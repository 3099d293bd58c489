"""Pins as parameters, and the edge of what they leave to the shaft, against brute force."""

import numpy as np
import pytest

from daq.rig import load_rig, rig_from_text
from simulator.candidates import SLIDING, STIFFNESS, candidates_of, for_kernels
from simulator.clearance import bearing_edge
from simulator.contact import contact_force, penetration
from simulator.rig import Pin, RigError, model_from_mapping
from simulator.simulation import Simulation, checked
from simulator.state import State
from tests.simulator.rigs import changed, hanging, ideal, model_of, signals, state

PINS = "backup_bearing.pin"
VARIANTS = {
    "as shipped": {},
    "turned": {"pin_angle_deg": 0.0},
    "three": {"pin_count": 3, "pin_angle_deg": 90.0},
    "eight": {"pin_count": 8, "pin_angle_deg": 11.0},
    "worn": {"pins": (Pin(wear=0.4e-3, number=3),)},
    "too long": {"pins": (Pin(wear=-0.3e-3, number=2),)},
    "all worn": {"pins": tuple(Pin(wear=1e-4 * n, number=n) for n in (1, 2, 3, 4))},
    "square gap": {"pin_tip_radius": 10.0},
    "points": {"pin_tip_radius": 0.0},
}


def pinned(**bearing):
    """Return the pinned rig with other pins, ready for kernels."""
    return checked(changed(ideal("pinned"), backup_bearing=bearing))


def depth(model, x: float, y: float) -> float:
    """Return the penetration with the shaft's centre at (x, y), m."""
    station = model.rotor.bearing_station
    return penetration(
        for_kernels(model), candidates_of(model), State(*state(tilt_x=x / station, tilt_y=y / station))
    )


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
    model = pinned(pins=(Pin(wear=0.4e-3, number=3),))
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


def test_pins_of_a_description_have_numbers_of_their_own():
    rig = load_rig(
        "thesis-pinned", [f"{PINS}.3.wear=2e-4", f"{PINS}.1.stiffness=1e7", f"{PINS}.1.friction=0"]
    )
    assert rig.model.backup_bearing.pins == (Pin(0.0, 1e7, 0.0, 1), Pin(2e-4, None, None, 3))
    assert rig_from_text(rig.toml).model == rig.model
    places = candidates_of(checked(rig.model))[:4]
    assert list(places[:, STIFFNESS]) == [1e7, 5e7, 5e7, 5e7]
    assert list(places[:, SLIDING]) == list(places[:, SLIDING]) == [0.0, 0.2, 0.2, 0.2]


def test_each_pin_presses_with_its_own_stiffness_and_friction():
    model = pinned(pins=(Pin(stiffness=1e7, friction=0.4, number=2), Pin(wear=1e-4, number=3)))
    bearing, places, deep = model.backup_bearing, candidates_of(model), 5e-5
    for number, (stiffness, friction, gap) in enumerate(
        [(5e7, 0.2, 1.5e-3), (1e7, 0.4, 1.5e-3), (5e7, 0.2, 1.6e-3), (5e7, 0.2, 1.5e-3)]
    ):
        angle = np.pi / 4 + number * np.pi / 2
        x, y = (gap + deep) / 0.211 * np.cos(angle), (gap + deep) / 0.211 * np.sin(angle)
        force = contact_force(for_kernels(model), places, State(*state(tilt_x=x, tilt_y=y, speed=60.0)))
        # The pin's tip is 18 mm away, so that what is left of 50 um has 1e-13 m of rounding in it.
        assert force.normal == pytest.approx(stiffness * deep**1.5, rel=1e-7)
        slip = 60.0 * 12.5e-3
        along = friction * force.normal * slip / np.hypot(slip, bearing.slip_speed)
        assert force.shaft_torque == pytest.approx(-along * 12.5e-3, rel=1e-9)


def test_pins_that_say_what_the_bearing_says_change_no_bit():
    like = tuple(Pin(0.0, 5e7, 0.2, number) for number in (1, 2, 4))
    start = hanging(model_of("pinned"), 10.5)
    truth = [signals(Simulation(pinned(pins=pins), state=start), 1.5) for pins in ((), like)]
    assert truth[0][13].max() > 5.0
    assert np.array_equal(*truth)


def test_a_pin_worn_out_of_reach_leaves_the_edge_to_its_neighbours():
    model = pinned(pin_count=8, pins=(Pin(wear=1e-3, number=2), Pin(wear=1e-4, number=5)))
    arcs = bearing_edge(model)
    assert len(arcs) == 7
    assert all(abs(depth(model, x, y)) < 1e-13 for arc in arcs for x, y in arc[::6])
    for arc, following in zip(arcs, [*arcs[1:], arcs[0]], strict=True):
        assert arc[-1] == pytest.approx(following[0], abs=1e-12)


def test_a_faulty_pin_is_refused():
    for setting, message in {
        "5.wear=1e-4": r"\[backup_bearing\.pin\.5\] is not one of the pin_count = 4 pins",
        "0.wear=1e-4": r"\[backup_bearing\.pin\.0\] is no pin's number; pins count from 1",
        "third.wear=1e-4": r"\[backup_bearing\.pin\.third\] is no pin's number",
        "3.wear=-2e-3": r"\[backup_bearing\.pin\.3\] wear = -0\.002 m leaves a gap of -0\.0005 m",
        "3.stiffness=0": r"\[backup_bearing\.pin\.3\] stiffness = 0 is outside 1 to 1e\+13 N/m\^1\.5",
        "3.friction=-0.1": r"\[backup_bearing\.pin\.3\] friction = -0\.1 is outside 0 to 2",
        "3.length=1": r"\[backup_bearing\.pin\.3\] length is not a key of this table",
        "3=1": r"\[backup_bearing\.pin\.3\] must be a table",
    }.items():
        with pytest.raises(RigError, match=message) as caught:
            load_rig("thesis-pinned", [f"{PINS}.{setting}"])
        assert "\n" not in str(caught.value)
    with pytest.raises(RigError, match=r"\[backup_bearing\.pin\] must be tables"):
        load_rig("thesis-pinned", [f"{PINS}=3"])
    with pytest.raises(RigError, match=r"\[emulator\.actual\.backup_bearing\.pin\.3\] wear"):
        load_rig("thesis-pinned", ["emulator.actual.backup_bearing.pin.3.wear=-2e-3"])


def test_bad_pins_are_refused():
    with pytest.raises(RigError, match=r"pin\.5\] is not one of the pin_count = 4 pins"):
        Simulation(changed(model_of("pinned"), backup_bearing={"pins": (Pin(number=5),)}))
    tables = {name: dict(part._asdict()) for name, part in model_of("pinned")._asdict().items()}
    tables = {
        name: {k: v for k, v in part.items() if not k.startswith("pin")} for name, part in tables.items()
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
