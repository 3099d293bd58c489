import os
import signal
import urllib.request
from pathlib import Path

import pytest

from daq import keys
from daq.link import free_ports
from daq.messages_pb2 import Status
from daq.recording import RecordingError, RecordingWriter
from daq.rig import Rig, load_rig
from tests.conftest import require
from tests.twin.display_process import (
    CHROMIUM,
    CHROMIUM_FLAGS,
    Display,
    Source,
    complaints,
    family,
    headless_viewer,
    listening,
    newest_time,
    pixels_of,
    rig_on_free_ports,
    view_names,
    wait_until,
)
from tests.twin.drawn_run import description, event, messages
from twin.display_address import NotShown, find
from twin.display_look import CONTACT, EDGE, MEASURED, TWIN
from twin.display_recording import save_recording
from twin.viewer import ViewerError, refuse_taken

LOOPBACK = "0100007F"
VIEWS = {
    "Rig",
    "Orbit at the bearing, µm (seen from the free end, y up)",
    "Regime",
    "Events",
    "Displacement at the bearing, µm",
    "Force, N",
    "Speed, Hz",
    "Residual of the probes (measured less twin), µm",
    "Residual of the transducers (measured less twin), N",
}


def record(path: Path, rig: Rig, seconds: float) -> Path:
    with RecordingWriter(path, description(rig, "run", "EMULATED")) as writer:
        for key, payload in messages(rig, "run", seconds):
            writer.add(key, payload)
    return path


@pytest.mark.needs_viewer
def test_recording_opens_in_the_viewer_with_all_views_and_no_complaint(tmp_path):
    drawn = tmp_path / "run.rrd"
    save_recording([record(tmp_path / "run.mcap", load_rig("thesis-ball"), 5.0)], drawn)
    with headless_viewer(str(drawn)) as (client, _):
        wait_until(lambda: newest_time(client) > 4.9, "the whole recording")
        client.set_time(timeline="time", duration=4.9, play_state="paused")
        wait_until(lambda: view_names(client) == VIEWS, "the views")
        wait_until(lambda: pixels_of(client.take_screenshot(), CONTACT) > 20, "the contact force's arrow")
        picture = client.take_screenshot()
        assert complaints(client) == []
    assert pixels_of(picture, EDGE) > 500
    assert pixels_of(picture, MEASURED) > 500
    assert pixels_of(picture, TWIN) > 500


@pytest.mark.needs_viewer
def test_rig_without_model_shows_its_measurement(tmp_path):
    toml = load_rig("thesis-ball", ["twin.model=none"]).toml
    path = tmp_path / "plain.toml"
    path.write_text(toml, encoding="utf-8")
    drawn = tmp_path / "run.rrd"
    save_recording([record(tmp_path / "run.mcap", load_rig(path), 1.0)], drawn)
    with headless_viewer(str(drawn)) as (client, _):
        wait_until(lambda: newest_time(client) > 0.9, "the whole recording")
        measured = {name for name in VIEWS if not name.startswith("Res")} - {"Regime"}
        wait_until(lambda: view_names(client) == measured, "the views")
        assert complaints(client) == []


@pytest.mark.needs_browser
def test_browser_shows_the_run_from_the_page_on_loopback(tmp_path):
    require(CHROMIUM.exists(), "Debian's chromium")
    from playwright.sync_api import sync_playwright

    rig = rig_on_free_ports()
    errors: list[str] = []
    with Source(rig) as source, Display(rig, tmp_path) as display, sync_playwright() as playwright:
        address = display.address()
        source.wait_for_display()
        assert listening(family(display.process.pid)) == {LOOPBACK}
        source.publish(messages(rig, "run", 5.0))
        browser = playwright.chromium.launch(executable_path=str(CHROMIUM), args=list(CHROMIUM_FLAGS))
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(address)
        wait_until(lambda: pixels_of(page.screenshot(), MEASURED) > 300, "the orbit in the browser")
        assert pixels_of(page.screenshot(), TWIN) > 200
        page.screenshot(path=os.environ.get("RIGTWIN_TEST_PICTURE", str(tmp_path / "page.png")))
        browser.close()
        assert display.end() == 0
    assert errors == []


@pytest.mark.needs_viewer
def test_viewer_follows_the_run_and_a_second_run_beside_it(tmp_path):
    rig = rig_on_free_ports()
    with Source(rig) as source, Display(rig, tmp_path) as display:
        display.address()
        source.wait_for_display()
        with headless_viewer(find(rig.name).data) as (client, _):
            source.publish(messages(rig, "one", 2.0))
            wait_until(lambda: newest_time(client) > 1.9, "the first run")
            source.publish(messages(rig, "two", 3.0))
            wait_until(lambda: len(client.get_state().recordings) == 2, "a second recording")
            wait_until(lambda: max(newest_time(client, 0), newest_time(client, 1)) > 2.9, "the second run")
            assert complaints(client) == []
        assert display.end() == 0


@pytest.mark.needs_viewer
def test_a_replay_that_goes_back_is_shown_beside_what_was_shown(tmp_path):
    rig = rig_on_free_ports()
    with Source(rig, mode="REPLAY") as source, Display(rig, tmp_path) as display:
        display.address()
        source.wait_for_display()
        with headless_viewer(find(rig.name).data) as (client, _):
            source.publish(messages(rig, "run", 2.0))
            wait_until(lambda: newest_time(client) > 1.9, "the first pass")
            source.publish(messages(rig, "run", 1.0))
            wait_until(lambda: len(client.get_state().recordings) == 2, "a second recording")
            wait_until(lambda: 0.9 < min(newest_time(client, 0), newest_time(client, 1)) < 1.1, "the second")
            assert complaints(client) == []
        assert display.end() == 0


@pytest.mark.needs_viewer
def test_stopped_viewer_holds_nobody_up(tmp_path):
    rig = rig_on_free_ports()
    with Source(rig) as source, Display(rig, tmp_path) as display:
        display.address()
        source.wait_for_display()
        with headless_viewer(find(rig.name).data) as (client, viewer):
            source.publish(messages(rig, "run", 0.5))
            wait_until(lambda: newest_time(client) > 0.4, "the beginning")
            viewer.send_signal(signal.SIGSTOP)
            source.publish(messages(rig, "later", 20.0), speed=8.0)
            wait_until(lambda: shown(source) == 20 * 25000, "the rest of the run to be drawn")
        assert display.end() == 0


def shown(source: Source) -> int:
    """Index that the display says it has reached."""
    return Status.FromString(source.statuses[-1]).sample if source.statuses else 0


def test_ends_with_its_standard_input_and_not_with_the_run_or_ctrl_c(tmp_path):
    rig = rig_on_free_ports()
    with Source(rig) as source, Display(rig, tmp_path) as display:
        address = display.address()
        source.wait_for_display()
        source.publish(messages(rig, "run", 0.5))
        wait_until(lambda: b"ended" in b"".join(source.statuses[-1:]), "the end of the run")
        display.process.send_signal(signal.SIGINT)
        with urllib.request.urlopen(address.partition("?")[0], timeout=20) as page:
            assert b"Rerun" in page.read()
        assert find(rig.name).page == address
        _, child = family(display.process.pid)
        assert display.end() == 0
        assert not Path(f"/proc/{child}").exists()
    with pytest.raises(NotShown, match="runs without a display"):
        find(rig.name)


def test_page_dies_with_a_killed_display(tmp_path):
    rig = rig_on_free_ports()
    with Display(rig, tmp_path) as display:
        display.address()
        _, page = family(display.process.pid)
        display.process.kill()
        wait_until(lambda: not Path(f"/proc/{page}/exe").exists(), "the page's end")
    with pytest.raises(NotShown):
        find(rig.name)


def test_counts_what_it_did_not_get(tmp_path):
    rig = rig_on_free_ports()
    with Source(rig) as source, Display(rig, tmp_path) as display:
        display.address()
        source.wait_for_display()
        everything = list(messages(rig, "run", 1.0))
        missing = [item for number, item in enumerate(everything) if not 60 < number < 120]
        blocks = sum(key == keys.block(rig.name) for key, _ in everything)
        kept = sum(key == keys.block(rig.name) for key, _ in missing)
        source.publish(missing)
        wait_until(lambda: shown(source) == 25000, "the run")
        status = Status.FromString(source.statuses[-1])
        assert status.lost == (blocks - kept) * rig.acquisition.block
        assert status.samples == kept * rig.acquisition.block
        assert display.end() == 0


def test_bytes_that_are_no_message_do_no_harm(tmp_path):
    rig = rig_on_free_ports()
    with Source(rig) as source, Display(rig, tmp_path) as display:
        display.address()
        source.wait_for_display()
        everything = list(messages(rig, "run", 0.5))
        source.publish(everything[:40])
        source.publish([(key, payload[: len(payload) // 2]) for key, payload in everything[:6]])
        source.publish([event(rig, "run", 2**63, "mark", "far in the future"), *everything[40:]])
        wait_until(lambda: shown(source) == 12500, "the run")
        assert display.end() == 0


def test_taken_port_is_refused_in_one_line(tmp_path):
    rig = rig_on_free_ports()
    port = rig.link.daq
    with Source(rig), Display(rig, tmp_path, "--web-port", port) as display:
        assert display.process.wait(60) == 2
        assert display.said() == (
            f"display: port {port} on 127.0.0.1 cannot be used (Address already in use); take another one\n"
        )
    with Source(rig), Display(rig, tmp_path, "--grpc-port", port) as display:
        assert display.process.wait(60) == 2
        assert display.said().count("\n") == 1


def test_free_port_is_not_refused():
    refuse_taken(*free_ports(1))
    with pytest.raises(ViewerError):
        refuse_taken(70_000)


def test_missing_recording_and_existing_target_are_refused(tmp_path):
    with pytest.raises(RecordingError):
        save_recording([tmp_path / "none.mcap"], tmp_path / "out.rrd")
    target = tmp_path / "there.rrd"
    target.touch()
    with pytest.raises(RecordingError, match="exists already"):
        save_recording([record(tmp_path / "run.mcap", load_rig("thesis-ball"), 0.1)], target)
