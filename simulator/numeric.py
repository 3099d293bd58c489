"""Elementary functions and counter-based noise made of arithmetic alone.

The C library's sine and exponential differ in the last bit between processors; these do not.
"""

from math import copysign, floor, radians, sqrt

import numpy as np

from simulator.compile import inlined

# pi/2 in two parts; the first has 33 bits, so that small multiples of it are exact.
HALF_PI_HIGH = 1.57079632673412561417
HALF_PI_LOW = 6.07710050650619224932e-11
TWO_OVER_PI = 0.63661977236758134308


@inlined
def sine_cosine(angle: float) -> tuple[float, float]:
    """Return sine and cosine of an angle (rad) to 1e-16 and the angle's own resolution."""
    quarter = floor(angle * TWO_OVER_PI + 0.5)
    rest = (angle - quarter * HALF_PI_HIGH) - quarter * HALF_PI_LOW
    z = rest * rest
    sine = rest + rest * z * (
        -1.66666666666666324348e-01
        + z
        * (
            8.33333333332248946124e-03
            + z
            * (
                -1.98412698298579493134e-04
                + z
                * (
                    2.75573137070700676789e-06
                    + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)
                )
            )
        )
    )
    cosine = (1.0 - 0.5 * z) + z * z * (
        4.16666666666666019037e-02
        + z
        * (
            -1.38888888888741095749e-03
            + z
            * (
                2.48015872894767294178e-05
                + z
                * (
                    -2.75573143513906633035e-07
                    + z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11)
                )
            )
        )
    )
    return in_quarter(quarter - 4.0 * floor(0.25 * quarter), sine, cosine)


@inlined
def in_quarter(quarter: float, sine: float, cosine: float) -> tuple[float, float]:
    """Turn sine and cosine by a number of quarter turns, 0 to 3; without branches, for vector processors."""
    odd = quarter == 1.0 or quarter == 3.0
    first, second = cosine if odd else sine, sine if odd else cosine
    return first if quarter < 2.0 else -first, -second if 0.0 < quarter < 3.0 else second


def direction(angle_deg: float) -> tuple[float, float]:
    """Return the unit vector (x, y) at an angle from +x towards +y, exact at right angles and diagonals."""
    quarter = round(angle_deg / 90.0)
    rest = angle_deg - 90.0 * quarter
    sine, cosine = sine_cosine(radians(rest))
    if abs(rest) == 45.0:
        sine, cosine = copysign(sqrt(0.5), rest), sqrt(0.5)
    y, x = in_quarter(quarter % 4, sine, cosine)
    return x, y


@inlined
def mixed(value: np.uint64) -> np.uint64:
    """Scramble 64 bits (the finaliser of SplitMix64)."""
    value = (value ^ (value >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    value = (value ^ (value >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return value ^ (value >> np.uint64(31))


@inlined
def ones(value: np.uint64) -> np.uint64:
    """Count the ones among 64 bits."""
    value = value - ((value >> np.uint64(1)) & np.uint64(0x5555555555555555))
    value = (value & np.uint64(0x3333333333333333)) + (
        (value >> np.uint64(2)) & np.uint64(0x3333333333333333)
    )
    value = (value + (value >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
    return (value * np.uint64(0x0101010101010101)) >> np.uint64(56)


@inlined
def stream_key(seed: int, stream: int) -> np.uint64:
    """Return the key of one of a seed's independent streams of noise."""
    return mixed(mixed(np.uint64(seed)) + np.uint64(stream) * np.uint64(0xD1342543DE82EF95))


@inlined
def normal_noise(key: np.uint64, counter: int) -> float:
    """Return number `counter` of a stream: mean 0, variance 1, nearly normal (excess kurtosis -0.04).

    Forty-eight coin tosses, of which the number of heads is nearly normal, spread over the steps between
    whole numbers by sixteen more bits.
    """
    bits = mixed(key + np.uint64(counter) * np.uint64(0x9E3779B97F4A7C15))
    heads = float(ones(bits & np.uint64(0xFFFFFFFFFFFF)))
    spread = float(bits >> np.uint64(48)) * (1.0 / 65536.0)
    return (heads + spread - (24.5 - 0.5 / 65536.0)) * NOISE_SCALE


NOISE_SCALE = (12.0 + 1.0 / 12.0) ** -0.5
