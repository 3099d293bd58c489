"""Models that contradict themselves are refused with one line."""

import pytest

from daq.rig import RigError, load_rig

# Each case: a setting, and what the message names.
CONTRADICTIONS = {
    "rotor.inertia=0.04": r"\[rotor\] inertia = 0\.04 kg m2 is less than .* = 0\.04912 kg m2",
    "rotor.polar_inertia=0.2": r"\[rotor\] polar_inertia = 0\.2 kg m2 is more than twice the inertia",
    "backup_bearing.ring_inertia=0": r"\[backup_bearing\] ring_inertia = 0 kg m2 must be above 0 for a ball",
    "backup_bearing.law=flores": r'\[backup_bearing\] damping_mode = "fixed" does not go with law = "flores"',
    "emulator.actual.rotor.inertia=0.04": r"\[emulator\.actual\.rotor\] inertia = 0\.04",
    "emulator.actual.backup_bearing.ring_inertia=0": r"\[emulator\.actual\.backup_bearing\] ring_inertia",
}


@pytest.mark.parametrize(("setting", "message"), CONTRADICTIONS.items(), ids=CONTRADICTIONS.keys())
def test_a_contradiction_is_refused_when_the_rig_is_read(setting, message):
    with pytest.raises(RigError, match=message) as caught:
        load_rig("thesis-ball", [setting])
    assert "\n" not in str(caught.value)
