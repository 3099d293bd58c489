"""A rig: everything that its description (`rigs/*.toml`) says, validated and in SI units.

`load_rig` reads a shipped rig by name or a file by path. `Rig.toml` is the description with its base
and all overrides resolved: it travels with recordings, and `rig_from_text` makes an equal rig of it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from ipaddress import AddressValueError, IPv4Address
from math import isclose, tau
from pathlib import Path
from typing import Any, NamedTuple

from daq.rig import toml_source
from daq.rig.channels import Channel, ChannelTable, checked_table
from daq.rig.limits import Limits, limits_of
from daq.rig.settings import (
    AcquisitionSettings,
    CaptureSettings,
    CommandSettings,
    EmulatorSettings,
    EncoderSettings,
    LinkSettings,
    SafeStateSettings,
    TwinSettings,
)
from simulator.checks import check_bearing, check_model
from simulator.faults import Fault, check_fault, damaged_at, edges, of_rig, schedule
from simulator.rig import Model, Solenoid, model_from_mapping
from simulator.unbalance import UnbalanceMass, with_masses
from simulator.validation import NAME, RigError, nearest, tuple_at

__all__ = ["Rig", "RigError", "load_rig", "rig_from_text", "shipped_rigs", "with_overrides", "with_ports"]

MODEL_TABLES = Model._fields
TABLES = (
    "rig", *MODEL_TABLES, "unbalance_mass", "command", "safe_state", "solenoid", "acquisition", "device",
    "encoder", "channel", "limits", "capture", "twin", "link", "emulator",
)  # fmt: skip
EMULATORS = ("emulator", "emulated-device")
"""Backends behind which there is a model: in the daq's process, and in one of its own."""
NEEDED_BY_TWIN = ("proximity_x", "proximity_y", "encoder_angle", "motor_speed")


class Head(NamedTuple):
    """Table `[rig]`: what the rig is called, and its usual plan."""

    name: NAME
    description: str
    plan: str = ""


@dataclass(frozen=True)
class Rig:
    """One rig, immutable. Lengths m, forces N, angles rad, speeds rad/s, ramps rad/s2."""

    name: str
    description: str
    plan: str  # performed when none is named; empty for a rig that nothing moves
    model: Model | None  # what the twin is told; None for a rig without a model
    solenoids: tuple[Solenoid, ...]
    channels: ChannelTable
    acquisition: AcquisitionSettings
    device: Mapping[str, Any]  # what the backend wants to know: its address and whatever else
    command: CommandSettings
    safe_state: SafeStateSettings
    limits: Limits
    capture: CaptureSettings
    encoder: EncoderSettings | None  # None for a rig without one
    twin: TwinSettings
    link: LinkSettings
    emulator: EmulatorSettings
    actual: Model | None  # the emulated rig where it differs from `model`
    faults: tuple[Fault, ...]  # what goes wrong with the emulated rig and its sensors
    toml: str

    @property
    def emulated(self) -> bool:
        """Whether a model stands in for the rig, so that nothing real can move."""
        return self.acquisition.backend in EMULATORS

    @property
    def emulated_model(self) -> Model:
        """Model of the emulated rig. Raises `RigError` when the rig has no model."""
        if self.model is None:
            raise RigError(f"{self.name} has no model to emulate; add the tables {', '.join(MODEL_TABLES)}")
        return self.actual or self.model

    @property
    def regions(self) -> tuple[int, int]:
        """Samples before and after an event that belong to its region."""
        rate = self.acquisition.rate
        return round(self.capture.before * rate), round(self.capture.after * rate)

    @cached_property
    def solenoid_names(self) -> tuple[str, ...]:
        """Names of the solenoids."""
        return tuple(solenoid.name for solenoid in self.solenoids)

    def solenoid(self, name: str) -> Solenoid:
        """Return a solenoid by name. Raises `RigError` for an unknown one."""
        if name not in self.solenoid_names:
            raise RigError(f"no solenoid is named {name}{nearest(name, self.solenoid_names, 'there are')}")
        return self.solenoids[self.solenoid_names.index(name)]


def shipped_rigs() -> list[str]:
    """Return the names of the rigs that come with the product."""
    return list(toml_source.shipped("rig"))


def load_rig(name_or_path: str | Path, overrides: Sequence[str] = ()) -> Rig:
    """Read and validate a rig description.

    Args:
        name_or_path: name of a shipped rig, or path of a TOML file.
        overrides: `table.key=value` settings, as `rotor.unbalance=9e-5`, `channel.proximity_x.offset=0.1` or
            `emulator.actual.rotor.unbalance_angle=2.1`.

    Raises:
        RigError: naming file, table, key, value and what is allowed.
    """
    path = toml_source.find(name_or_path, "rig")
    tables = toml_source.read_with_bases(path, "rig")
    rig = _rig(tables, str(path))
    if not overrides:
        return rig
    changed = toml_source.override(tables, overrides)
    return _rig(changed, f"{path} with --set {' --set '.join(overrides)}")


def rig_from_text(text: str, source: str = "rig description") -> Rig:
    """Make a rig of its resolved description, as a recording carries it. Raises `RigError`."""
    return _rig(toml_source.parse(text, source), source)


def with_overrides(rig: Rig, overrides: Sequence[str]) -> Rig:
    """Return the rig with `table.key=value` settings applied. Raises `RigError`."""
    tables = toml_source.override(toml_source.parse(rig.toml, rig.name), overrides)
    return _rig(tables, f"{rig.name} with --set {' --set '.join(overrides)}")


def with_ports(rig: Rig, ports: Sequence[int]) -> Rig:
    """Return the rig with the TCP ports of daq, control, twin and operator, in that order."""
    names = ("daq", "control", "twin", "operator")
    return with_overrides(rig, [f"link.{name}={port}" for name, port in zip(names, ports, strict=True)])


def _rig(tables: Mapping[str, Any], source: str) -> Rig:
    """Validate all tables; messages begin with the source."""
    try:
        return _validated(tables)
    except RigError as error:
        raise RigError(f"{source}: {error}") from error


def _validated(tables: Mapping[str, Any]) -> Rig:
    """Turn the tables into a rig."""
    for name in tables:
        if name not in TABLES:
            raise RigError(f"[{name}] is not a table of a rig{nearest(name, TABLES, 'its tables are')}")
    emulator = dict(_table(tables, "emulator", {}))
    faults = _rows(emulator, "fault", Fault, "emulator.fault")
    emulator.pop("fault", None)
    model = _model(tables, tables) if any(name in tables for name in MODEL_TABLES) else None
    actual = _actual_model(tables, model, emulator.pop("actual", {}))
    channels = _channels(tables)
    rig = Rig(
        **tuple_at(Head, _table(tables, "rig"), "[rig]")._asdict(),
        model=model,
        solenoids=_solenoids(tables),
        channels=channels,
        acquisition=tuple_at(AcquisitionSettings, _table(tables, "acquisition"), "[acquisition]"),
        device=_table(tables, "device", {}),
        command=tuple_at(CommandSettings, _table(tables, "command"), "[command]"),
        safe_state=tuple_at(SafeStateSettings, _table(tables, "safe_state"), "[safe_state]"),
        limits=limits_of(_table(tables, "limits"), channels),
        capture=tuple_at(CaptureSettings, _table(tables, "capture", {}), "[capture]"),
        encoder=tuple_at(EncoderSettings, tables["encoder"], "[encoder]") if "encoder" in tables else None,
        twin=tuple_at(TwinSettings, _table(tables, "twin"), "[twin]"),
        link=tuple_at(LinkSettings, _table(tables, "link", {}), "[link]"),
        emulator=tuple_at(EmulatorSettings, emulator, "[emulator]"),
        actual=actual,
        faults=tuple(faults),
        toml=toml_source.dump(tables),
    )
    for check in (
        _check_acquisition,
        _check_command,
        _check_link,
        _check_encoder,
        _check_model,
        _check_faults,
    ):
        check(rig)
    return rig


def _table(
    tables: Mapping[str, Any], name: str, default: Mapping[str, Any] | None = None
) -> Mapping[str, Any]:
    """Return a table. Raises `RigError` when it is missing without a default, or no table."""
    table = tables.get(name, default)
    if table is None:
        raise RigError(f"table [{name}] is missing")
    if not isinstance(table, Mapping):
        raise RigError(f"[{name}] must be a table, not {table!r}")
    return table


def _rows(tables: Mapping[str, Any], name: str, kind: type, title: str = "") -> list[Any]:
    """Validate the rows `[[name]]`; messages name a row by its name, or else by its number."""
    rows, title = tables.get(name, []), title or name
    if not isinstance(rows, list) or not all(isinstance(row, Mapping) for row in rows):
        raise RigError(f"{title} must be rows [[{title}]], not {rows!r}")
    return [
        tuple_at(kind, row, f"[[{title}]] {row.get('name', number)}") for number, row in enumerate(rows, 1)
    ]


def _model(tables: Mapping[str, Any], model_tables: Mapping[str, Any], parent: str = "") -> Model:
    """Read the model from its tables, with the masses that are added to its rotor."""
    model = model_from_mapping(model_tables, parent)
    check_model(model, parent)
    masses: list[UnbalanceMass] = _rows(tables, "unbalance_mass", UnbalanceMass)
    return model._replace(rotor=with_masses(model.rotor, masses))


def _channels(tables: Mapping[str, Any]) -> ChannelTable:
    """Read the channel table."""
    channels: list[Channel] = _rows(tables, "channel", Channel)
    if not channels:
        raise RigError("there is no [[channel]]; a rig has one row for each channel")
    return checked_table(channels)


def _solenoids(tables: Mapping[str, Any]) -> tuple[Solenoid, ...]:
    """Read the solenoids."""
    solenoids: list[Solenoid] = _rows(tables, "solenoid", Solenoid)
    names = [solenoid.name for solenoid in solenoids]
    for name in names:
        if names.count(name) > 1:
            raise RigError(f"[[solenoid]] {name} stands there twice; each name must be unique")
    return tuple(solenoids)


def _actual_model(tables: Mapping[str, Any], model: Model | None, actual: Any) -> Model | None:
    """Return the emulated rig's model, or None when it does not differ."""
    if not isinstance(actual, Mapping):
        raise RigError(f"[emulator.actual] must be a table, not {actual!r}")
    for name in actual:
        if name not in MODEL_TABLES:
            known = nearest(name, MODEL_TABLES, "its tables are")
            raise RigError(f"[emulator.actual.{name}] is not a table of the model{known}")
    if not actual:
        return None
    if model is None:
        raise RigError(f"[emulator.actual] needs the tables {', '.join(MODEL_TABLES)}, from which it differs")
    told = {name: tables[name] for name in MODEL_TABLES}
    found = _model(tables, toml_source.merge(told, actual), "emulator.actual")
    return None if found == model else found


def _check_acquisition(rig: Rig) -> None:
    """Blocks are made of whole reads."""
    acquisition = rig.acquisition
    if acquisition.block % acquisition.read:
        raise RigError(
            f"[acquisition] block = {acquisition.block} must be a multiple of read = {acquisition.read}"
        )
    if acquisition.read > 1 and acquisition.read > 0.01 * acquisition.rate:
        raise RigError(
            f"[acquisition] read = {acquisition.read} lasts {acquisition.read / acquisition.rate:g} s; "
            "protection acts once a read, so it may last 0.01 s: "
            f"{max(1, int(0.01 * acquisition.rate))} samples"
        )


def _check_command(rig: Rig) -> None:
    """The default ramp may be commanded."""
    command = rig.command
    if command.default_ramp_hz_per_s > command.max_ramp_hz_per_s:
        raise RigError(
            f"[command] default_ramp_hz_per_s = {command.default_ramp_hz_per_s:g} is above "
            f"max_ramp_hz_per_s = {command.max_ramp_hz_per_s:g}"
        )


def _check_link(rig: Rig) -> None:
    """The processes listen on loopback, each on a port of its own."""
    link = rig.link
    try:
        loopback = IPv4Address(link.host).is_loopback
    except AddressValueError:
        loopback = False
    if not loopback:
        raise RigError(
            f'[link] host = "{link.host}" is not a loopback address; a network needs TLS, '
            "which a rig without certificates does not have: write 127.0.0.1"
        )
    ports = {name: port for name, port in link._asdict().items() if name != "host" and port}
    for name, port in ports.items():
        shared = [other for other, taken in ports.items() if taken == port and other != name]
        if shared:
            raise RigError(f"[link] {name} = {port} is also the port of {shared[0]}; each needs its own")


def _check_encoder(rig: Rig) -> None:
    """Counts a turn and the angle channel's sensitivity are the same fact."""
    if rig.encoder is None or "encoder_angle" not in rig.channels or not rig.emulated:
        return
    needed = rig.encoder.counts_per_turn / tau
    given = abs(rig.channels["encoder_angle"].sensitivity)
    if not isclose(given, needed, rel_tol=1e-9):
        raise RigError(
            f"[[channel]] encoder_angle sensitivity = {given!r} must be {needed!r} counts/rad, "
            f"which is [encoder] counts_per_turn = {rig.encoder.counts_per_turn} divided by 2 pi"
        )


def _check_model(rig: Rig) -> None:
    """The twin and the emulator have the model and the channels that they need."""
    wanted = [f"[twin] model = {rig.twin.model!r}"] if rig.twin.model != "none" else []
    wanted += [f"[acquisition] backend = {rig.acquisition.backend!r}"] if rig.emulated else []
    if wanted and rig.model is None:
        raise RigError(f"{wanted[0]} needs the tables {', '.join(MODEL_TABLES)}")
    if rig.twin.model == "none":
        return
    for name in NEEDED_BY_TWIN:
        if name not in rig.channels:
            raise RigError(f'[twin] model = "{rig.twin.model}" needs a [[channel]] named {name}')
    for name in NEEDED_BY_TWIN[:2]:
        if rig.channels[name].station is None:
            raise RigError(f"[[channel]] {name} needs station and angle_deg for the twin")


def _check_faults(rig: Rig) -> None:
    """The faults are complete, their channels exist, and the emulated rig can have one after the other."""
    for fault in rig.faults:
        check_fault(fault)
        if fault.channel and fault.channel not in rig.channels:
            known = nearest(fault.channel, rig.channels.names, "there are")
            raise RigError(f"[[emulator.fault]] channel = {fault.channel} is no channel of the rig{known}")
    ours = [fault for fault in rig.faults if of_rig(fault)]
    if ours:
        spans = schedule(ours, rig.acquisition.rate)
        for sample in edges(spans):
            bearing = damaged_at(rig.emulated_model, spans, sample).backup_bearing
            try:
                check_bearing(bearing)
            except RigError as error:
                seconds = sample / rig.acquisition.rate
                raise RigError(f"[[emulator.fault]] from {seconds:g} s on: {error}") from error
