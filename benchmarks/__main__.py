"""Runs every benchmark, one after another, and writes docs/reference/figures.md: `python -m benchmarks`."""

import json
import os
import platform
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path

HERE = Path(__file__).parent
TARGET = HERE.parent / "docs" / "reference" / "figures.md"
SCRIPTS = (
    "link",
    "processes",
    "channels",
    "protection",
    "recording",
    "exports",
    "reading",
    "replay",
    "rerun",
    "display",
    "simulator",
    "twin",
    "advisor",
)
HEAD = """# Figures

Measured by `python -m benchmarks` on {date}: {cores} cores of {processor}, Python {python}, {system}.
Ratios carry over to other computers, absolute values do not. Each ratio is to a baseline of the same run,
which the [script](benchmarks.md) names.
"""


def rows(script: str) -> list[str]:
    """Run one script and return its figures as rows of a table."""
    command = [sys.executable, "-m", f"benchmarks.{script}", "--json"]
    output = subprocess.run(command, cwd=HERE.parent, check=True, stdout=subprocess.PIPE, text=True).stdout
    return [
        f"| {name} | {row['value']:.4g} | {row['unit']} | {row['baseline']:.4g} | {row['ratio']:.3g} |"
        for name, row in json.loads(output).items()
    ]


def processor() -> str:
    """Return the processor's name."""
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.machine()


def main() -> None:
    """Run all and write the page."""
    page = HEAD.format(
        date=f"{datetime.now(UTC):%Y-%m-%d}",
        cores=os.cpu_count(),
        processor=processor(),
        python=platform.python_version(),
        system=platform.system(),
    )
    for script in SCRIPTS:
        print(script, flush=True)
        table = [
            "| figure | value | unit | baseline | ratio |",
            "| --- | ---: | --- | ---: | ---: |",
            *rows(script),
        ]
        page += f"\n## benchmarks.{script}\n\n" + "\n".join(table) + "\n"
    TARGET.write_text(page, encoding="utf-8")
    print(f"written to {TARGET.relative_to(HERE.parent)}")


if __name__ == "__main__":
    main()
