"""Constants of a model at one length of tick, computed once."""

from functools import lru_cache
from math import ceil, sqrt, tau

from simulator.candidates import SLIDING, STIFFNESS, candidates_of
from simulator.dynamics import DECAY_TURN, HOUSE_TURN, SHORTEST_SUBSTEP, Tick
from simulator.law import Surface, normal_stiffness
from simulator.rig import BearingKind, DriveMode, Model, RigError

Matrix = tuple[float, float, float, float]

TAYLOR_TERMS = 18  # of an exponential whose argument is at most 1/2: below 1e-20
LIGHT_DEPTH = 1e-5  # m, a light contact's
MOST_CONTACT_TURN = 0.5  # rad of the contact's own frequency in the shortest substep
LEAST_SUBSTEPS = 1  # of a tick with contact


def tick_of(model: Model, length: float) -> Tick:
    """Return the constants of `model` for ticks of `length` seconds. Raises `RigError`: see `check_steps`."""
    check_steps(model)
    house, bearing, rotor = model.housing, model.backup_bearing, model.rotor
    both = house.inner_mass + house.outer_mass
    spring = 2.0 * house.transducer_stiffness
    fastest = sqrt(spring / house.inner_mass)
    ball = bearing.kind == BearingKind.BALL
    decay = bearing.ring_damping / bearing.ring_inertia if ball else 0.0
    arm = rotor.magnet_station**2
    stiffness = model.magnetic_bearing.stiffness * arm + rotor.pivot_stiffness
    least = max(LEAST_SUBSTEPS, ceil(length * fastest / HOUSE_TURN))
    return Tick(
        length,
        *oscillator_map(spring / both, 2.0 * house.horizontal_damping / both, length),
        *oscillator_map(spring / house.inner_mass, 2.0 * house.vertical_damping / house.inner_mass, length),
        ring_decay=exponential((-decay * length, 0.0, 0.0, 0.0))[0],
        flight_rate=sqrt(stiffness / rotor.inertia) + model.magnetic_bearing.damping * arm / rotor.inertia,
        gyroscopic=1.0 + rotor.polar_inertia / rotor.inertia,
        mobility=approach(model) + spin_mobility(model),
        approach=approach(model),
        least_substeps=float(least),
        most_substeps=float(max(least, ceil(length / SHORTEST_SUBSTEP))),
    )


def check_steps(model: Model) -> None:
    """Refuse a contact that the shortest substep cannot follow, however light it is. Raises `RigError`."""
    bearing, places = model.backup_bearing, candidates_of(model)[: model.backup_bearing.pin_count]
    stiffness, friction = float(places[:, STIFFNESS].max()), float(places[:, SLIDING:].max())
    hardest = Surface(bearing.law, stiffness, 0.0, friction, friction, 1.0, 1.0)
    frequency = sqrt(normal_stiffness(hardest, LIGHT_DEPTH) * approach(model))
    if frequency * SHORTEST_SUBSTEP > MOST_CONTACT_TURN:
        raise RigError(
            f"[backup_bearing] stiffness = {stiffness:g} makes the contact swing at "
            f"{frequency / tau / 1e3:.0f} kHz, which steps of {SHORTEST_SUBSTEP * 1e6:g} us cannot follow; "
            "check its unit, which depends on the law"
        )
    weight = model.rotor.mass * max(model.rotor.gravity, 1.0)
    decay = friction * weight / bearing.slip_speed * (approach(model) + spin_mobility(model))
    if decay * SHORTEST_SUBSTEP > DECAY_TURN:
        raise RigError(
            f"[backup_bearing] slip_speed = {bearing.slip_speed:g} m/s makes friction stop the slip within "
            f"{1e6 / decay:.2g} us, which steps of {SHORTEST_SUBSTEP * 1e6:g} us cannot follow; give more, "
            "or check the inertia of ring and motor"
        )


def approach(model: Model) -> float:
    """Return the mobility (1/kg) of shaft against house at the bearing, along the lighter direction."""
    return model.rotor.bearing_station**2 / model.rotor.inertia + 1.0 / model.housing.inner_mass


def spin_mobility(model: Model) -> float:
    """Return what the spins of ring and shaft add to the contact point's mobility along the tangent, 1/kg."""
    rotor, bearing, drive = model.rotor, model.backup_bearing, model.drive
    mobility = 0.0
    if bearing.kind == BearingKind.BALL:
        mobility += (rotor.shaft_radius + bearing.clearance) ** 2 / bearing.ring_inertia
    if drive.mode == DriveMode.MOTOR:
        mobility += rotor.shaft_radius**2 / (drive.inertia + rotor.polar_inertia)
    return mobility


def oscillator_map(stiffness: float, damping: float, duration: float) -> Matrix:
    """Return the exact map of y'' = -stiffness y - damping y' through `duration` on (y, y'), row by row."""
    natural = sqrt(stiffness)
    turn = natural * duration
    a = exponential((0.0, turn, -turn, -damping * duration))  # of (natural y, y'), which are alike in size
    return a[0], a[1] / natural, a[2] * natural, a[3]


@lru_cache(maxsize=64)  # see `simulator.flight_map.series`
def exponential(a: Matrix) -> Matrix:
    """Return the exponential of a 2 x 2 matrix: Taylor's series of a fraction of it, squared up again."""
    halvings = 0
    while max(abs(value) for value in a) > 0.25:
        a = (0.5 * a[0], 0.5 * a[1], 0.5 * a[2], 0.5 * a[3])
        halvings += 1
    term: Matrix = (1.0, 0.0, 0.0, 1.0)
    total = term
    for order in range(1, TAYLOR_TERMS):
        b = product(term, a)
        term = (b[0] / order, b[1] / order, b[2] / order, b[3] / order)
        total = (total[0] + term[0], total[1] + term[1], total[2] + term[2], total[3] + term[3])
    for _ in range(halvings):
        total = product(total, total)
    return total


def product(a: Matrix, b: Matrix) -> Matrix:
    """Return the product of two 2 x 2 matrices, row by row."""
    return (
        a[0] * b[0] + a[1] * b[2],
        a[0] * b[1] + a[1] * b[3],
        a[2] * b[0] + a[3] * b[2],
        a[2] * b[1] + a[3] * b[3],
    )
