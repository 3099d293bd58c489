"""Fixtures that every test gets."""

import os

import pytest
from hypothesis import settings

settings.register_profile("busy", deadline=None)  # how long an example takes says nothing on a busy computer
settings.load_profile("busy")


@pytest.fixture(autouse=True)
def runtime_folder(tmp_path, monkeypatch):
    """Give each test a run-time folder of its own, so that it never meets a running rig."""
    folder = tmp_path / "runtime"
    monkeypatch.setenv("RIGTWIN_RUNTIME_DIR", str(folder))
    return folder


def pytest_collection_modifyitems(config, items):
    """Leave slow tests out unless a marker expression asks for them."""
    if config.option.markexpr:
        return
    skip = pytest.mark.skip(reason="slow; run with -m slow")
    for item in items:
        if "slow" in item.keywords:
            item.add_marker(skip)


def require(found: bool, what: str) -> None:
    """Skip a test whose tool is missing on a user's machine; fail where everything is required."""
    if found:
        return
    if os.environ.get("RIGTWIN_REQUIRE_ALL") == "1":
        pytest.fail(f"{what} is missing")
    pytest.skip(f"needs {what}")
