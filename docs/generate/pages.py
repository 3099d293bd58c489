"""Pages of the reference: what stands between two markers is made of the code, the rest by hand."""

import re
from collections.abc import Callable
from pathlib import Path

from docs.generate import commands, figures, plans, python, rigs, wire

FOLDER = Path(__file__).resolve().parents[1] / "reference"
PART = re.compile(r"(<!-- generated: ([a-z-]+) -->\n).*?(<!-- end -->)", re.DOTALL)

PARTS: dict[str, Callable[[], str]] = {
    "rig-tables": rigs.tables,
    "quantities": rigs.quantities,
    "shipped-rigs": rigs.shipped,
    "plan-tables": plans.tables,
    "shipped-plans": plans.shipped,
    "topics": wire.topics,
    "messages": wire.messages,
    "block-flags": wire.block_flags,
    "estimate-flags": wire.estimate_flags,
    "estimate-channels": wire.estimate_channels,
    "truth-channels": wire.truth_channels,
    "commands": commands.reference,
    "api": python.reference,
    "benchmarks": figures.scripts,
}


def refreshed(text: str) -> str:
    """Return a page with its generated parts as the code has them now."""
    return PART.sub(lambda found: f"{found[1]}\n{PARTS[found[2]]().strip()}\n\n{found[3]}", text)


def part_names(text: str) -> list[str]:
    """Return the names of a page's generated parts."""
    return [found[2] for found in PART.finditer(text)]
