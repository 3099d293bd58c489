"""The package installs with its rigs in all three ways: from the folder, in place, and as a wheel."""

import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
CHECK = """
import sys, rigs, rigtwin
from pathlib import Path
assert Path(rigs.__file__).is_relative_to(sys.argv[1]), rigs.__file__
rig = rigtwin.load_rig("thesis-pinned")
print(rig.name, rigtwin.load_plan("resonance", rig).name)
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """A built wheel."""
    folder = tmp_path_factory.mktemp("wheel")
    pip("wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", folder, source(folder))
    return next(folder.glob("*.whl"))


@pytest.mark.parametrize("way", ["folder", "in place", "wheel"])
def test_installed_package_brings_its_rigs(tmp_path, way, request):
    home = tmp_path / "environment"
    python = environment(home)
    clone = source(tmp_path)
    what = {
        "folder": [clone],
        "in place": ["--editable", clone],
        "wheel": [request.getfixturevalue("wheel")],
    }[way]
    pip("--python", python, "install", "--no-deps", "--no-build-isolation", *what)
    expected = clone if way == "in place" else home
    result = run(python, "-P", "-c", CHECK, expected, cwd=tmp_path)
    assert result.split() == ["thesis-pinned", "resonance"]
    assert "rigtwin 0." in run(home / "bin" / "rigtwin", "--version", cwd=tmp_path)


def environment(home):
    """A virtual environment that finds our dependencies in this one, behind its own packages."""
    venv.create(home)
    packages = next((home / "lib").glob("python*/site-packages"))
    (packages / "dependencies.pth").write_text(sysconfig.get_path("purelib"))
    return home / "bin" / "python"


def source(folder):
    """A copy of what git tracks, so that building leaves nothing in the checkout."""
    clone = folder / "clone"
    if not clone.exists():
        run("git", "clone", "--quiet", ROOT, clone, cwd=folder)
    return clone


def pip(*arguments):
    run(sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check", *arguments, cwd=ROOT)


def run(*command, cwd):
    result = subprocess.run(
        [str(word) for word in command], cwd=cwd, capture_output=True, text=True, timeout=300
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout
