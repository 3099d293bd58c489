"""Public API of rigtwin: import from here, not from the rooms behind it.

Names are loaded when they are first used, so that `import rigtwin` costs nothing. Besides these there are
`rigtwin.backend` (what a device must offer), `rigtwin.conformance` (its test suite) and `rigtwin.messages`
(what travels between the processes).
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from daq.commanding.plan import Plan, load_plan
    from daq.recording import Recording, RecordingError, Signals
    from daq.recording.recorded_run import RecordedRun
    from daq.rig import Rig, RigError, load_rig, rig_from_text, shipped_rigs
    from replay.export import export
    from rigtwin.simulate_command import simulate

__all__ = [
    "Plan",
    "RecordedRun",
    "Recording",
    "RecordingError",
    "Rig",
    "RigError",
    "Signals",
    "export",
    "load_plan",
    "load_rig",
    "rig_from_text",
    "shipped_rigs",
    "simulate",
]

_HOMES = {
    "Plan": "daq.commanding.plan",
    "RecordedRun": "daq.recording.recorded_run",
    "Recording": "daq.recording",
    "RecordingError": "daq.recording",
    "Rig": "daq.rig",
    "RigError": "daq.rig",
    "Signals": "daq.recording",
    "export": "replay.export",
    "load_plan": "daq.commanding.plan",
    "load_rig": "daq.rig",
    "rig_from_text": "daq.rig",
    "shipped_rigs": "daq.rig",
    "simulate": "rigtwin.simulate_command",
}


def __getattr__(name: str) -> Any:
    """Load a public name from the room where it lives."""
    if name not in _HOMES:
        raise AttributeError(f"module 'rigtwin' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
