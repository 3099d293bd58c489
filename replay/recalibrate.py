"""A recording with other calibrations: its samples scaled anew, the original untouched."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from daq import keys
from daq.guard import guard_of
from daq.messages import decode_series
from daq.recording import RecordingError, RecordingWriter
from daq.recording.certificate import Certificate
from daq.rig import Rig, RigError, rig_from_text, toml_source
from daq.rig.channels import ChannelTable
from daq.stream import Stream
from daq.timing import StartTime
from replay.history import RepeatableRun
from replay.rerun import Progress, rig_of, without_twin

CALIBRATION = ("sensitivity", "offset", "certificate", "calibrated", "due", "delay_s")
"""The keys of a channel that are taken from the new description."""


def recalibrate(
    source: str | Path, new: Rig, target: str | Path, progress: Progress = lambda sample: None
) -> Certificate:
    """Write a recording anew as if its channels had been calibrated as those of another description.

    raw = value * old sensitivity + old offset; new value = (raw - new offset) / new sensitivity. Blocks and
    their summaries are made anew, events and the true state stay as they were; the twin's messages, which
    rested on the old values, are left out (`rigtwin twin` makes them anew).

    Args:
        source: recording; its continuations are taken along.
        new: rig whose channels of the same names have the new calibration.
        target: recording to write; an existing file is refused.
        progress: called with the index behind each block.

    Returns:
        The certificate of the new recording.

    Raises:
        RecordingError: the source cannot be read or the target cannot be written.
        RigError: the descriptions do not fit each other.
    """
    with RepeatableRun(source) as run:
        old = rig_of(run)
        run.check()
        scaled = with_calibration(old, new.channels)
        description = run.description
        changes = changed(old.channels, scaled.channels)
        if not changes:
            raise RigError(
                f"{new.name} has the calibration with which {run.path} was recorded: nothing to do"
            )
        description.toml = scaled.toml
        gain, shift = scaling(old.channels, scaled.channels)
        start = StartTime(description.t0_ns, description.t0_uncertainty_ns, description.t0_source)
        made_anew = {keys.summary(old.name), *(keys.channel_summary(old.name, n) for n in old.channels.names)}
        with RecordingWriter(target, description) as writer:
            writer.note("recalibrated", {"source": run.path.name, "channels": json.dumps(changes)})
            stream = Stream(scaled, guard_of(scaled), description.run, start, writer.add)
            for message in without_twin(run):
                if message.key == keys.block(old.name):
                    block = decode_series(message.payload)
                    if block.names != old.channels.names:
                        raise RecordingError(f"{run.path}: its blocks' channels are not those of its rig")
                    values = (gain * block.samples + shift).astype(np.float32)
                    stream.add(values, block.first_sample, block.status)
                    progress(block.first_sample + values.shape[1])
                elif message.key not in made_anew:
                    writer.add(message.key, message.payload)
            stream.flush()
            stored = run.files[-1].certificate
            return writer.close(
                expected=stored.first_sample + stored.expected if stored else None,
                clean=stored.clean if stored else writer.ledger.end_sample is not None,
            )


def with_calibration(rig: Rig, channels: ChannelTable) -> Rig:
    """Return the rig with the calibration of the channels of the same names. Raises `RigError`."""
    for name in rig.channels.names:
        if name not in channels:
            raise RigError(f"the new description has no channel {name}, which the recording has")
        if channels[name].quantity != rig.channels[name].quantity:
            raise RigError(
                f"channel {name} measures {rig.channels[name].quantity} in the recording, "
                f"{channels[name].quantity} in the new description"
            )
    tables = toml_source.parse(rig.toml, rig.name)
    tables["channel"] = [calibrated(row, channels) for row in tables["channel"]]
    return rig_from_text(toml_source.dump(tables), "the recording's rig with the new calibration")


def calibrated(row: Mapping[str, Any], channels: ChannelTable) -> dict[str, Any]:
    """Return a row of the channel table with another calibration."""
    given = channels[row["name"]]
    values = {key: getattr(given, key) for key in CALIBRATION}
    kept = {key: value for key, value in row.items() if key not in CALIBRATION}
    return kept | {key: value for key, value in values.items() if value is not None}


def changed(old: ChannelTable, new: ChannelTable) -> dict[str, dict[str, Sequence[object]]]:
    """Return what differs, by channel and key: (old value, new value), as JSON takes it."""
    found: dict[str, dict[str, Sequence[object]]] = {}
    for before, after in zip(old, new, strict=True):
        for key in CALIBRATION:
            pair = getattr(before, key), getattr(after, key)
            if pair[0] != pair[1]:
                said = [v if isinstance(v, float | None) else str(v) for v in pair]
                found.setdefault(before.name, {})[key] = said
    return found


def scaling(old: ChannelTable, new: ChannelTable) -> tuple[np.ndarray, np.ndarray]:
    """Return factor and summand that turn old values into new ones, each of shape (n_channels, 1)."""
    pairs = list(zip(old, new, strict=True))
    gain = [[before.sensitivity / after.sensitivity] for before, after in pairs]
    shift = [[(before.offset - after.offset) / after.sensitivity] for before, after in pairs]
    return np.array(gain), np.array(shift)
