"""The tests of what keeps the rig safe would notice almost any mistake in it: mutmut makes each in turn."""

import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.conftest import require

ROOT = Path(__file__).parents[2]
NEEDED = ("analysis", "daq", "rigs", "simulator", "tests", "pyproject.toml")
KILLED, SURVIVED = "🎉", "🙁"
LEAST = 0.95


@pytest.mark.slow
def test_almost_every_mutant_of_protection_and_envelope_is_killed(tmp_path):
    require(bool(find_spec("mutmut")), "mutmut")
    for name in NEEDED:
        source = ROOT / name
        (shutil.copytree if source.is_dir() else shutil.copy)(source, tmp_path / name)
    done = subprocess.run(
        [sys.executable, "-m", "mutmut", "run", "--max-children", "1"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=3600,
        check=False,
    )
    said = done.stdout.replace("\r", "\n")
    counts = re.findall(r"(\d+)/(\d+).*?" + KILLED + r" (\d+).*" + SURVIVED + r" (\d+)", said)
    assert counts, said[-2000:] + done.stderr[-2000:]
    made, of, killed, survived = map(int, counts[-1])
    assert made == of
    assert made > 500
    assert killed / of >= LEAST, f"{survived} of {of} mutants survived: see `mutmut results`"
