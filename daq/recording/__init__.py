"""Recordings: written, read, mended and judged; `writer` is the only module that touches the mcap package."""

from daq.recording.certificate import Certificate, Check
from daq.recording.reader import Message, Recording
from daq.recording.signals import Signals, series_end
from daq.recording.storage import RecordingError, part_path, parts, prepare
from daq.recording.writer import RecordingWriter, Recovered, recover

__all__ = [
    "Certificate",
    "Check",
    "Message",
    "Recording",
    "RecordingError",
    "RecordingWriter",
    "Recovered",
    "Signals",
    "part_path",
    "parts",
    "prepare",
    "recover",
    "series_end",
]
