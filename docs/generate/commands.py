"""The command line, read from its parser."""

import argparse
from collections.abc import Iterator

from docs.generate.markdown import capital, table, wrapped
from rigtwin.cli import build_parser


def reference() -> str:
    """Return a section for each command, and for each of its verbs."""
    return "\n\n".join(_sections(build_parser(), "", 2))


def _sections(parser: argparse.ArgumentParser, help_text: str, level: int) -> Iterator[str]:
    choices = _commands(parser)
    if level > 2:
        yield _section(parser, help_text, level)
    for action in choices:
        told = {pseudo.dest: pseudo.help or "" for pseudo in action._choices_actions}  # noqa: SLF001
        for name, inner in action.choices.items():
            yield from _sections(inner, told.get(name, ""), level + 1)


def _section(parser: argparse.ArgumentParser, help_text: str, level: int) -> str:
    said = capital(parser.description or help_text)
    parts = [f"{'#' * min(level, 4)} `{parser.prog}`", wrapped(said if said.endswith(".") else f"{said}.")]
    rows = [
        [f"`{_written(action)}`", action.help or ""]
        for action in parser._actions  # noqa: SLF001
        if not isinstance(action, argparse._HelpAction | argparse._SubParsersAction)  # noqa: SLF001
    ]
    if rows:
        parts.append(table(("argument", "meaning"), rows))
    return "\n\n".join(parts)


def _written(action: argparse.Action) -> str:
    """Return an argument as it is typed; an optional one in brackets."""
    value = f"{action.metavar or ''}" or (
        "{" + ",".join(map(str, action.choices)) + "}" if action.choices else action.dest.upper()
    )
    if not action.option_strings:
        return f"[{value} ...]" if action.nargs == "*" else value
    names = ", ".join(action.option_strings)
    written = names if action.nargs == 0 else f"{names} {value}"
    return written if action.required else f"[{written}]"


def _commands(parser: argparse.ArgumentParser) -> list[argparse._SubParsersAction]:
    return [
        action
        for action in parser._actions  # noqa: SLF001
        if isinstance(action, argparse._SubParsersAction)  # noqa: SLF001
    ]
