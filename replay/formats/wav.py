"""WAV with 32 bit floating point samples, to be listened to or opened in an audio editor.

A channel's samples are divided by a power of two, the one at or above its full scale: that keeps every
digit and makes full scale at most 1. Missing samples are silence (0), since players stumble over NaN. The
comment (chunk `LIST`, `ICMT`) is JSON: what holds for all, the channels with the `scale` that gives their
unit back, and `gaps`. Format: Microsoft, "Multimedia Programming Interface and Data Specifications 1.0".
"""

import json
import struct
from collections.abc import Iterable
from math import ceil, log2
from pathlib import Path

import numpy as np

from daq.recording import RecordingError, Signals
from replay.formats.head import Head

RIFF = struct.Struct("<4sI4s")
CHUNK = struct.Struct("<4sI")
FORMAT = struct.Struct("<HHIIHHH")
FACT = struct.Struct("<I")
IEEE_FLOAT = 3
LARGEST = 2**32 - 2**20  # bytes of samples: lengths have 32 bits, and the comment needs some room


def write(path: Path, head: Head, pieces: Iterable[Signals]) -> None:
    """Write the file; the lengths in its head are put right at the end."""
    rate, n_channels = round(head.rate), len(head.columns)
    if rate != head.rate:
        raise RecordingError(f"{path}: a WAV file has a whole number of samples a second, not {head.rate:g}")
    scales = [2.0 ** ceil(log2(column.full_scale)) for column in head.columns]
    divisor = np.array(scales, np.float32)[:, np.newaxis]
    gaps: list[tuple[int, int]] = []
    size = 0
    with path.open("xb") as file:
        file.write(_head(rate, n_channels, size, b""))
        for piece in pieces:
            samples = np.where(np.isnan(piece.samples), np.float32(0.0), piece.samples / divisor)
            size += samples.nbytes
            if size > LARGEST:
                raise RecordingError(
                    f"{path}: a WAV file has room for 4 GiB: choose fewer channels or a part"
                )
            file.write(np.ascontiguousarray(samples.T, "<f4").data)
            gaps += piece.gaps
        comment = _comment(head, scales, gaps)
        file.write(comment)
        file.seek(0)
        file.write(_head(rate, n_channels, size, comment))


def _head(rate: int, n_channels: int, size: int, comment: bytes) -> bytes:
    """Return all that stands before `size` bytes of samples."""
    frame = 4 * n_channels
    form = FORMAT.pack(IEEE_FLOAT, n_channels, rate, rate * frame, frame, 32, 0)
    parts = [
        CHUNK.pack(b"fmt ", len(form)) + form,
        CHUNK.pack(b"fact", FACT.size) + FACT.pack(size // frame),
        CHUNK.pack(b"data", size),
    ]
    body = b"".join(parts)
    return RIFF.pack(b"RIFF", 4 + len(body) + size + len(comment), b"WAVE") + body


def _comment(head: Head, scales: list[float], gaps: list[tuple[int, int]]) -> bytes:
    """Return the chunk that tells what the samples are."""
    channels = [
        {"name": column.name, "scale": scale, **column.facts()}
        for column, scale in zip(head.columns, scales, strict=True)
    ]
    text = json.dumps(head.facts() | {"channels": channels, "gaps": gaps}).encode() + b"\0"
    text += b"\0" * (len(text) % 2)  # chunks are of even length
    info = b"INFO" + CHUNK.pack(b"ICMT", len(text)) + text
    return CHUNK.pack(b"LIST", len(info)) + info
