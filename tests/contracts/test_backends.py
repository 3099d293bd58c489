"""Every shipped backend obeys the backend's contract."""

import pytest

from daq.backend import BackendError, known_backends, make_backend
from daq.conformance import BackendConformance
from daq.rig import load_rig


class TestPacedEmulator(BackendConformance):
    rig = load_rig("thesis-ball")

    def new_backend(self):
        return make_backend("emulator")


class TestUnpacedEmulator(BackendConformance):
    rig = load_rig("thesis-ball")

    def new_backend(self):
        return make_backend("emulator", paced=False)


class TestSlowCoarseEmulator(BackendConformance):
    rig = load_rig("thesis-ball", ["acquisition.rate=10000.0", "acquisition.read=30", "acquisition.block=90"])

    def new_backend(self):
        return make_backend("emulator", paced=False)


def test_an_unknown_backend_is_refused_with_the_known_ones():
    with pytest.raises(BackendError, match="no backend is called emulater; did you mean emulator"):
        make_backend("emulater")
    with pytest.raises(BackendError, match=r"no backend is called nidaq; installed are .*emulator"):
        make_backend("nidaq")


def test_the_emulator_is_known():
    assert "emulator" in known_backends()
