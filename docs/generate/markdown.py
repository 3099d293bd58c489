"""Tables and paragraphs as Markdown."""

import inspect
import re
import textwrap
from collections.abc import Iterable, Sequence

WIDTH = 120


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table; a bar within a cell is escaped."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def wrapped(text: str) -> str:
    """Return a paragraph in lines of the house's width."""
    return textwrap.fill(" ".join(text.split()), WIDTH, break_long_words=False, break_on_hyphens=False)


def summary(thing: object) -> str:
    """Return the first paragraph of a docstring."""
    return " ".join((inspect.getdoc(thing) or "").split("\n\n")[0].split())


def capital(text: str) -> str:
    """Return a text with its first letter in upper case."""
    return text[:1].upper() + text[1:]


def listed(words: Sequence[str]) -> str:
    """Return words as code, joined by commas and a last `or`."""
    coded = [f"`{word}`" for word in words]
    return coded[0] if len(coded) == 1 else f"{', '.join(coded[:-1])} or {coded[-1]}"


def symbols_as_code(text: str) -> str:
    """Write the symbols that stand in brackets, as in [k_ft], as code."""
    return re.sub(r"\[([^\]]+)\]", r"(`\1`)", text)
