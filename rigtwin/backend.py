"""What a data acquisition device must offer to be used by rigtwin: write a class for `Backend`'s rules.

Name it in the entry-point group `rigtwin.backends` of your package, and in `[acquisition] backend` of a rig.
"""

from daq.backend import (
    Backend,
    BackendError,
    Capabilities,
    EnableOutput,
    HitOutput,
    Output,
    OutputRefused,
    PastSampleError,
    Reading,
    RestOutput,
    SpeedOutput,
)
from daq.messages import BlockStatus

__all__ = [
    "Backend",
    "BackendError",
    "BlockStatus",
    "Capabilities",
    "EnableOutput",
    "HitOutput",
    "Output",
    "OutputRefused",
    "PastSampleError",
    "Reading",
    "RestOutput",
    "SpeedOutput",
]
