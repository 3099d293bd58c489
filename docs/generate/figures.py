"""The benchmark scripts, read from their docstrings."""

import ast
from pathlib import Path

from docs.generate.markdown import table

FOLDER = Path(__file__).resolve().parents[2] / "benchmarks"


def scripts() -> str:
    """Return a row for each script that measures something."""
    rows = []
    for path in sorted(FOLDER.glob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        if any(isinstance(node, ast.FunctionDef) and node.name == "main" for node in tree.body):
            first = (ast.get_docstring(tree) or "").split("\n\n")[0]
            rows.append([f"`python -m benchmarks.{path.stem}`", " ".join(first.split())])
    return table(("script", "measures"), rows)
