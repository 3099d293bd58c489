"""The NI backend on nidaqmx's own Python layer, above a double of the driver. No NI hardware was there."""

import sys
from importlib.util import find_spec

import numpy as np
import pytest

from daq.backend import (
    BackendError,
    EnableOutput,
    HitOutput,
    OutputRefused,
    RestOutput,
    SpeedOutput,
    make_backend,
)
from daq.conformance import BackendConformance
from daq.optional import MissingPackage
from daq.rig import load_rig
from tests.conftest import require
from tests.daq.daq_process import until

DEVICE = (
    "acquisition.backend=nidaqmx",
    "device.address=Dev1",
    "device.speed_output=ao0",
    "device.enable_output=port0/line0",
    "device.solenoids.horizontal=ctr1",
)
RIG = load_rig("thesis-ball", DEVICE)
VOLTS = 0.05  # per rad/s


@pytest.fixture(autouse=True)
def double(monkeypatch):
    require(find_spec("nidaqmx") is not None, "nidaqmx")
    from tests.daq.ni_double import Double

    double = Double()
    monkeypatch.setattr("nidaqmx.utils._select_interpreter", lambda *_: double)
    return double


@pytest.fixture
def backend():
    backend = make_backend("nidaqmx")
    backend.open(RIG)
    backend.start()
    yield backend
    backend.close()


def read(backend, count):
    """The next samples, by row's name."""
    out, done = np.empty((len(RIG.channels), count)), 0

    def more():
        nonlocal done
        part = np.empty((len(RIG.channels), count - done))
        reading = backend.read(part)
        out[:, done : done + reading.n_samples] = part[:, : reading.n_samples]
        done += reading.n_samples
        return done == count

    until(more)
    return dict(zip(RIG.channels.names, out, strict=True))


class TestNiDaqmx(BackendConformance):
    rig = RIG

    def new_backend(self):
        return make_backend("nidaqmx")


def test_what_it_can_follows_from_the_description(backend):
    assert backend.capabilities.outputs == (RestOutput, SpeedOutput, HitOutput, EnableOutput)
    assert not backend.capabilities.emulated
    bare = make_backend("nidaqmx")
    bare.open(load_rig("thesis-ball", DEVICE[:2]))
    assert bare.capabilities.outputs == (RestOutput,)
    bare.close()


def test_each_row_is_its_terminal(double, backend):
    double.volts |= {f"ai{number}": 0.1 * number for number in range(8)}
    found = read(backend, 100)
    for channel in RIG.channels:
        if channel.terminal.startswith("ai"):
            assert set(found[channel.name]) == {0.1 * int(channel.terminal[2:])}


def test_counts_are_within_the_turn_and_turns_go_on(double, backend):
    double.speed = 30.0
    found = read(backend, 25_000)
    turns = 30.0 * np.arange(25_000) / 25_000.0
    whole = found["encoder_turns"] + found["encoder_angle"] / 4096
    assert found["encoder_angle"].max() < 4096
    np.testing.assert_allclose(whole, turns, atol=1.001 / 4096)
    double.speed = -30.0


def test_backwards_turns_count_down():
    from daq.backends.nidaqmx import turned

    ticks = np.array([10.0, 0.0, 4090.0, 3000.0, 1500.0, 100.0, 4000.0])
    within, turns = turned(ticks, 20.0, 3, 4096.0)
    np.testing.assert_array_equal(within, ticks)
    np.testing.assert_array_equal(turns, [3, 3, 2, 2, 2, 2, 1])


def test_the_set_point_follows_its_ramp_by_the_devices_clock(backend):
    sample = backend.write(SpeedOutput(20.0, 100.0))
    command = read(backend, sample + 8000)["motor_speed_command"]
    assert command[0] == 0.0
    assert command[-1] == pytest.approx(20.0 * VOLTS)
    # 0.2 s from end to end, in steps of 1 ms; begun up to one call before what `write` says
    rising = np.flatnonzero((command > 0.0) & (command < 20.0 * VOLTS))
    assert np.ptp(rising) == pytest.approx(0.2 * 25_000, abs=3 * 25)
    slopes = np.diff(command[rising[0] : rising[-1] : 25])
    np.testing.assert_allclose(slopes, 100.0 * 1e-3 * VOLTS, atol=1e-9)


def test_rest_takes_over_where_the_ramp_is(double, backend):
    backend.write(SpeedOutput(20.0, 50.0))
    until(lambda: backend._speed.now() > 5.0)
    backend.write(RestOutput(100.0))
    highest = backend._speed.now()
    assert 5.0 <= highest < 20.0
    until(lambda: backend._speed.now() == 0.0)
    backend.stop()
    assert double.held["ao0"] == 0.0


def test_closing_brings_the_set_point_to_zero(double):
    backend = make_backend("nidaqmx")
    backend.open(RIG)
    backend.start()
    backend.write(SpeedOutput(20.0, 1000.0))
    until(lambda: backend._speed.now() == 20.0)
    backend.close()
    assert double.held["ao0"] == 0.0
    assert double.tasks == {}


def test_a_hit_is_a_pulse_that_the_counter_ends(double, backend):
    backend.write(HitOutput("horizontal", 60.0, 0.02))
    backend.write(HitOutput("horizontal", 60.0, 0.01))
    assert double.pulses == [("Dev1/ctr1", 0.02), ("Dev1/ctr1", 0.01)]
    with pytest.raises(OutputRefused, match="switched, not controlled: hit with 60 N"):
        backend.write(HitOutput("horizontal", 30.0, 0.01))


def test_the_enable_line_is_driven(double, backend):
    backend.write(EnableOutput(True))
    backend.write(EnableOutput(False))
    assert double.lines == [("port0/line0", True), ("port0/line0", False)]


def test_an_output_cannot_wait_for_a_sample(backend):
    with pytest.raises(OutputRefused, match="Dev1 cannot wait for a sample"):
        backend.write(SpeedOutput(1.0, 1.0), backend.clock() + 10_000)


def test_a_buffer_that_has_overflowed_is_a_failure(double, backend):
    start = double.clock()
    double.clock = lambda: start + 100.0
    with pytest.raises(BackendError, match=r"Dev1: The application is not able to keep up\. .*-200279"):
        backend.read(np.empty((len(RIG.channels), 50)))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (["device.address=Dev2"], r"Dev2: Device identifier is invalid\."),
        (["acquisition.rate=51200.0"], r"samples with 51150\.\d+ Hz when told 51200 Hz: write"),
        (["device.speed_output=ao1"], r'speed_output = "ao1" needs a \[\[channel\]\] with that terminal'),
        (["device.solenoids.vertical=ctr1"], "no solenoid is named vertical"),
        (["device.wire=rse"], "wire is not a key of this table; did you mean wiring"),
    ],
)
def test_what_is_wrong_with_the_description_is_said(settings, message):
    backend = make_backend("nidaqmx")
    with pytest.raises((BackendError, ValueError), match=message):
        backend.open(load_rig("thesis-ball", [*DEVICE, *settings]))
    backend.close()


def test_a_device_in_use_is_said(double):
    backend = make_backend("nidaqmx")
    backend.open(RIG)
    double.busy = True
    with pytest.raises(BackendError, match=r"Dev1: The specified resource is reserved\."):
        backend.start()
    backend.close()


def test_a_missing_driver_is_said(monkeypatch):
    monkeypatch.undo()
    with pytest.raises(BackendError, match="NI-DAQmx is not installed"):
        make_backend("nidaqmx").open(RIG)


def test_a_missing_package_names_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "nidaqmx", None)
    with pytest.raises(MissingPackage, match=r"pip install 'rigtwin\[nidaqmx\]'"):
        make_backend("nidaqmx").open(RIG)
