"""Finds and reads TOML descriptions: shipped ones by name, others by path; bases and overrides.

A description may stand on another one: `base = "thesis-ball"` in its first table. Then the tables of
the base are taken and overridden key by key; the rows of an array of tables are matched by `name`.
"""

import tomllib
from collections.abc import Mapping, Sequence
from copy import deepcopy
from difflib import get_close_matches
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal

import tomli_w

from simulator.validation import RigError, nearest

Tables = dict[str, Any]
What = Literal["rig", "plan"]


def shipped(what: What) -> dict[str, Path]:
    """Return the rigs or the plans that come with the product: name to path."""
    folder = Path(str(files("rigs"))) / ("plans" if what == "plan" else "")
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def dump(tables: Mapping[str, Any]) -> str:
    """Return tables as TOML text."""
    return tomli_w.dumps(tables)


def find(name_or_path: str | Path, what: What) -> Path:
    """Return the file of a shipped name or of a path. Raises `RigError`."""
    known = shipped(what)
    if str(name_or_path) in known:
        return known[str(name_or_path)]
    path = Path(name_or_path).expanduser()
    if path.is_dir():
        raise RigError(f"{path} is a folder; give the TOML file of a {what}, or one of {', '.join(known)}")
    if path.is_file():
        return path
    if path.suffix == ".toml" or len(path.parts) > 1:
        raise RigError(f"{path} does not exist; the shipped {what}s are {', '.join(known)}")
    close = get_close_matches(str(name_or_path), known, n=1)
    meant = f"; did you mean {close[0]}?" if close else ";"
    listed = f"{meant} the shipped {what}s are {', '.join(known)}"
    raise RigError(f'no {what} is named "{name_or_path}"{listed}; or give the path of a TOML file')


def parse(text: str, source: str) -> Tables:
    """Read TOML text. Raises `RigError` with the line of a mistake."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise RigError(f"{source}: not TOML: {error}") from error


def read(path: Path) -> str:
    """Return a file's text. Raises `RigError`."""
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise RigError(f"{path} is not UTF-8 text, so it is not a TOML file") from error
    except OSError as error:
        raise RigError(f"{path} cannot be read: {error.strerror}") from error


def read_with_bases(path: Path, what: What) -> Tables:
    """Read a file and the chain of bases that its table `[rig]` or `[plan]` names. Raises `RigError`."""
    chain: list[Tables] = []
    visited: list[Path] = []
    current: Path | None = path
    while current:
        if current.resolve() in visited:
            raise RigError(f"{path}: [{what}] base: {current.name} stands on itself")
        visited.append(current.resolve())
        tables = parse(read(current), str(current))
        current = _base_of(tables, current, what)
        chain.append(tables)
    merged: Tables = {}
    for tables in reversed(chain):
        merged = merge(merged, tables)
    return merged


def _base_of(tables: Tables, path: Path, what: What) -> Path | None:
    """Take the key `base` out of the head table and return the file it names."""
    table = tables.get(what)
    base = table.pop("base", None) if isinstance(table, dict) else None
    if base is None:
        return None
    if not isinstance(base, str):
        raise RigError(f"{path}: [{what}] base = {base!r} must be the name or path of a {what}")
    try:
        return find(base if base in shipped(what) else path.parent / base, what)
    except RigError as error:
        raise RigError(f"{path}: [{what}] base: {error}") from error


def merge(base: Tables, over: Mapping[str, Any]) -> Tables:
    """Return `base` overridden by `over`: tables key by key, arrays of tables row by row by name."""
    merged = deepcopy(base)
    for key, value in over.items():
        old = merged.get(key)
        if isinstance(old, dict) and isinstance(value, Mapping):
            merged[key] = merge(old, value)
        elif isinstance(old, list) and _is_rows(old) and _is_rows(value):
            merged[key] = _merge_rows(old, value)
        else:
            merged[key] = deepcopy(value)
    return merged


def _is_rows(value: Any) -> bool:
    """Tell whether a value is an array of tables that have names."""
    return (
        isinstance(value, list)
        and bool(value)
        and all(isinstance(row, dict) and "name" in row for row in value)
    )


def _merge_rows(base: list[Tables], over: list[Tables]) -> list[Tables]:
    """Override the base's rows of the same name and append the others."""
    names = {row["name"] for row in base}
    changed = {row["name"]: row for row in over if row["name"] in names}
    rows = [merge(row, changed.get(row["name"], {})) for row in base]
    return rows + [deepcopy(row) for row in over if row["name"] not in names]


def override(tables: Tables, settings: Sequence[str]) -> Tables:
    """Return the tables with `table.key=value` settings applied.

    A row is reached by its name, as in `channel.proximity_x.sensitivity=2400`. The value is TOML; what is
    no TOML is taken as text. Keys are judged later, with the whole description. Raises `RigError`.
    """
    changed = deepcopy(tables)
    for setting in settings:
        path, equals, value = setting.partition("=")
        keys = [key.strip() for key in path.split(".")]
        if not equals or len(keys) < 2 or not all(keys):
            raise RigError(f"--set {setting}: write it as table.key=value, as rotor.unbalance=9e-5")
        _put(changed, keys, _value(value.strip()), setting)
    return changed


def _put(tables: Tables, keys: list[str], value: Any, setting: str) -> None:
    """Set one value, going down through tables and named rows."""
    here: Any = tables
    for depth, key in enumerate(keys[:-1]):
        here = _row(here, key, keys, setting) if isinstance(here, list) else here.setdefault(key, {})
        if not isinstance(here, dict | list):
            raise RigError(f"--set {setting}: {'.'.join(keys[: depth + 1])} is a value, not a table")
    if isinstance(here, list):
        raise RigError(f"--set {setting}: name the key of [[{'.'.join(keys[:-1])}]] {keys[-1]} to be set")
    here[keys[-1]] = value


def _row(rows: list[Any], name: str, keys: list[str], setting: str) -> Any:
    """Return the row of that name."""
    named = {row["name"]: row for row in rows if isinstance(row, dict) and "name" in row}
    if name not in named:
        raise RigError(f"--set {setting}: no {keys[0]} is named {name}{nearest(name, named, 'there are')}")
    return named[name]


def _value(text: str) -> Any:
    """Read one TOML value, or take the text as it is."""
    try:
        read = tomllib.loads(f"value = {text}")
    except tomllib.TOMLDecodeError:
        return text
    return read["value"] if len(read) == 1 else text
