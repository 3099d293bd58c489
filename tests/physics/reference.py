"""The equations of the thesis written down a second time, for scipy, to check the compiled kernels against.

Nothing of `simulator` but the parameters is used here. Vectors are complex: x + iy. The speed is prescribed
and constant. Contacts are located as events, and the integration is begun anew at each.
"""

from cmath import exp

import numpy as np
from scipy.integrate import solve_ivp

from simulator.rig import BearingKind, Model

# The first nine entries of `simulator.state.STATE`, then the shaft's angle.
SIZE = 10


def walls(model: Model, q: complex) -> list[tuple[complex, float]]:
    """Return (normal, penetration) of each place where shaft and bearing may touch; q is their offset."""
    bearing, radius = model.backup_bearing, model.rotor.shaft_radius
    if bearing.kind != BearingKind.PINNED:
        return [(q / abs(q), abs(q) - bearing.clearance)] if q else [(0j, -bearing.clearance)]
    reach = radius + bearing.pin_tip_radius
    centres = [(reach + bearing.clearance) * exp(1j * np.pi * (0.25 + 0.5 * k)) for k in range(4)]
    return [((c - q) / abs(c - q), reach - abs(c - q)) for c in centres]


def loads(model: Model, y: np.ndarray, speed: float, touching: list[bool]):
    """Return (force on the rotor, extra moment of axial friction, torque on the ring)."""
    rotor, bearing = model.rotor, model.backup_bearing
    ball = bearing.kind == BearingKind.BALL
    u, v, h, hv = complex(y[0], y[1]), complex(y[2], y[3]), complex(y[4], y[5]), complex(y[6], y[7])
    q, qd = rotor.bearing_station * u - h, rotor.bearing_station * v - hv
    force, moment, torque = 0j, 0j, 0.0
    for (n, d), closed in zip(walls(model, q), touching, strict=True):
        if not closed:
            continue
        rate = (qd * n.conjugate()).real
        depth = max(d, 0.0)
        normal = max(0.0, bearing.stiffness * depth**1.5 * (1 + 1.5 * bearing.damping_factor * rate))
        t = 1j * n
        lever = rotor.bearing_station * u + rotor.shaft_radius * n
        ring = y[8] * (bearing.clearance + rotor.shaft_radius) if ball else 0.0
        slip_t = (qd * t.conjugate()).real + speed * rotor.shaft_radius - ring
        slip_z = -(lever * v.conjugate()).real
        slip = np.sqrt(slip_t**2 + slip_z**2 + bearing.slip_speed**2)
        along_t, along_z = -bearing.friction * normal * np.array([slip_t, slip_z]) / slip
        force += -normal * n + along_t * t
        moment += -lever * along_z
        torque += -along_t * (bearing.clearance + rotor.shaft_radius) if ball else 0.0
    return force, moment, torque


def rates(time: float, y: np.ndarray, model: Model, speed: float, touching: list[bool]) -> np.ndarray:
    """Return the derivative of the state."""
    rotor, magnet, house, bearing = model.rotor, model.magnetic_bearing, model.housing, model.backup_bearing
    u, v = complex(y[0], y[1]), complex(y[2], y[3])
    force, moment, torque = loads(model, y, speed, touching)
    moment += rotor.bearing_station * force
    moment -= (magnet.stiffness * rotor.magnet_station**2 + rotor.pivot_stiffness) * u
    moment -= magnet.damping * rotor.magnet_station**2 * v
    moment -= 1j * rotor.mass * rotor.gravity * rotor.centre_of_mass_station
    moment += 1j * rotor.coupling_station * rotor.coupling_force
    phase = exp(1j * (y[9] + rotor.unbalance_angle))
    moment += rotor.disk_station * rotor.unbalance * speed**2 * phase
    a = (moment + 1j * rotor.polar_inertia * speed * v) / rotor.inertia
    spring = 2 * house.transducer_stiffness
    ax = (-spring * y[4] - 2 * house.horizontal_damping * y[6] - force.real) / (
        house.inner_mass + house.outer_mass
    )
    ay = (-spring * y[5] - 2 * house.vertical_damping * y[7] - force.imag) / house.inner_mass
    ball = bearing.kind == BearingKind.BALL
    ring = (torque - bearing.ring_damping * y[8]) / bearing.ring_inertia if ball else 0.0
    return np.array([v.real, v.imag, a.real, a.imag, y[6], y[7], ax, ay, ring, speed])


def gaps(model: Model, y: np.ndarray) -> list[float]:
    """Return the penetration of each candidate."""
    q = model.rotor.bearing_station * complex(y[0], y[1]) - complex(y[4], y[5])
    return [d for _, d in walls(model, q)]


def integrate(model: Model, start: np.ndarray, speed: float, duration: float):
    """Return (state at the end, times at which a contact closed), by DOP853 with located events."""
    time, y, closings = 0.0, np.array(start[:SIZE]), []
    touching = [d > 0 for d in gaps(model, y)]
    while time < duration:
        events = [crossing(model, index) for index in range(len(touching))]
        part = solve_ivp(
            rates,
            (time, duration),
            y,
            method="DOP853",
            rtol=1e-11,
            atol=1e-13,
            events=events,
            args=(model, speed, touching),
        )
        time, y = part.t[-1], part.y[:, -1]
        for index, found in enumerate(part.t_events):
            if len(found):
                touching[index] = not touching[index]
                closings += [time] if touching[index] else []
                time, y = step_over(model, y, time, speed, touching)
    return y, closings


def crossing(model: Model, index: int):
    """Return the event function of one candidate."""

    def penetration(time, y, *_):
        return gaps(model, y)[index]

    penetration.terminal = True
    return penetration


def step_over(model: Model, y: np.ndarray, time: float, speed: float, touching: list[bool]):
    """Step a nanosecond past an event, so that it is not found again."""
    step = 1e-9
    return time + step, y + step * rates(time, y, model, speed, touching)
