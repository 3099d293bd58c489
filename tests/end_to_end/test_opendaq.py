"""openDAQ's reference device through the whole chain: acquired, recorded, and watched in a browser."""

import re
from importlib.util import find_spec

import pytest

from tests.conftest import require
from tests.end_to_end.rig_process import PATIENT, Running, info, wait_until
from tests.end_to_end.test_live import samples_shown
from tests.twin.display_process import CHROMIUM, CHROMIUM_FLAGS, pixels_of
from twin.display_look import MEASURED

SECONDS = 60
RATE = 25_000


@pytest.mark.slow
@pytest.mark.needs_browser
def test_a_minute_of_the_reference_device_is_recorded_and_watched_without_a_gap(tmp_path):
    require(find_spec("opendaq") is not None, "opendaq")
    require(CHROMIUM.exists(), "Debian's chromium")
    from playwright.sync_api import sync_playwright

    path, errors = tmp_path / "run.mcap", []
    options = ("--rig", "opendaq-reference", "--view", "web", "--record", path)
    with Running("live", *PATIENT, *options, cwd=tmp_path) as run, sync_playwright() as playwright:
        run.wait_for("watch it at http://127.0.0.1:")
        browser = playwright.chromium.launch(executable_path=str(CHROMIUM), args=list(CHROMIUM_FLAGS))
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(re.search(r"watch it at (\S+)", run.said())[1])
        wait_until(lambda: pixels_of(page.screenshot(), MEASURED) > 300, "the measurement in the browser")
        enough = samples_shown(run) + SECONDS * RATE
        run.wait_until(lambda: samples_shown(run) > enough, "a minute of the run", 5 * SECONDS)
        browser.close()
        assert run.interrupt() == 0, run.said()
    assert errors == []
    assert "twin" not in run.find_children()  # there is no model of these sines
    found = info(path)
    assert found["certificate"]["verdict"] == "valid"
    assert found["gaps"] == []
    assert found["samples"] > SECONDS * RATE
