"""The last check before the device: what passes, what does not, and why."""

from math import inf, nan, tau

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daq.backend import Capabilities, EnableOutput, HitOutput, RestOutput, SpeedOutput
from daq.envelope import Envelope, EnvelopeError, Present, Pulse, longest_on
from daq.rig import load_rig, rig_from_text

RIG = load_rig("thesis-ball")
RATE = 25_000
SAFE = RestOutput(40.0 * tau)
READY = Present(sample=1000, armed=True, silence=0.05, tripped=False, ending=False)
SECOND = '[[solenoid]]\nname = "vertical"\nstation = 0.3\nangle_deg = 90.0\nmax_force = 10.0\n'
SECOND += "max_duration = 0.01\nforce_per_ampere = 5.0\n"
TWO = rig_from_text(SECOND + RIG.toml)


class Device:
    """Performs everything 10 samples after `clock`, or when it is scheduled."""

    capabilities = Capabilities((1.0, 1e6), (), True, None, True, True, longest_pulse_s=1.0)

    def __init__(self):
        self.clock = READY.sample
        self.written = []

    def write(self, output, at_sample=None):
        self.written.append((output, at_sample))
        return self.clock + 10 if at_sample is None else at_sample


class Site:
    def __init__(self, rig=RIG):
        self.device = Device()
        self.envelope = Envelope(rig, self.device)

    def write(self, output, at_sample=None, now=READY):
        self.device.clock = now.sample
        return self.envelope.write(output, at_sample, now)

    def refused(self, output, at_sample=None, now=READY):
        written = list(self.device.written)
        with pytest.raises(EnvelopeError) as error:
            self.write(output, at_sample, now)
        assert self.device.written == written
        return str(error.value)


@pytest.fixture
def site():
    return Site()


def hit(force=5.0, duration=0.01, solenoid="horizontal"):
    return HitOutput(solenoid, force, duration)


MOVES = [SpeedOutput(10.0, 10.0), hit()]


@pytest.mark.parametrize("output", MOVES)
def test_what_is_allowed_passes_untouched(site, output):
    assert site.write(output) == 1010
    assert site.write(SpeedOutput(0.0, 1.0), 2000) == 2000
    assert site.device.written == [(output, None), (SpeedOutput(0.0, 1.0), 2000)]


@pytest.mark.parametrize("output", MOVES)
@pytest.mark.parametrize(
    ("now", "said"),
    [
        (READY._replace(armed=False), "nothing moves: the rig is not armed"),
        (READY._replace(tripped=True), "nothing moves: the rig is tripped"),
        (READY._replace(ending=True), "nothing moves: the run is ending"),
        (READY._replace(silence=0.1), "nothing moves: the holder has been silent for 0.1 s"),
        (READY._replace(silence=nan), "nothing moves: the holder has been silent for nan s"),
    ],
)
def test_nothing_moves_without_permission(site, output, now, said):
    assert site.refused(output, now=now) == said


def test_a_holder_may_be_silent_for_less_than_the_lease(site):
    site.write(MOVES[0], now=READY._replace(silence=0.0999))


@pytest.mark.parametrize("output", MOVES)
def test_outputs_are_scheduled_from_the_next_sample_to_ten_seconds_ahead(output):
    for at_sample in (1001, 1000 + 10 * RATE):
        assert Site().write(output, at_sample) == at_sample
    for at_sample in (1000, 1, 1001 + 10 * RATE):
        assert Site().refused(output, at_sample) == f"sample {at_sample} is not within 1001 to 251000"


@pytest.mark.parametrize(
    ("output", "said"),
    [
        (SpeedOutput(157.1, 10.0), "speed 157.1 rad/s is not within 0 to 157.08 rad/s"),
        (SpeedOutput(-0.1, 10.0), "speed -0.1 rad/s is not within 0 to 157.08 rad/s"),
        (SpeedOutput(nan, 10.0), "speed nan rad/s is not within 0 to 157.08 rad/s"),
        (SpeedOutput(inf, 10.0), "speed inf rad/s is not within 0 to 157.08 rad/s"),
        (SpeedOutput(10.0, 314.2), "ramp 314.2 rad/s2 is not above 0 to 314.159 rad/s2"),
        (SpeedOutput(10.0, 0.0), "ramp 0 rad/s2 is not above 0 to 314.159 rad/s2"),
        (SpeedOutput(10.0, inf), "ramp inf rad/s2 is not above 0 to 314.159 rad/s2"),
        (hit(force=60.1), "force 60.1 N is not within 0 to 60 N"),
        (hit(force=-0.1), "force -0.1 N is not within 0 to 60 N"),
        (hit(force=nan), "force nan N is not within 0 to 60 N"),
        (hit(duration=0.0501), "0.0501 s is not above 0 to 0.05 s"),
        (hit(duration=0.0), "0 s is not above 0 to 0.05 s"),
        (hit(duration=nan), "nan s is not above 0 to 0.05 s"),
        (hit(duration=inf), "inf s is not above 0 to 0.05 s"),
        (hit(solenoid="other"), "the rig has no solenoid other"),
    ],
)
def test_ranges(site, output, said):
    assert site.refused(output) == said


@pytest.mark.parametrize(
    "output",
    [
        SpeedOutput(25.0 * tau, 50.0 * tau),
        SpeedOutput(0.0, 1e-9),
        hit(force=60.0, duration=0.05),
        hit(force=0.0, duration=1e-9),
    ],
)
def test_the_ends_of_the_ranges_are_allowed(site, output):
    site.write(output)
    assert site.device.written == [(output, None)]


@pytest.mark.parametrize("now", [READY, READY._replace(armed=False, tripped=True, ending=True, silence=9.0)])
@pytest.mark.parametrize("asked", [SAFE, RestOutput(nan), RestOutput(0.0), RestOutput(1e9)])
def test_rest_always_passes_with_the_rigs_own_ramp(site, now, asked):
    assert site.write(asked, 7, now) == 1010
    assert site.device.written == [(SAFE, None)]


def test_the_enable_output_drops_always_and_rises_untripped(site):
    tripped = READY._replace(armed=False, tripped=True, ending=True)
    assert site.write(EnableOutput(False), now=tripped) == 1010
    assert (
        site.refused(EnableOutput(True), now=tripped) == "the enable output stays dropped: the rig is tripped"
    )
    site.write(EnableOutput(True), now=READY._replace(armed=False))
    assert site.device.written == [(EnableOutput(False), None), (EnableOutput(True), None)]


BUSY = "solenoid horizontal is still on then: one pulse at a time"


def test_one_pulse_of_a_solenoid_at_a_time(site):
    assert site.write(hit(), 2000) == 2000  # on from 2000 to 2250
    for at_sample in (1751, 2000, 2249):
        assert site.refused(hit(), at_sample) == BUSY
    site.write(hit(), 1750)
    site.write(hit(), 2250)
    assert site.refused(hit(), now=READY._replace(sample=1900)) == BUSY


def test_a_hit_that_is_not_scheduled_is_on_from_when_the_device_says(site):
    site.write(hit())  # at 1010, to 1260
    assert site.refused(hit(), 1259) == BUSY
    site.write(hit(), 1260)


def test_the_shortest_pulse_is_one_sample(site):
    site.write(hit(duration=1e-9), 2000)
    assert site.refused(hit(duration=1e-9), 2000) == BUSY
    site.write(hit(duration=1e-9), 2001)


def test_solenoids_are_apart():
    site = Site(TWO)
    site.write(hit(), 2000)
    site.write(hit(solenoid="vertical"), 2000)
    assert site.refused(hit(force=10.1, solenoid="vertical"), 3000) == "force 10.1 N is not within 0 to 10 N"


def test_rest_ends_pulses(site):
    site.write(hit(duration=0.05), 2000)  # to 3250
    site.write(hit(), 5000)
    site.write(SAFE, now=READY._replace(sample=2990))  # rest at 3000
    assert site.refused(hit(), 2999) == BUSY
    site.write(hit(), 3000)
    site.write(hit(), 5000)


def test_a_solenoid_is_on_for_its_share_of_ten_seconds():
    """0.2 of 10 s is 40 pulses of 50 ms; the next may come when the first is 10 s ago."""
    site = Site()
    for number in range(40):
        site.write(hit(duration=0.05), 2000 + 2500 * number)
    said = "solenoid horizontal would be on for more than 20 % of 10 s: let it cool down"
    now = READY._replace(sample=100_000)
    assert site.refused(hit(duration=0.05), 102_000, now) == said
    assert site.refused(hit(duration=0.05), 2000 + 10 * RATE - 1, now) == said
    site.write(hit(duration=0.05), 2000 + 10 * RATE, now)


def test_a_pulse_before_others_counts_in_their_window():
    site = Site()
    for number in range(40):
        site.write(hit(duration=0.05), 100_000 + 2500 * number)
    assert "cool down" in site.refused(hit(duration=0.05), 50_000)


def brute_force(pulses, window):
    """Count in every window that begins at some sample."""
    on = np.zeros(max(pulse.end for pulse in pulses) + window, int)
    for pulse in pulses:
        on[pulse.begin : pulse.end] += 1
    sums = np.concatenate([[0], np.cumsum(on)])
    return int((sums[window:] - sums[:-window]).max())


@given(
    st.lists(st.tuples(st.integers(0, 20), st.integers(1, 10)), min_size=1, max_size=8), st.integers(1, 60)
)
def test_the_worst_window_is_found(gaps, window):
    begin, pulses = 0, []
    for gap, length in gaps:
        pulses.append(Pulse("a", begin + gap, begin + gap + length))
        begin += gap + length
    assert longest_on(pulses, window) == brute_force(pulses, window)


@pytest.mark.parametrize("longest", [None, 0.009, nan])
def test_a_pulse_that_the_device_would_not_end_by_itself_is_refused(site, longest):
    site.device.capabilities = site.device.capabilities._replace(longest_pulse_s=longest)
    assert site.refused(hit()) == "the device would not end a pulse of 0.01 s by itself"
    assert site.write(SpeedOutput(1.0, 1.0)) == 1010


def test_a_pulse_of_just_what_the_device_times_passes(site):
    site.device.capabilities = site.device.capabilities._replace(longest_pulse_s=0.01)
    assert site.write(hit()) == 1010
