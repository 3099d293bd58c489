"""How far the contact law is from the truth, learnt from what the sensors make of the residual force.

The residual force r is what the contact law leaves unexplained, and its process noise says how much that may
be. Where the law is right, a fixed noise is many times too much: r follows the sensors' noise, and the band
of the force is the noise's. Where the law's form is wrong the noise is needed.

A filter that is right about the noise makes of r, on average, the square that its covariance has lost to the
readings: E[r^2] = W - P, with W the variance that r would have without readings and P what is left of it.
Where the sensors make less of r than that, the noise is scaled down, and up again where they make more (the
principle of Mehra 1970, IEEE Trans. Autom. Control 15, 175: the noise from the filter's own innovations).
A law that is wrong shows in r only in part, as its parameters bend to it: r's square counts half as much
again. Where the noise is scaled down and the law turns out wrong, they bend before r can show it. Then the
innovations are larger than expected, and the noise becomes what it was at first.
"""

from math import exp, log

from simulator.compile import inlined, kernel
from twin.layout import RESIDUAL, Memory

FREE, LOG_SCALE, MADE, TOLD = range(4)  # entries of `Memory.misfit`
LEARNING = 600.0  # 1/s of contact, of the logarithm of the scale
AVERAGING = 50.0  # 1/s of contact, of what the sensors make of r
CAUTION = 1.5  # times r's square
DISBELIEF = 1.6  # times the innovations' expected variance, from which the law is as doubtful as at first
LARGEST_STEP = 2.0  # of the scale's logarithm, times LEARNING
LEAST, LARGEST = log(0.0025**2), log(2.0**2)  # of the noise's variance, squares of its amplitude


@inlined
def scale(memory: Memory) -> float:
    """Return by what the variance of the residual force's noise is multiplied."""
    return exp(memory.misfit[LOG_SCALE])


@kernel
def learn(memory: Memory, step: float) -> None:
    """Learn from the residual force after a tick's corrections; `step` in s. Out of contact there is none."""
    misfit = memory.misfit
    free = misfit[FREE]
    if free <= 0.0 or memory.force[0] <= 0.0:
        return
    made, told = 0.0, 0.0
    for i in range(RESIDUAL, RESIDUAL + 2):
        made += memory.state[i] * memory.state[i] / free
        told += max(0.0, 1.0 - memory.covariance[i, i] / free)
    misfit[MADE] += AVERAGING * step * (made - misfit[MADE])
    misfit[TOLD] += AVERAGING * step * (told - misfit[TOLD])
    if memory.surprise[0] > DISBELIEF:
        misfit[LOG_SCALE] = max(misfit[LOG_SCALE], 0.0)
    if misfit[TOLD] > 0.0:
        surplus = min(CAUTION * misfit[MADE] / misfit[TOLD] - 1.0, LARGEST_STEP)
        found = misfit[LOG_SCALE] + LEARNING * step * surplus
        misfit[LOG_SCALE] = min(max(found, LEAST), LARGEST)
