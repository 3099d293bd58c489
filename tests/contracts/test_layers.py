"""The house's walls: layers, one-file doors, and packages that no contract may forget."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


def test_every_package_is_in_the_layer_contract():
    packages = {name.split(".")[0] for name in PROJECT["tool"]["setuptools"]["packages"]} - {"rigs"}
    contract = PROJECT["tool"]["importlinter"]["contracts"][0]
    layered = {name.strip() for row in contract["layers"] for name in row.split("|")}
    assert packages == layered
    assert packages == set(PROJECT["tool"]["importlinter"]["root_packages"])


def test_every_package_on_disk_is_installed():
    found = {
        ".".join(path.parent.relative_to(ROOT).parts)
        for name in {package.split(".")[0] for package in PROJECT["tool"]["setuptools"]["packages"]}
        for path in (ROOT / name).rglob("__init__.py")
    }
    assert found <= set(PROJECT["tool"]["setuptools"]["packages"])


@pytest.mark.parametrize(
    "command",
    [
        ["-m", "ruff", "check", "."],
        ["-m", "ruff", "format", "--check", "."],
        ["-m", "mypy"],
        ["-c", "from importlinter.cli import lint_imports_command; lint_imports_command()"],
    ],
    ids=["ruff", "format", "mypy", "imports"],
)
def test_linters_are_content(command):
    result = subprocess.run([sys.executable, *command], cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert result.returncode == 0, result.stdout + result.stderr


@pytest.mark.parametrize("room", ["rerun", "numba", "zenoh", "scipy", "numpy", "mcap", "google.protobuf"])
def test_help_imports_nothing_heavy(room):
    code = f"import sys, rigtwin.cli; rigtwin.cli.build_parser(); sys.exit({room!r} in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT).returncode == 0


def test_acquisition_imports_no_compiler():
    code = "import sys, daq.service, daq.commanding.operator; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT).returncode == 0
