"""The public Python API, read from its docstrings."""

import inspect
import re
import textwrap
from collections.abc import Iterator
from typing import Any

import rigtwin
from docs.generate.markdown import summary, table, wrapped

MODULES = re.compile(r"\b(?:\w+\.)+(?=\w)")


def reference() -> str:
    """Return a section for each name that `import rigtwin` offers."""
    return "\n\n".join(
        _section(name, getattr(rigtwin, name)) for name in sorted(rigtwin.__all__, key=str.lower)
    )


def _section(name: str, thing: Any) -> str:
    if inspect.isfunction(thing):
        text = inspect.getdoc(thing) or ""
        first, _, rest = text.partition("\n\n")
        more = f"\n\n```text\n{textwrap.dedent(rest).strip()}\n```" if rest else ""
        return f"### `{name}{_parameters(thing)}`\n\n{wrapped(first)}{more}"
    if issubclass(thing, Exception):
        bases = " and ".join(f"`{base.__name__}`" for base in thing.__bases__)
        return f"### `{name}`\n\nAn exception, a {bases}. {summary(thing)}"
    return "\n\n".join([f"### `{name}`", wrapped(summary(thing)), table(("member", "is"), _members(thing))])


def _members(thing: type) -> Iterator[list[str]]:
    """Yield fields with their types, then methods and properties with what they are."""
    for name, field in getattr(thing, "__dataclass_fields__", {}).items():
        kind = field.type if isinstance(field.type, str) else _type_name(field.type)
        yield [f"`{name}`", f"field, `{kind}`"]
    for name, member in vars(thing).items():
        if name.startswith("_") or name in getattr(thing, "__dataclass_fields__", {}):
            continue
        if inspect.isfunction(member):
            yield [f"`{name}{_parameters(member)}`", summary(member)]
        elif isinstance(member, property) or hasattr(member, "func"):
            yield [f"`{name}`", summary(member)]


def _parameters(function: Any) -> str:
    """Return a function's parameters with their defaults, without types."""
    signature = inspect.signature(function)
    bare = [
        parameter.replace(annotation=inspect.Parameter.empty, default=_plain(parameter.default))
        for name, parameter in signature.parameters.items()
        if name != "self"
    ]
    shown = str(signature.replace(parameters=bare, return_annotation=inspect.Signature.empty))
    return shown.replace("Ellipsis", "...")


def _type_name(kind: Any) -> str:
    """Return a type without the modules that it comes from."""
    return kind.__name__ if isinstance(kind, type) and "[" not in str(kind) else MODULES.sub("", str(kind))


def _plain(default: Any) -> Any:
    """Return a default as it is shown: a function is left out."""
    return ... if inspect.isfunction(default) else default
