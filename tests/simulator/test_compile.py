import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import simulator
from simulator import compile as compilation

PACKAGE = Path(simulator.__file__).parent


def test_digest_changes_with_any_source_of_the_simulator(tmp_path, monkeypatch):
    copy = tmp_path / "simulator"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(compilation, "HERE", copy)
    before = compilation.source_digest(copy)
    assert before == compilation.source_digest(copy)
    with (copy / "contact.py").open("a") as file:
        file.write("\n")
    assert compilation.source_digest(copy) != before


def test_digest_of_another_package_covers_its_kernels_and_the_simulator_s(tmp_path):
    (tmp_path / "kernels.py").write_text("from simulator.compile import kernel\n")
    (tmp_path / "other.py").write_text("")
    before = compilation.source_digest(tmp_path)
    (tmp_path / "other.py").write_text("# nothing compiled here\n")
    assert compilation.source_digest(tmp_path) == before
    (tmp_path / "kernels.py").write_text("from simulator.compile import kernel\n# edited\n")
    assert compilation.source_digest(tmp_path) != before


def test_cache_is_in_the_user_s_folder_and_none_where_nothing_can_be_written(tmp_path, monkeypatch):
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    compilation.cache_folder.cache_clear()
    folder = compilation.cache_folder(PACKAGE)
    assert folder is not None
    assert folder.is_relative_to(tmp_path / "cache" / "rigtwin" / "kernels")
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(compilation, "cache_bases", lambda: [tmp_path / "file"])
    compilation.cache_folder.cache_clear()
    assert compilation.cache_folder(PACKAGE) is None
    compilation.cache_folder.cache_clear()


@pytest.mark.skipif(sys.platform == "win32", reason="permissions work otherwise there")
def test_kernels_are_cached_outside_a_read_only_installation(tmp_path):
    copy = tmp_path / "site" / "simulator"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    copy.chmod(0o555)
    code = "import simulator.numeric as n; print(n.sine_cosine(0.0)); print(n.__file__)"
    environment = {**os.environ, "PYTHONPATH": str(copy.parent), "XDG_CACHE_HOME": str(tmp_path / "cache")}
    environment.pop("NUMBA_CACHE_DIR", None)
    done = subprocess.run(
        [sys.executable, "-P", "-c", code],
        env=environment,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=60,
    )
    copy.chmod(0o755)
    assert done.stdout.splitlines() == ["(0.0, 1.0)", str(copy / "numeric.py")], done.stderr
    assert list((tmp_path / "cache" / "rigtwin" / "kernels").rglob("*.nbc"))
    assert not list(copy.rglob("*.nbc"))
