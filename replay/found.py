"""What the twin has found out about the rig by the end of a recording: for people, as data, as a rig file."""

from math import degrees
from pathlib import Path
from typing import Any

from analysis.regime import named
from daq import keys
from daq.messages_pb2 import Description, TwinSummary
from daq.recording import Recording, RecordingError
from daq.rig import RigError, toml_source
from twin.identification import BALANCE_RADIUS, KEYS

SHOWN = {
    "kg m": ("g mm", 1e6),
    "kg": ("g", 1e3),
    "rad": ("deg", degrees(1.0)),
    "m": ("µm", 1e6),
}
"""Unit in which people see an SI unit, and how many of it make one."""


def last_summary(recording: Recording) -> TwinSummary | None:
    """Return the twin's last summary with parameters; None where the recording has none."""
    key = keys.twin_summary(recording.description.rig)
    message = recording.last(key).get(key) if key in recording.topics() else None
    summary = TwinSummary.FromString(message.payload) if message else None
    return summary if summary and summary.parameters else None


def facts(summary: TwinSummary | None) -> dict[str, Any]:
    """Return parameters (SI), what the data could not tell, and the regime; empty without a summary."""
    if summary is None:
        return {}
    rows = [
        {"name": each.name, "unit": each.unit, "value": each.value, "sigma": each.sigma, "told": each.told}
        for each in summary.parameters
    ]
    return {
        "parameters": rows,
        "not_told": list(summary.not_told),
        "regime": summary.regime,
        "regime_confidence": summary.regime_confidence,
    }


def lines(found: dict[str, Any]) -> list[str]:
    """Return what `facts` found for people to read."""
    if not found:
        return []
    rows = {row["name"]: row for row in found["parameters"]}
    shown = [
        f"{name:20}{shown_value(row)}{'' if row['told'] else '   not told by the data'}"
        for name, row in rows.items()
        if not name.startswith("balance_")
    ]
    regime = f"regime at the end: {named(found['regime'], found['regime_confidence'])}"
    return ["", "the twin found", *shown, *advice(rows), *found["not_told"], regime]


def shown_value(row: dict[str, Any]) -> str:
    """Return a parameter's value with its standard deviation, in the unit that people see."""
    unit, scale = SHOWN.get(row["unit"], (row["unit"], 1.0))
    return f"{scale * row['value']:14.6g} +- {scale * row['sigma']:<10.3g} {'' if unit == '1' else unit}"


def advice(rows: dict[str, Any]) -> list[str]:
    """Return how to balance the rotor, once its unbalance has been told."""
    mass, angle = rows["balance_mass"], rows["balance_angle"]
    if not mass["told"]:
        return []
    return [
        f"to balance: {1e3 * mass['value']:.3g} g at {1e3 * BALANCE_RADIUS:.0f} mm radius on the disk, "
        f"{degrees(angle['value']):.1f} deg from the encoder's zero, with rotation"
    ]


def rig_file(description: Description, summary: TwinSummary) -> str:
    """Return a rig description (TOML) with the parameters that the data have told.

    It stands on the recorded rig where that is a shipped one, and is complete otherwise.
    """
    shipped = description.rig in toml_source.shipped("rig")
    tables = {} if shipped else toml_source.parse(description.toml, f"rig description of {description.run}")
    head = {"base": description.rig} if shipped else {}
    about = f"found by the twin in run {description.run}"
    changes: dict[str, Any] = {"rig": head | {"name": f"{description.rig}-found", "description": about}}
    for each in summary.parameters:
        if each.told and each.key:
            table, key = each.key.split(".")
            changes.setdefault(table, {})[key] = each.value
    return toml_source.dump(toml_source.merge(tables, changes))


def found_rig(recording: Recording) -> str:
    """Return the rig file of what was found in a recording.

    Raises:
        RecordingError: the twin told no parameters in it.
    """
    summary = last_summary(recording)
    if summary is None:
        raise RecordingError(
            f"{recording.path} holds no parameters found by the twin: `rigtwin twin FILE -o OUT` makes them"
        )
    return rig_file(recording.description, summary)


def found_values(path: Path) -> dict[str, float]:
    """Return the parameters (SI) found in a rig file of `found_rig` or in a recording, by "table.key".

    Of a rig file those that the twin can find and that stand in the file itself, not in its base.

    Raises:
        RigError: the rig file cannot be read, or has none of them.
        RecordingError: the recording cannot be read, or the twin told none in it.
    """
    if path.suffix == ".toml":
        text = toml_source.read(path)
    else:
        with Recording(path) as recording:
            text = found_rig(recording)
    tables = toml_source.parse(text, str(path))
    places = [(key, *key.split(".")) for key in KEYS]
    found = {key: tables[table][name] for key, table, name in places if name in (tables.get(table) or ())}
    if not found:
        raise RigError(f"{path} has none of the parameters that the twin finds: {', '.join(KEYS)}")
    return found
