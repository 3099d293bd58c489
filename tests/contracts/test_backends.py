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


class TestEmulatedDevice(BackendConformance):
    rig = load_rig("thesis-ball", ["acquisition.backend=emulated-device", "device.watchdog_s=10"])

    def new_backend(self):
        return make_backend("emulated-device")

    def unplug(self, backend):
        backend._process.kill()
        backend._process.wait()


class TestSlowCoarseEmulator(BackendConformance):
    rig = load_rig("thesis-ball", ["acquisition.rate=10000.0", "acquisition.read=30", "acquisition.block=90"])

    def new_backend(self):
        return make_backend("emulator", paced=False)


def test_an_unknown_backend_is_refused_with_the_known_ones():
    with pytest.raises(BackendError, match="no backend is called emulater; did you mean emulator"):
        make_backend("emulater")
    with pytest.raises(BackendError, match=r"no backend is called scope; installed are .*emulator"):
        make_backend("scope")


def test_the_emulator_is_known():
    assert "emulator" in known_backends()


def test_a_backend_of_another_package_is_found_by_its_entry_point(tmp_path, monkeypatch):
    (tmp_path / "lab_rig.py").write_text("from daq.backends.emulator import Emulator as LabDevice\n")
    installed = tmp_path / "lab_rig-1.0.dist-info"
    installed.mkdir()
    (installed / "METADATA").write_text("Metadata-Version: 2.1\nName: lab-rig\nVersion: 1.0\n")
    (installed / "entry_points.txt").write_text("[rigtwin.backends]\nlab = lab_rig:LabDevice\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert "lab" in known_backends()
    backend = make_backend("lab", paced=False)
    backend.open(load_rig("thesis-ball"))
    backend.start()
    backend.close()
