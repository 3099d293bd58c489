"""Which experiments of the thesis are run, on which models."""

from math import tau

from benchmarks.thesis_cache import Job
from benchmarks.thesis_runs import (
    changed,
    drop,
    drop_test,
    free_decay,
    hits,
    levels,
    stairs,
    touches_in_ramp,
)
from daq.rig import load_rig
from simulator.rig import Model, Solenoid

UP, DOWN = levels(0.5, 20.0), levels(19.5, 0.5)
PHASES = (0.0, tau / 4, tau / 2, 3 * tau / 4)  # rad, P3 section 5
HEAVY = 990e-6 + 75e-6  # kg m: 30 g at 33 mm and the residual, in phase
UNBALANCES = (75e-6, 120e-6, 140e-6, 160e-6, 180e-6, 205e-6, 280e-6)  # kg m, towards P2 table 3
RAMPS = (0.4, 0.5, 0.625, 0.75, 1.0, 1.5)  # s for 20 Hz
DELAYS = tuple(round(0.5 + number / 15.0 / 16.0, 3) for number in range(16))  # s: over one turn at 15 Hz
DROPPED = (0.0, 15e-6, 21e-6, 30e-6, 105e-6, 207e-6, 318e-6, 420e-6)  # kg m, P1 figure 5
BIFURCATION = tuple(round(10e-6 * number, 9) for number in range(43))
FRICTIONS = (0.1, 0.2, 0.4)  # of a plain wall and of tight pins
TIGHT = 0.8e-3  # m under the pins
LIGHT = (15e-6, 25e-6, 35e-6, 45e-6, 60e-6)  # kg m
HIGHER = (-14.0, -16.0, -18.0, -20.0)  # N
FORCES = (20.0, 40.0, 60.0, 80.0)  # N
LIFTS = (0.0, -20.0, -26.0, -30.0, -32.0, -33.0, -34.0, -36.0)  # N, of the coupling in a drop
P1_CONTACT = {
    "stiffness": 2.5e10,
    "damping_mode": 1,
    "restitution": 1.0 - (1.0 - 0.9**2) / 2,
    "friction": 0.2,
    "ring_damping": 0.0,
}
DROP_CONTACTS = {  # of the rig thesis-drop, and what differs from it
    "P3": {},
    "P3, ring with P3's drag": {"ring_damping": 6.908e-5},
    "P3, calibrated": {"stiffness": 5.0e7, "damping_factor": 2.1},
    "P1": P1_CONTACT,
}


def model(name: str) -> Model:
    """Return the model of a shipped rig."""
    found = load_rig(name).model
    assert found is not None
    return found


def published_drop() -> Model:
    """Return P1's rotor as published: its contact, no force of the coupling."""
    return changed(model("thesis-ball"), rotor={"coupling_force": 0.0}, backup_bearing=P1_CONTACT)


def lifted_drop(force: float, contact: str = "P3") -> Model:
    """Return the rotor of the rig `thesis-drop` with a coupling that lifts by -`force` N."""
    return changed(
        model("thesis-drop"), rotor={"coupling_force": force}, backup_bearing=DROP_CONTACTS[contact]
    )


def solenoid() -> Solenoid:
    """Return the solenoid of the thesis' rig, without a limit to its force."""
    return load_rig("thesis-ball").solenoids[0]


def pushing(angle_deg: float) -> Solenoid:
    """Return a solenoid that pushes into another direction."""
    return solenoid()._replace(angle_deg=angle_deg)


def jobs() -> dict[str, Job]:
    """Return all runs by name, the long ones first."""
    ball, nominal, pinned = model("thesis-ball"), model("thesis-ball-nominal"), model("thesis-pinned")
    return {
        "heavy": Job(stairs, (heavy(ball), levels(5.0, 20.0), levels(19.5, 5.0), 10.0, True, solenoid())),
        "ball": Job(stairs, (ball, UP, DOWN, 10.0, True)),
        "pinned": Job(stairs, (pinned, UP, DOWN, 10.0, True)),
        "nominal": Job(stairs, (nominal, levels(8.0, 18.0), levels(17.5, 8.0))),
        **phase_jobs("ball", ball),
        **phase_jobs("pinned", pinned),
        **unbalance_jobs("ball", ball),
        **unbalance_jobs("nominal", nominal),
        **ramp_jobs("ball", ball),
        **hit_jobs("ball", ball),
        **hit_jobs("nominal", nominal),
        **wall_jobs(),
        **drop_jobs(),
        "decay": Job(free_decay, (ball, solenoid())),
        "drop test": Job(drop_test, (changed(nominal, rotor={"coupling_force": 0.0}),)),
        "drop test, calibrated": Job(drop_test, (changed(ball, rotor={"coupling_force": 0.0}),)),
    }


def heavy(ball: Model) -> Model:
    """Return the rig with 30 g at 33 mm."""
    return changed(ball, rotor={"unbalance": HEAVY})


def phase_jobs(name: str, of: Model) -> dict[str, Job]:
    """Run up with the unbalance at each of P3's angles, 10 s and 3 s at each speed."""
    return {
        f"{name} phase {phase:.2f} dwell {seconds:g}": Job(
            stairs, (changed(of, rotor={"unbalance_angle": phase}), levels(9.0, 17.0), [], seconds)
        )
        for phase in PHASES
        for seconds in (10.0, 3.0)
    }


def unbalance_jobs(name: str, of: Model) -> dict[str, Job]:
    """Run up to 20 Hz with ever more unbalance."""
    return {
        f"{name} unbalance {unbalance:.6f}": Job(
            stairs, (changed(of, rotor={"unbalance": unbalance}), levels(8.0, 20.0), [], 5.0)
        )
        for unbalance in UNBALANCES
    }


def ramp_jobs(name: str, of: Model) -> dict[str, Job]:
    """Ramp up and down in ever less time; in 0.75 s also with less unbalance and a higher rest position."""
    found = {
        f"{name} ramp {seconds:g} {phase:.2f} {'down' if down else 'up'}": Job(
            touches_in_ramp, (of, seconds, phase, down)
        )
        for seconds in RAMPS
        for phase in PHASES
        for down in (False, True)
    }
    variants = {f"unbalance {value:.6f}": {"unbalance": value} for value in LIGHT}
    variants |= {f"coupling {force:g}": {"coupling_force": force} for force in HIGHER}
    for variant, rotor in variants.items():
        for phase in PHASES:
            job = Job(touches_in_ramp, (changed(of, rotor=rotor), 0.75, phase, False))
            found[f"{name} ramp {variant} {phase:.2f}"] = job
    return found


def hit_jobs(name: str, of: Model) -> dict[str, Job]:
    """Hit at 15 Hz from either side and upwards, at sixteen angles of a turn."""
    return {
        f"{name} hit {angle:g} {force:g}": Job(hits, (of, pushing(angle), force, 15.0, DELAYS))
        for angle in (180.0, 0.0, 90.0)
        for force in FORCES
    }


def wall_jobs() -> dict[str, Job]:
    """Run up along a plain wall and between tight pins, where P2 reports backward whirl."""
    plain, pinned = model("thesis-plain"), model("thesis-pinned")
    walls = {
        f"wall {friction:g}": changed(plain, backup_bearing={"friction": friction}) for friction in FRICTIONS
    }
    for friction in FRICTIONS:
        tight = {"friction": friction, "clearance": TIGHT}
        walls[f"tight pins {friction:g}"] = changed(pinned, backup_bearing=tight)
    return {name: Job(stairs, (of, levels(8.0, 16.0), [], 4.0)) for name, of in walls.items()}


def drop_jobs() -> dict[str, Job]:
    """Drop at 10 Hz over the unbalance, as published and with the coupling's lift."""
    shipped = model("thesis-drop").rotor.coupling_force
    found = {}
    for value in BIFURCATION:  # 6 to 12 s after the drop
        found[f"bifurcation published {value:.6f}"] = Job(drop, (published_drop(), value, 10.0, 12.0))
        found[f"bifurcation lifted {value:.6f}"] = Job(drop, (lifted_drop(shipped), value, 10.0, 12.0))
    for value in DROPPED:
        found[f"published {value:.6f}"] = Job(drop, (published_drop(), value))
        found[f"lifted {value:.6f}"] = Job(drop, (lifted_drop(shipped), value))
        found[f"tenfold {value:.6f}"] = Job(drop, (lifted_drop(0.0), 10.0 * value))
        for contact in DROP_CONTACTS:
            for force in LIFTS:
                found[f"{contact} {force:g} {value:.6f}"] = Job(drop, (lifted_drop(force, contact), value))
    return found
