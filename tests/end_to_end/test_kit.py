"""The pytest plugin, as another project gets it by installing rigtwin."""

import os
import shutil
import subprocess
import sys

from tests.contracts.test_docs import ROOT, install


def test_the_example_project_passes_with_the_installed_plugin(tmp_path):
    shutil.copytree(ROOT / "examples" / "limit-study", tmp_path / "project")
    packages = tmp_path / "packages"
    packages.mkdir()
    shutil.copy(ROOT / "pyproject.toml", packages)
    install(packages)
    result = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-n", "2", "-W", "error", "-p", "no:cacheprovider"],
        cwd=tmp_path / "project",
        env=os.environ | {"PYTHONPATH": f"{packages}{os.pathsep}{ROOT}", "PYTEST_ADDOPTS": ""},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    assert "8 passed" in result.stdout


def test_a_test_run_that_does_not_use_it_loads_nothing_heavy():
    code = (
        "import sys, rigtwin.pytest_plugin\n"
        "print(*sorted({'numpy', 'numba', 'zenoh', 'google.protobuf'} & set(sys.modules)))"
    )
    result = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert (result.returncode, result.stdout, result.stderr) == (0, "\n", "")
