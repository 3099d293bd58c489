"""Named tuples made from plain mappings, each value checked against its field's annotation.

A field's annotation says what it may hold:

- `Annotated[float, Quantity(...)]`, or `int`: a number in a closed range, with unit and meaning;
- `Annotated[tuple[float, float], Quantity(...)]`: the lower and the upper end of a range;
- `Annotated[str, Pattern(...)]`: a text of a given form; `str`: any text that is not empty;
- `Annotated[..., Derived(...)]`: nothing, since it is computed from the others;
- `bool`, `datetime.date`, `Literal["a", "b"]`, or an `IntEnum`, which is written as its lower-case name
  with hyphens.

A field with a default may be left out; `| None` is for fields that have no value then.
"""

import re
from collections.abc import Iterable, Mapping
from datetime import date
from difflib import get_close_matches
from enum import IntEnum
from math import isfinite
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin, get_type_hints


class RigError(ValueError):
    """A rig description that cannot be: the message names table, key, value and what is allowed."""


class Quantity(NamedTuple):
    """Unit, allowed closed range and meaning of one number of a rig description."""

    unit: str
    low: float
    high: float
    meaning: str


class Pattern(NamedTuple):
    """Regular expression that a whole text must match, and what that means in words."""

    expression: str
    meaning: str


class Derived(NamedTuple):
    """Marks a field that is computed from others and stands in no file; it needs a default."""

    meaning: str


NAME = Annotated[str, Pattern(r"[A-Za-z][A-Za-z0-9_-]*", "a name: a letter, then letters, digits, _ and -")]


def tuple_from_mapping(kind: type, table: Mapping[str, Any], name: str) -> Any:
    """Validate the table `[name]` against the named tuple `kind` and return the tuple. Raises `RigError`."""
    return tuple_at(kind, table, f"[{name}]")


def tuple_at(kind: type, table: Mapping[str, Any], place: str) -> Any:
    """Do as `tuple_from_mapping`; `place` is how messages name the table. Raises `RigError`."""
    if not isinstance(table, Mapping):
        raise RigError(f"{place} must be a table, not {table!r}")
    hints = keys_of(kind)
    for key in table:
        if key not in hints:
            raise RigError(f"{place} {key} is not a key of this table{nearest(key, hints)}")
    for key, hint in hints.items():
        if key not in table and key not in kind._field_defaults:  # type: ignore[attr-defined]
            raise RigError(f"{place} lacks {describe(key, hint)}")
    return kind(**{key: value_of(hints[key], value, f"{place} {key}") for key, value in table.items()})


def keys_of(kind: type) -> dict[str, Any]:
    """Return the annotations of the fields that a rig description may hold."""
    hints = get_type_hints(kind, include_extras=True)
    return {
        key: hint
        for key, hint in hints.items()
        if not any(isinstance(part, Derived) for part in get_args(hint))
    }


def value_of(hint: Any, value: Any, place: str) -> Any:
    """Check one value against its annotation and return it in the annotated type. Raises `RigError`."""
    if get_origin(hint) is Annotated:
        bare, rule = get_args(hint)[:2]
        return _ruled(_without_none(bare), rule, value, place)
    bare = _without_none(hint)
    if get_origin(bare) is Literal:
        return _one_of(value, get_args(bare), place)
    if issubclass(bare, IntEnum):
        return choice(value, bare, place)
    if type(value) is not bare or value == "":
        raise RigError(f"{place} = {_shown(value)} must be {_KINDS[bare]}")
    return value


_KINDS = {
    str: "a non-empty text",
    bool: "true or false",
    date: "a date without quotes, as 2026-01-31",
}


def _without_none(hint: Any) -> Any:
    """Return the type besides None of an optional one."""
    if get_origin(hint) in (Union, UnionType):
        return next(part for part in get_args(hint) if part is not NoneType)
    return hint


def _ruled(bare: Any, rule: Quantity | Pattern, value: Any, place: str) -> Any:
    """Check a value that has a range or a pattern."""
    if isinstance(rule, Pattern):
        if not isinstance(value, str) or not re.fullmatch(rule.expression, value):
            raise RigError(f"{place} = {_shown(value)} must be {rule.meaning}")
        return value
    if bare is int:
        return whole_number(value, rule, place)
    if get_origin(bare) is tuple:
        return interval(value, rule, place)
    return number(value, rule, place)


def number(value: Any, quantity: Quantity, place: str) -> float:
    """Return `value` as a float within the quantity's range. Raises `RigError`."""
    unit = _unit_of(quantity)
    if isinstance(value, bool) or not isinstance(value, int | float):
        wanted = f"a number in{unit}" if unit else "a number"
        raise RigError(f"{place} = {_shown(value)} must be {wanted}: {quantity.meaning}")
    if not (isfinite(value) and quantity.low <= value <= quantity.high):
        allowed = f"{quantity.low:g} to {quantity.high:g}{unit}"
        raise RigError(
            f"{place} = {value:g} is outside {allowed}: {quantity.meaning}; check its unit and sign"
        )
    return float(value)


def whole_number(value: Any, quantity: Quantity, place: str) -> int:
    """Return `value` as an int within the quantity's range. Raises `RigError`."""
    if isinstance(value, float):
        raise RigError(f"{place} = {value!r} must be a whole number: {quantity.meaning}")
    return int(number(value, quantity, place))


def interval(value: Any, quantity: Quantity, place: str) -> tuple[float, float]:
    """Return `value` as its lower and upper end, both within the quantity's range. Raises `RigError`."""
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise RigError(
            f"{place} = {_shown(value)} must be [lower, upper] in{_unit_of(quantity)}: {quantity.meaning}"
        )
    low, high = (number(end, quantity, place) for end in value)
    if not low < high:
        raise RigError(f"{place} = [{low:g}, {high:g}] must have its lower end first: {quantity.meaning}")
    return low, high


def choice(value: Any, kind: type[IntEnum], place: str) -> int:
    """Return the enumeration's number for its written name. Raises `RigError`."""
    names = {written(member): int(member) for member in kind}
    return names[_one_of(value, names, place)]


def written(member: IntEnum) -> str:
    """Return how a choice is written in a rig description."""
    return member.name.lower().replace("_", "-")


def nearest(key: str, known: Iterable[str], title: str = "its keys are") -> str:
    """Suggest the right name for a misspelt one, or list the right names."""
    names = list(known)
    close = get_close_matches(str(key), names, n=1)
    if close:
        return f"; did you mean {close[0]}?"
    return f"; {title} {', '.join(names)}" if names else ""


def describe(key: str, hint: Any) -> str:
    """Name a key together with what it must hold."""
    if get_origin(hint) is Annotated:
        rule = get_args(hint)[1]
        unit = f" ({rule.unit})" if isinstance(rule, Quantity) and rule.unit != "1" else ""
        return f"{key}{unit}: {rule.meaning}"
    if get_origin(hint) is Literal:
        return f"{key}: one of {', '.join(map(str, get_args(hint)))}"
    if isinstance(hint, type) and issubclass(hint, IntEnum):
        return f"{key}: one of {', '.join(map(written, hint))}"
    return key


def _one_of(value: Any, allowed: Iterable[Any], place: str) -> Any:
    """Return `value` if it is among the allowed ones, of the same type."""
    options = list(allowed)
    if not any(type(value) is type(option) and value == option for option in options):
        raise RigError(f"{place} = {_shown(value)} must be one of {', '.join(map(str, options))}")
    return value


def _unit_of(quantity: Quantity) -> str:
    """Return the unit with a space before it, or nothing for a pure number."""
    return "" if quantity.unit == "1" else f" {quantity.unit}"


def _shown(value: Any) -> str:
    """Write a value as TOML does, so that the message shows what stands in the file."""
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else str(value)
