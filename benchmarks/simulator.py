"""How fast the simulator is: a run-up from 8 to 16 Hz with impacts, sampled at 25 kHz, on one core.

Beside it, on the same job: a plain Runge-Kutta 4 at 10 us in numba that uses the same forces, and, on a
stretch of it, `scipy.integrate.solve_ivp` (RK45 and DOP853) with the same compiled derivatives, begun anew
at each contact's entry and exit. The plain one also stands beside runs at constant, prescribed speeds: free
of contact (20 Hz), bouncing (12 Hz), and in permanent contact (990 g mm at 20 Hz), and the same with the
motor and its controller. A sweep of 1000 rigs runs on one thread and on two, by the clock, and beside it two
threads that have nothing in common, which is what the machine can give. Variants take turns in rotated
order; figures are medians, in processor time but for the sweep. Run `python -m benchmarks.simulator`; with
`--ross PYTHON`, a Python that has ross-rotordynamics, its rub model stands beside the bouncing rig.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from math import tau

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks import sweep_scaling
from benchmarks.report import Figure, in_turns, parser, show
from daq.rig import load_rig
from simulator.compile import kernel
from simulator.contact import contact_force, penetration
from simulator.drive import motor_torque, next_integral, set_point
from simulator.dynamics import derivatives
from simulator.rig import DriveMode, Model
from simulator.simulation import Simulation, signals_for
from simulator.state import Inputs
from simulator.stepping import pack, unpacked

ROUNDS = 5
CHUNK = 1000  # samples a call
RAMP = tau * 0.5  # rad/s2: 16 s from 8 to 16 Hz
SECONDS = 16.0
STRETCH = 0.4  # s, for scipy
SCIPY = ("RK45", "DOP853")
PLAIN = "plain Runge-Kutta 4 at 10 us, numba"
PLAIN_SUBSTEPS = 4  # of 10 us
CONSTANT_CHUNK = 5000  # samples a call at constant speed, where a call's own 3 us would show
DEMANDED = 50.0  # times real time
CONSTANT = {  # Hz and kg m
    "free_of_contact": (20.0, 75e-6),
    "bouncing": (12.0, 75e-6),
    "permanent_contact": (20.0, 990e-6),
}
ROSS = (  # its dependencies ask for an older protobuf, and it fails with plotly 6
    'python -m venv ross; ross/bin/pip install "ross-rotordynamics>=2.3" "plotly<6"; '
    "python -m benchmarks.simulator --ross ross/bin/python"
)


@kernel
def rates(model: Model, candidates: np.ndarray, inputs: Inputs, values: np.ndarray, out: np.ndarray) -> None:
    """Write the derivatives of a state (12,)."""
    pack(derivatives(model, candidates, inputs, unpacked(values)), out)


@kernel
def add_scaled(values: np.ndarray, scale: float, rate: np.ndarray, out: np.ndarray) -> None:
    """Write values + scale rate."""
    for index in range(values.shape[0]):
        out[index] = values[index] + scale * rate[index]


@kernel
def plain_step(model: Model, candidates: np.ndarray, inputs: Inputs, values: np.ndarray, work: np.ndarray):
    """Step a state (12,) by the textbook's Runge-Kutta 4 through 10 us; `work` is (5, 12)."""
    step, point = 10e-6, work[4]
    rates(model, candidates, inputs, values, work[0])
    add_scaled(values, 0.5 * step, work[0], point)
    rates(model, candidates, inputs, point, work[1])
    add_scaled(values, 0.5 * step, work[1], point)
    rates(model, candidates, inputs, point, work[2])
    add_scaled(values, step, work[2], point)
    rates(model, candidates, inputs, point, work[3])
    for index in range(values.shape[0]):
        middle = 2.0 * (work[1, index] + work[2, index])
        values[index] += step / 6.0 * (work[0, index] + middle + work[3, index])


@kernel
def plain_run(
    model: Model,
    candidates: np.ndarray,
    ramp: np.ndarray,
    first: int,
    values: np.ndarray,
    out: np.ndarray,
    work: np.ndarray,
):
    """Fill `out` (17, n) as the simulator does, stepping 10 us at a time; `work` is (5, 12)."""
    tick = 40e-6
    for column in range(out.shape[1]):
        force = contact_force(model, candidates, unpacked(values))
        for row in range(11):
            out[row, column] = values[row]
        out[11, column], out[12, column] = force.force_x, force.force_y
        out[13, column], out[14, column] = force.normal, max(force.penetration, 0.0)
        wanted = set_point(ramp, first + column, tick)
        out[15, column], out[16, column] = wanted, 0.0
        error = wanted - values[10]
        inputs = Inputs(motor_torque(model.drive, error, values[11]), 0.0, 0.0, 0.0)
        integral = next_integral(model.drive, error, values[11], tick)
        for _ in range(PLAIN_SUBSTEPS):
            plain_step(model, candidates, inputs, values, work)
        values[11] = integral


@kernel
def depth(model: Model, candidates: np.ndarray, values: np.ndarray) -> float:
    """Return the penetration in a state (12,)."""
    return penetration(model, candidates, unpacked(values))


class Job:
    """The run-up of one model from its settled state at 8 Hz."""

    def __init__(self, model: Model):
        self.model = model
        self.buffer = signals_for(CHUNK)
        simulation = Simulation(model)
        simulation.set_speed(tau * 8.0, tau * 26.7)
        for _ in range(100):
            simulation.advance(self.buffer)
        self.start = simulation.state.copy()
        self.candidates = simulation.candidates.copy()

    def simulated(self) -> float:
        """Run the simulator; return seconds of run-up for each second of processor time."""
        simulation = Simulation(self.model, state=self.start)
        simulation.set_speed(tau * 16.0, RAMP)
        contacts, begin = 0, time.process_time()
        for _ in range(self.chunks):
            simulation.advance(self.buffer)
            contacts += int(self.buffer[13].max() > 0.0)
        spent = time.process_time() - begin
        assert contacts > 100, "the job is a run-up with impacts"
        return SECONDS / spent

    def plain(self) -> float:
        """Run the plain integrator; return the same."""
        values, ramp = self.start.copy(), np.array([self.start[10], tau * 16.0, RAMP, 0.0])
        work = np.empty((5, 12))
        begin = time.process_time()
        for chunk in range(self.chunks):
            plain_run(self.model, self.candidates, ramp, chunk * CHUNK, values, self.buffer, work)
        return SECONDS / (time.process_time() - begin)

    @property
    def chunks(self) -> int:
        """Calls for the whole run-up."""
        return round(SECONDS * 25000 / CHUNK)


class Constant:
    """A settled rig at a constant, prescribed speed."""

    def __init__(self, model: Model, hz: float, unbalance: float):
        self.model = model._replace(rotor=model.rotor._replace(unbalance=unbalance))
        self.buffer = signals_for(CONSTANT_CHUNK)
        state = Simulation(self.model).state
        state[10] = tau * hz
        simulation = Simulation(self.model, state=state)
        for _ in range(round(8.0 * 25000 / CONSTANT_CHUNK)):
            simulation.advance(self.buffer)
        self.start, self.candidates = simulation.state.copy(), simulation.candidates

    def simulated(self) -> float:
        """Run the simulator; return seconds of run for each second of processor time."""
        simulation = Simulation(self.model, state=self.start)
        return self._rate(20, lambda _: simulation.advance(self.buffer))

    def plain(self) -> float:
        """Run the plain integrator; return the same."""
        values, ramp = self.start.copy(), np.array([self.start[10], self.start[10], 1.0, 0.0])
        model, work = Simulation(self.model).model, np.empty((5, 12))
        return self._rate(
            4,
            lambda chunk: plain_run(
                model, self.candidates, ramp, chunk * CONSTANT_CHUNK, values, self.buffer, work
            ),
        )

    def _rate(self, chunks: int, run: Callable[[int], None]) -> float:
        begin = time.process_time()
        for chunk in range(chunks):
            run(chunk)
        return chunks * CONSTANT_CHUNK / 25000 / (time.process_time() - begin)


class Stretch:
    """Some settled impacts at 12 Hz, at constant speed."""

    def __init__(self, model: Model):
        self.model = model
        simulation = Simulation(model)
        simulation.set_speed(tau * 12.0, tau * 4.0)
        self.buffer = signals_for(round(STRETCH * 25000))
        for _ in range(round(6.0 / STRETCH)):
            simulation.advance(self.buffer)
        self.start = simulation.state.copy()
        self.candidates = simulation.candidates.copy()

    def simulated(self) -> float:
        """Run the simulator; return seconds of run for each second of processor time."""
        simulation = Simulation(self.model, state=self.start)
        begin = time.process_time()
        for _ in range(10):
            simulation.advance(self.buffer)
        return 10 * STRETCH / (time.process_time() - begin)

    def scipy(self, method: str) -> float:
        """Run an integrator of scipy's, sampled at 25 kHz; return the same."""
        times, at, y = np.arange(round(STRETCH * 25000)) / 25000.0, 0.0, self.start.copy()
        begin = time.process_time()
        while at < STRETCH:
            wanted = times[times >= at]
            part = solve_ivp(
                self._rates,
                (at, STRETCH),
                y,
                method,
                t_eval=wanted,
                events=self._crossing,
                rtol=1e-6,
                atol=1e-9,
            )
            if not len(part.t_events[0]):
                break
            at, y = part.t_events[0][0] + 1e-9, part.y_events[0][0]
            y = y + 1e-9 * self._rates(at, y)
        return STRETCH / (time.process_time() - begin)

    def _rates(self, _time: float, y: np.ndarray) -> np.ndarray:
        out = np.empty(12)
        rates(self.model, self.candidates, Inputs(0.0, 0.0, 0.0, 0.0), y, out)
        return out

    def _crossing(self, _time: float, y: np.ndarray) -> float:
        return depth(self.model, self.candidates, np.ascontiguousarray(y))

    _crossing.terminal = True  # type: ignore[attr-defined]


def speeds_of(variants: dict[str, Callable[[], float]]) -> dict[str, float]:
    """Run each variant `ROUNDS` times, taking turns, after once for warming up; return the medians."""
    for variant in variants.values():
        variant()
    return in_turns(variants, ROUNDS)


def compile_time() -> float:
    """Return the processor time (s) of a first start: Python, numba, and compiling the kernels."""
    code = (
        "from daq.rig import load_rig; from simulator.simulation import Simulation, signals_for; "
        "Simulation(load_rig('thesis-ball').model).advance(signals_for(2))"
    )
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "XDG_CACHE_HOME": folder, "NUMBA_CACHE_DIR": folder}
        before = os.times()
        subprocess.run([sys.executable, "-c", code], env=environment, check=True)
        after = os.times()
        return after.children_user - before.children_user + after.children_system - before.children_system


def ross_rate(python: str) -> tuple[float, str]:
    """Return the seconds of run for each second of processor time of ross' rub model, and its version."""
    command = [python, "-m", "benchmarks.ross_rub"]
    output = subprocess.run(command, check=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    found = json.loads(output.stdout.splitlines()[-1])
    assert found["contact"] > 0.0, "the job is one with contact"
    return found["rate"], found["version"]


def measured(ross: str | None) -> dict[str, Figure]:
    """Run everything and return the figures; `ross` is a Python that has ross-rotordynamics."""
    motor = load_rig("thesis-ball").model
    assert motor is not None
    ideal = motor._replace(drive=motor.drive._replace(mode=DriveMode.IDEAL))
    ideal = Simulation(ideal).model
    jobs_at = (
        ("free_of_contact", 20.0, 75e-6),
        ("bouncing", 12.0, 75e-6),
        ("permanent_contact", 20.0, 990e-6),
    )
    constant = {name: Constant(ideal, hz, unbalance) for name, hz, unbalance in jobs_at}
    constant |= {f"{name}_motor": Constant(motor, hz, unbalance) for name, hz, unbalance in jobs_at}
    stretch, jobs = Stretch(ideal), Job(motor)
    speed = speeds_of(
        {
            "motor": jobs.simulated,
            "ideal": Job(ideal).simulated,
            "plain": jobs.plain,
            "stretch": stretch.simulated,
            **{method: partial(stretch.scipy, method) for method in SCIPY},
            **{name: job.simulated for name, job in constant.items()},
            **{f"{name}_plain": job.plain for name, job in constant.items()},
        }
    )
    unit = "x real time"
    figures = {
        "run_up": Figure(speed["motor"], unit, DEMANDED, "what is demanded"),
        "run_up_prescribed_speed": Figure(speed["ideal"], unit, DEMANDED, "what is demanded"),
        "run_up_plain": Figure(speed["motor"], unit, speed["plain"], PLAIN),
        **{
            f"impacts_{method.lower()}": Figure(
                speed["stretch"], unit, speed[method], f"solve_ivp with {method} and events"
            )
            for method in SCIPY
        },
        **{name: Figure(speed[name], unit, speed[f"{name}_plain"], PLAIN) for name in constant},
        **sweep_scaling.measured(ideal),
        "first_start": Figure(compile_time(), "s", 15.0, "what a new user may wait for the kernels"),
    }
    if ross:
        rate, version = ross_rate(ross)
        figures["bouncing_ross"] = Figure(speed["bouncing"], unit, rate, f"rub model of ross {version}")
    return figures


def main() -> None:
    """Measure and report."""
    options = parser(__doc__)
    options.add_argument("--ross", metavar="PYTHON", help="a Python that has ross-rotordynamics")
    given = options.parse_args()
    if not given.ross:
        print(f"without ross-rotordynamics, which needs an environment of its own: {ROSS}", file=sys.stderr)
    show(measured(given.ross), given.json)


if __name__ == "__main__":
    main()
