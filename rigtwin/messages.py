"""What travels between the processes of a run, for programs that listen or read payloads.

Series of samples (`Block`, `Estimate`, `Truth`) are read by `decode_series`; all other messages by their
class, as `Summary.FromString(payload)`.
"""

from daq.messages import BlockStatus, MessageError, Series, decode_series
from daq.messages_pb2 import (
    Answer,
    ChannelSummary,
    Command,
    Description,
    Event,
    Severity,
    Status,
    Summary,
    TwinSummary,
)

__all__ = [
    "Answer",
    "BlockStatus",
    "ChannelSummary",
    "Command",
    "Description",
    "Event",
    "MessageError",
    "Series",
    "Severity",
    "Status",
    "Summary",
    "TwinSummary",
    "decode_series",
]
