"""What the keys of a description's table may hold, read from the annotations of a named tuple."""

import re
from enum import IntEnum
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from docs.generate.markdown import capital, listed, summary, symbols_as_code, table, wrapped
from simulator.validation import Quantity, keys_of, written

HEAD = ("key", "unit", "allowed", "default", "meaning")


def section(kind: type, title: str, meanings: dict[str, str]) -> str:
    """Return a named tuple's heading, its docstring's first paragraph and its keys."""
    text = summary(kind).removeprefix(f"Table {title}: ").removeprefix(f"{title}: ")
    return f"### {title}\n\n{wrapped(capital(text))}\n\n{key_table(kind, meanings)}"


def key_table(kind: type, meanings: dict[str, str]) -> str:
    """Return a row for each key.

    `meanings` adds to what an annotation says, and says it where there is none. Raises KeyError for a
    meaning of a key that does not exist, ValueError for a key without any meaning.
    """
    hints = keys_of(kind)
    for key in meanings:
        hints[key]
    return table(HEAD, [_row(kind, key, hint, meanings.get(key, "")) for key, hint in hints.items()])


def _row(kind: Any, key: str, hint: Any, more: str) -> list[str]:
    unit, allowed, meaning = _rule(hint)
    meaning = " ".join(part for part in (more, symbols_as_code(meaning)) if part)
    if not meaning:
        raise ValueError(f"{kind.__name__}.{key} needs a meaning in docs/generate")
    return [f"`{key}`", unit, allowed, _default(kind, key), meaning]


def _default(kind: Any, key: str) -> str:
    if key not in kind._field_defaults:
        return "–"
    value = kind._field_defaults[key]
    if value is None:
        return "none"
    if isinstance(value, IntEnum):
        return f"`{written(value)}`"
    if value == "":
        return "none"
    return f"`{str(value).lower() if isinstance(value, bool) else value}`"


def _rule(hint: Any) -> tuple[str, str, str]:
    """Return unit, allowed values and meaning as an annotation gives them."""
    bare = _without_none(hint)
    if get_origin(bare) is Annotated:
        kind, rule = get_args(bare)[:2]
        if not isinstance(rule, Quantity):
            return "", "text", rule.meaning
        return _unit(rule), _range(_without_none(kind), rule), rule.meaning
    if get_origin(bare) is Literal:
        return "", listed([str(choice) for choice in get_args(bare)]), ""
    if issubclass(bare, IntEnum):
        return "", listed([written(member) for member in bare]), ""
    return "", {str: "text", bool: "`true` or `false`"}.get(bare, bare.__name__), ""


def _unit(rule: Quantity) -> str:
    return "" if rule.unit == "1" else rule.unit


def _range(kind: Any, rule: Quantity) -> str:
    ends = f"{_number(rule.low)} to {_number(rule.high)}"
    if get_origin(kind) is tuple:
        return f"[lower, upper] in {ends}"
    return f"whole, {ends}" if kind is int else ends


def _number(value: float) -> str:
    return re.sub(r"e\+?(-?)0*", r"e\1", f"{value:g}")


def _without_none(hint: Any) -> Any:
    if get_origin(hint) in (Union, UnionType):
        return next(part for part in get_args(hint) if part is not NoneType)
    return hint
