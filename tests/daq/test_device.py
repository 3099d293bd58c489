"""The emulated device's own process: it stops the rig when the daq cannot."""

import os
import re
import signal
from math import tau

import numpy as np
import pytest

from daq.backend import BackendError, SpeedOutput, make_backend
from daq.link import free_ports
from daq.messages import BlockStatus
from daq.rig import RigError, load_rig, with_ports
from tests.daq.daq_process import PATIENT, Client, DaqProcess, until

DEVICE = ["acquisition.backend=emulated-device", "device.watchdog_s=0.5", PATIENT]
RATE = 25_000
SPEED = 6.0  # Hz, well below the resonance
SAFE_RAMP = 40.0  # Hz/s


@pytest.fixture
def daq(tmp_path):
    """A daq whose rig turns, in front of a device of its own."""
    daq = DaqProcess(tmp_path, rig=with_ports(load_rig("thesis-ball", DEVICE), free_ports(4)))
    daq.wait_until_ready()
    client = Client(daq.rig)
    client.arm()
    assert client.ask("speed", speed_hz=SPEED, ramp_hz_per_s=30.0).accepted
    until(lambda: client.blocks and client.channel("motor_speed") > 0.95 * tau * SPEED)
    yield daq, client
    daq.process.kill()
    client.close()
    daq.close()


def watch(daq):
    """What the device says when its watchdog acts: (from which sample, why, at rest at which)."""
    acted = re.fullmatch(
        r"device: the device's watchdog has brought the rig to rest from sample (\d+) on: (.+)\n",
        daq.process.stderr.readline(),
    )
    rested = re.fullmatch(r"device: the rig is at rest at sample (\d+)\n", daq.process.stderr.readline())
    return int(acted[1]), acted[2], int(rested[1])


def seconds_to_stop(begun, rested):
    return (rested - begun) / RATE


def test_a_killed_daq_is_followed_by_a_rig_at_rest(daq):
    process, client = daq
    last = client.spans()[-1][1]
    process.process.kill()
    begun, why, rested = watch(process)
    assert why == "the daq is gone"
    assert begun > last
    # The ramp to 0.2 Hz takes 0.145 s; the drive follows its set-point with a lag of about 0.1 s.
    assert (SPEED - 0.2) / SAFE_RAMP < seconds_to_stop(begun, rested) < 1.5
    assert process.process.stderr.read() == ""  # its writing end is closed: the device has ended, too


def test_a_stopped_daq_loses_the_rig_for_good(daq):
    process, client = daq
    os.kill(process.process.pid, signal.SIGSTOP)
    begun, why, rested = watch(process)
    assert why == "the daq was silent for 0.5 s"
    assert (SPEED - 0.2) / SAFE_RAMP < seconds_to_stop(begun, rested) < 1.5
    os.kill(process.process.pid, signal.SIGCONT)
    failure = client.event("failure")
    assert "the device's watchdog has brought the rig to rest" in failure.text
    client.hear_the_end()
    assert process.finish()[0] == 2


def test_a_device_that_dies_is_a_failure():
    backend = make_backend("emulated-device")
    backend.open(load_rig("thesis-ball", DEVICE))
    backend.start()
    backend._process.kill()
    backend._process.wait()
    with pytest.raises(BackendError, match="the emulated device has died"):
        backend.write(SpeedOutput(1.0, 1.0))
    backend.close()


def test_a_silent_daq_needs_no_network_to_lose_the_rig(capfd):
    backend = make_backend("emulated-device")
    assert backend.capabilities.watchdog_s == 0.2
    backend.open(load_rig("thesis-ball", ["acquisition.backend=emulated-device", "device.watchdog_s=0.05"]))
    assert backend.capabilities.watchdog_s == 0.05
    backend.start()
    until(lambda: "at rest at sample" in capfd.readouterr().err)
    with pytest.raises(BackendError, match=r"watchdog has brought the rig to rest .* silent for 0\.05 s"):
        backend.read(np.empty((11, 50)))
    backend.close()


def test_its_samples_are_those_of_the_emulator():
    rig = load_rig("thesis-ball", DEVICE)
    backend, emulator = make_backend("emulated-device"), make_backend("emulator", paced=False)
    out, same = np.empty((len(rig.channels), 500)), np.empty((len(rig.channels), 500))
    backend.open(rig)
    emulator.open(rig)
    backend.start()
    emulator.start()
    until(lambda: backend.clock() >= 500)
    reading = backend.read(out)
    assert reading == emulator.read(same)
    assert reading.flags & ~int(BlockStatus.CLIPPED) == 0
    np.testing.assert_array_equal(out, same)
    np.testing.assert_array_equal(backend.truth(), emulator.truth())
    backend.close()


def test_a_watchdog_that_cannot_be_is_refused():
    rig = load_rig("thesis-ball", ["acquisition.backend=emulated-device", "device.watchdog=1"])
    with pytest.raises(RigError, match=r"\[device\] watchdog is not a key .*did you mean watchdog_s"):
        make_backend("emulated-device").open(rig)
