"""Keys and messages."""

import ast
import re
from pathlib import Path

import daq.messages
import twin.estimate
import twin.outputs
from daq.backends.emulator import Emulator
from daq.keys import TOPICS, Delivery
from docs.generate.markdown import table, wrapped

PROTO = Path(daq.messages.__file__).with_name("messages.proto")
DECLARATION = re.compile(r"((?://[^\n]*\n)*)(message|enum) (\w+) \{(?: *// ([^\n]+))?\n(.*?)\n\}", re.DOTALL)
FIELD = re.compile(r"^  (?:((?:repeated )?[\w<>, ]+) )?(\w+) = (\d+); *(?:// *(.*))?$")
COMMON = {
    "timestamp": "s since 1970 UTC",
    "run": "run id",
    "sample": "index that it refers to",
    "first_sample": "index of the first sample",
    "n_samples": "samples that it covers",
    "rate": "Hz, of the sample index",
    "status": "bit flags",
    "channels": "equally long, in the channel table's order",
    "samples": "in that unit",
}
"""What fields mean that most messages have, where `messages.proto` does not say it again."""


def topics() -> str:
    """Return the service table."""
    rows = [
        [
            f"`{row.pattern.replace('rig/*/', 'rig/<rig>/', 1)}`",
            f"`{row.message}`" if row.message else "the lease, as text",
            row.delivery.value + (f", {row.cache} kept" if row.delivery is Delivery.LOSSLESS else ""),
            "yes" if row.recorded else "no",
        ]
        for row in TOPICS
    ]
    return table(("key", "message", "delivery", "recorded"), rows)


def messages() -> str:
    """Return every message with its fields, as `messages.proto` tells them."""
    text = PROTO.read_text(encoding="utf-8")
    return "\n\n".join(_declaration(*found) for found in DECLARATION.findall(text))


def block_flags() -> str:
    """Return the flags of a block's status."""
    return flags(daq.messages.__file__, "BlockStatus")


def estimate_flags() -> str:
    """Return the flags that an estimate has beside them."""
    return flags(twin.estimate.__file__, "EstimateStatus")


def flags(source: str, name: str) -> str:
    """Return the members of an enumeration in a source file, with the texts that stand below them."""
    tree = ast.parse(Path(source).read_text(encoding="utf-8"))
    body = next(node.body for node in tree.body if isinstance(node, ast.ClassDef) and node.name == name)
    rows = []
    for member, text in zip(body[1::2], body[2::2], strict=True):
        assert isinstance(member, ast.Assign)
        assert isinstance(text, ast.Expr)
        assert isinstance(member.targets[0], ast.Name)
        said = " ".join(str(ast.literal_eval(text.value)).split())
        rows.append([str(ast.literal_eval(member.value)), f"`{member.targets[0].id}`", said])
    return table(("value", "flag", "means"), rows)


def estimate_channels() -> str:
    """Return the channels of an estimate, without pins and residuals."""
    bands = {name: f"`{name}_sigma`" for name in twin.outputs.BANDS}
    rows = [[f"`{name}`", unit, bands.get(name, "")] for name, unit in twin.outputs.OUTPUTS.items()]
    return table(("channel", "unit", "standard deviation"), rows)


def truth_channels() -> str:
    """Return the channels of the emulated rig's truth."""
    rows = [
        [f"`{name}`", unit] for name, unit in zip(Emulator.truth_names, Emulator.truth_units, strict=True)
    ]
    return table(("channel", "unit"), rows)


def _declaration(comment: str, kind: str, name: str, key: str, body: str) -> str:
    """Return one message or enumeration."""
    said = wrapped(comment.replace("//", " "))
    where = f"On `{key}`." if "/" in key else ""
    intro = "\n\n".join(part for part in (said, where) if part)
    fields = [found.groups("") for line in body.splitlines() if (found := FIELD.match(line))]
    if kind == "enum":
        rows = [[number, f"`{field}`"] for _type, field, number, _comment in fields]
        shown = table(("value", "name"), rows)
    else:
        rows = [
            [number, f"`{field}`", f"`{kind_of}`", comment or COMMON.get(field, "")]
            for kind_of, field, number, comment in fields
        ]
        shown = table(("no.", "field", "type", "meaning"), rows)
    return "\n\n".join(part for part in (f"### {name}", intro, shown) if part)
