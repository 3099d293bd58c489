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
DELAYS = tuple(0.5 + number / 15.0 / 16.0 for number in range(16))  # s: over one turn at 15 Hz
DROPPED = (0.0, 15e-6, 21e-6, 30e-6, 105e-6, 207e-6, 318e-6, 420e-6)  # kg m, P1 figure 5
BIFURCATION = tuple(round(10e-6 * number, 9) for number in range(43))
LIFTS = tuple(float(force) for force in range(-34, -23))  # N, of the coupling in a drop
P1_CONTACT = {
    "stiffness": 2.5e10,
    "damping_mode": 1,
    "restitution": 1.0 - (1.0 - 0.9**2) / 2,
    "friction": 0.2,
}


def model(name: str) -> Model:
    """Return the model of a shipped rig."""
    found = load_rig(name).model
    assert found is not None
    return found


def published_drop() -> Model:
    """Return P1's rotor as published: its contact, no force of the coupling."""
    return changed(model("thesis-ball"), rotor={"coupling_force": 0.0}, backup_bearing=P1_CONTACT)


def lifted_drop(force: float, rig: str) -> Model:
    """Return the rotor with a coupling that carries `force` (N, negative) and a rig's contact, P1's friction."""
    return changed(model(rig), rotor={"coupling_force": force}, backup_bearing={"friction": 0.2})


def solenoid() -> Solenoid:
    """Return the solenoid of the thesis' rig, without a limit to its force."""
    return load_rig("thesis-ball").solenoids[0]


def vertical() -> Solenoid:
    """Return a solenoid that pushes upwards."""
    return solenoid()._replace(name="vertical", angle_deg=90.0)


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
    """Ramp up and down in ever less time."""
    return {
        f"{name} ramp {seconds:g} {phase:.2f} {'down' if down else 'up'}": Job(
            touches_in_ramp, (of, seconds, phase, down)
        )
        for seconds in RAMPS
        for phase in PHASES
        for down in (False, True)
    }


def hit_jobs(name: str, of: Model) -> dict[str, Job]:
    """Hit at 15 Hz, sideways and upwards, at sixteen angles of a turn."""
    return {
        f"{name} hit {pushed.name} {force:g}": Job(hits, (of, pushed, force, 15.0, DELAYS))
        for pushed in (solenoid(), vertical())
        for force in (40.0, 60.0, 80.0)
    }


def drop_jobs() -> dict[str, Job]:
    """Drop at 10 Hz over the unbalance, as published and with the coupling's lift."""
    found = {f"published {value:.6f}": Job(drop, (published_drop(), value)) for value in BIFURCATION}
    shipped = model("thesis-drop").rotor.coupling_force
    for value in BIFURCATION:
        found[f"lifted {value:.6f}"] = Job(drop, (lifted_drop(shipped, "thesis-ball"), value))
    for value in DROPPED:
        found[f"tenfold {value:.6f}"] = Job(drop, (lifted_drop(0.0, "thesis-ball-nominal"), 10.0 * value))
        for rig in ("thesis-ball", "thesis-ball-nominal"):
            for force in LIFTS:
                found[f"{rig} {force:g} {value:.6f}"] = Job(drop, (lifted_drop(force, rig), value))
        found[f"published at {value:.6f}"] = Job(drop, (published_drop(), value))
        found[f"lifted at {value:.6f}"] = Job(drop, (lifted_drop(shipped, "thesis-ball"), value))
    return found
