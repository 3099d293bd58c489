from math import cos, pi, sin

import numpy as np
import pytest

from simulator.compile import kernel
from simulator.numeric import direction, normal_noise, sine_cosine, stream_key


@kernel
def fill(seed: int, stream: int, first: int, out: np.ndarray) -> None:
    key = stream_key(seed, stream)
    for index in range(len(out)):
        out[index] = normal_noise(key, first + index)


def noise(seed: int, stream: int, first: int, count: int) -> np.ndarray:
    out = np.empty(count)
    fill(seed, stream, first, out)
    return out


def test_sine_and_cosine_equal_the_library_s():
    # Near zero to 1e6 rad, which is two hours at 25 Hz. Bound: one unit in the last place of 1, plus the
    # rounding of the reduced angle, which is a few 1e-17 of the angle's own spacing.
    for angle in (*np.linspace(-10.0, 10.0, 2001), *np.linspace(0.0, 1e6, 2001), 0.25 * pi, 0.5 * pi, pi):
        sine, cosine = sine_cosine(float(angle))
        assert abs(sine - sin(angle)) < 3e-16
        assert abs(cosine - cos(angle)) < 3e-16


def test_directions_are_exact_at_right_angles():
    for angle, vector in (
        (0, (1, 0)),
        (90, (0, 1)),
        (180, (-1, 0)),
        (270, (0, -1)),
        (-90, (0, -1)),
        (360, (1, 0)),
    ):
        assert direction(float(angle)) == vector
    for angle in np.linspace(-360.0, 360.0, 97):
        # 2 pi is held to 9e-16, so the library's sine of it is no better.
        radians = angle * pi / 180.0
        assert direction(float(angle)) == pytest.approx((cos(radians), sin(radians)), abs=2e-15)


def test_noise_is_normal_to_the_stated_degree():
    values = noise(1, 3, 0, 400_000)
    # Standard errors with n = 4e5: mean 1.6e-3, variance 2.2e-3, fourth moment 1.5e-2; bounds: four of them.
    assert abs(values.mean()) < 6.4e-3
    assert abs(values.var() - 1.0) < 9e-3
    assert abs((values**4).mean() - (3.0 - 0.04)) < 0.065
    assert abs((values > 1.959964).mean() - 0.025) < 0.003  # the coin tosses' steps are 0.29 wide


def test_noise_is_white_and_differs_between_streams_and_seeds():
    a, b, c = noise(1, 0, 0, 100_000), noise(1, 1, 0, 100_000), noise(2, 0, 0, 100_000)
    # A correlation coefficient of independent values has a standard error of 3.2e-3; bounds are four of them.
    for x, y in ((a[1:], a[:-1]), (a[7:], a[:-7]), (a, b), (a, c)):
        assert abs(np.corrcoef(x, y)[0, 1]) < 0.013


def test_noise_depends_on_the_index_alone():
    assert np.array_equal(noise(5, 2, 0, 1000)[300:], noise(5, 2, 300, 700))
