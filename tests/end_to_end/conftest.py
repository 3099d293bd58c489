"""One live run that several tests examine."""

import numpy as np
import pytest

from tests.end_to_end.rig_process import PATIENT, rigtwin


@pytest.fixture(scope="session")
def live_run(tmp_path_factory):
    """A live run over the plan `impacts`, with an unbalance angle that only the emulator knows.

    Returns the recording's path and what the command printed.
    """
    folder = tmp_path_factory.mktemp("live")
    angle = np.random.default_rng().uniform(0.0, 2.0 * np.pi)
    path = folder / "run.mcap"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RIGTWIN_RUNTIME_DIR", str(folder / "runtime"))
        result = rigtwin(
            "live", "--plan", "impacts", "--view", "none", "--record", path,
            "--seed", np.random.default_rng().integers(1, 2**31),
            "--set", f"emulator.actual.rotor.unbalance_angle={angle:.3f}", *PATIENT,
            cwd=folder, timeout=240,
        )  # fmt: skip
    assert result.returncode == 0, result.stdout + result.stderr
    return path, result.stdout
