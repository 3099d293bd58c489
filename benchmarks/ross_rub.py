"""How fast ross-rotordynamics' rub model is on a rotor like the thesis': `PYTHON -m benchmarks.ross_rub`.

Run by a Python that has ross-rotordynamics, as `benchmarks.simulator --ross PYTHON` does. The job: a stiff
shaft on a pivot and a soft bearing, with an unbalance, at 12 Hz, that rubs against a ring with clearance at
the backup bearing's plane. ross takes steps of 40 us by Newmark's method and gives the response at each. Its
contact is a linear spring and damper with Coulomb friction; there is no ring that spins and no housing.
Prints one JSON object: version, seconds of run for each second of processor time, share of contact.
"""

import json
import time
from importlib import import_module
from itertools import pairwise
from math import pi, tau

import numpy as np

SECONDS = 0.2
STEP = 40e-6  # s
CLEARANCE = 1.5e-3  # m
PIVOT, BEARING, DISK, MAGNET = 0.0, 0.211, 0.3035, 0.384  # m, stations
RADIUS, MASS = 12.5e-3, 1.28  # m, kg


def main() -> None:
    """Run the job and print the figures."""
    ross = import_module("ross")

    stations = (PIVOT, BEARING, DISK, MAGNET)
    density = MASS / (pi * RADIUS**2 * MAGNET)
    shaft = ross.Material("shaft", rho=density, E=211e9, G_s=81.2e9)
    elements = [ross.ShaftElement(b - a, 0.0, 2.0 * RADIUS, material=shaft) for a, b in pairwise(stations)]
    disk = ross.DiskElement(n=2, m=0.1, Id=1e-4, Ip=2e-4)
    pivot = ross.BearingElement(n=0, kxx=1e8, cxx=1e3, kyy=1e8, cyy=1e3, kzz=1e6, czz=10.0)
    magnet = ross.BearingElement(n=3, kxx=2090.0, cxx=1.5)
    rotor = ross.Rotor(elements, [disk], [pivot, magnet])
    begin = time.process_time()
    response = rotor.run_rubbing(
        n=1,
        distance=CLEARANCE,
        contact_stiffness=5e5,
        contact_damping=100.0,
        friction_coeff=0.4,
        node=[2],
        unbalance_magnitude=[300e-6],
        unbalance_phase=[0.0],
        speed=tau * 12.0,
        t=np.arange(0.0, SECONDS, STEP),
    )
    spent = time.process_time() - begin
    radius = np.hypot(response.yout[:, 6], response.yout[:, 7])
    found = {"version": ross.__version__, "rate": SECONDS / spent}
    print(json.dumps(found | {"contact": float((radius >= CLEARANCE).mean())}))


if __name__ == "__main__":
    main()
