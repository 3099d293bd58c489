"""The documentation is true: generated parts are the code's, examples run as they stand, links resolve."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

import rigtwin
from daq.link import free_ports
from docs.generate.pages import FOLDER, PARTS, part_names, refreshed

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
EXAMPLE = re.compile(r"(?:<!-- file: (\S+) -->\n)?^```(\w+)\n(.*?)^```", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
PAGES = (
    "reference/plan-file.md",
    "reference/python.md",
    "reference/recording.md",
    "reference/rig-file.md",
    "explanation/coordinates.md",
    "how-to/connect-a-device.md",
    "how-to/describe-a-rig.md",
    "how-to/export-a-recording.md",
    "how-to/find-a-recording.md",
    "how-to/import-lab-data.md",
    "how-to/mend-a-recording.md",
    "how-to/prove-a-recording.md",
    "how-to/read-a-recording.md",
)
PLAN = """
[plan]
name = "short"
description = "a hit, a little speed, a mark"
[[step]]
do = "hit"
solenoid = "horizontal"
force = 40.0
duration = 0.010
[[step]]
do = "speed"
speed_hz = 4.0
[[step]]
do = "mark"
text = "here"
[[step]]
do = "wait"
duration = 0.2
"""


class Example(NamedTuple):
    file: str
    kind: str
    text: str


def examples(page):
    return [Example(*found) for found in EXAMPLE.findall((DOCS / page).read_text(encoding="utf-8"))]


def own_pages():
    tracked = [ROOT / "README.md", ROOT / "CHANGELOG.md", *DOCS.rglob("*.md")]
    return [path.relative_to(ROOT) for path in tracked]


@pytest.mark.parametrize("page", sorted(path.name for path in FOLDER.glob("*.md")))
def test_what_is_generated_is_as_the_code_has_it(page):
    text = (FOLDER / page).read_text(encoding="utf-8")
    assert refreshed(text) == text, "write it anew: python -m docs.generate"


def test_every_generated_part_stands_somewhere():
    used = [name for path in FOLDER.glob("*.md") for name in part_names(path.read_text(encoding="utf-8"))]
    assert sorted(used) == sorted(PARTS)


@pytest.mark.parametrize("page", own_pages(), ids=str)
def test_every_link_leads_somewhere(page):
    text = re.sub(r"```.*?```", "", (ROOT / page).read_text(encoding="utf-8"), flags=re.DOTALL)
    for link in LINK.findall(text):
        if "://" in link:
            continue
        path, _, anchor = link.partition("#")
        target = (ROOT / page).parent / path if path else ROOT / page
        assert target.exists(), link
        assert not anchor or anchor in anchors(target), link


def anchors(path):
    """The anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", path.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES)
def test_every_example_works(page, tmp_path, monkeypatch, recorded):
    shutil.copy(recorded, tmp_path / "run.mcap")
    monkeypatch.chdir(tmp_path)
    assert run(examples(page), tmp_path)


def test_a_backend_as_described_passes_and_runs(tmp_path):
    write_files(examples("how-to/describe-a-rig.md"), tmp_path)
    page = examples("how-to/write-a-backend.md")
    write_files(page, tmp_path)
    install(tmp_path)
    assert run(page, tmp_path, PYTHONPATH=str(tmp_path)) == 3


def test_tests_against_a_rig_as_described_pass(tmp_path):
    packages = tmp_path / "packages"
    packages.mkdir()
    shutil.copy(ROOT / "pyproject.toml", packages)
    install(packages)
    page = examples("how-to/test-against-a-rig.md")
    assert run(page, tmp_path, PYTHONPATH=f"{packages}{os.pathsep}{ROOT}") == 1


def test_a_listener_as_described_hears_a_run(tmp_path):
    (example,) = [each for each in examples("how-to/watch-from-another-process.md") if each.file]
    (port,) = free_ports(1)
    (tmp_path / "watch.py").write_text(example.text.replace("7447", str(port)), encoding="utf-8")
    rig = tmp_path / "rig.toml"
    rig.write_text(rigtwin.load_rig("thesis-ball", [f"link.daq={port}"]).toml, encoding="utf-8")
    with subprocess.Popen(
        [sys.executable, "-P", "-m", "daq", "acquire", "--rig", str(rig)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as daq:
        try:
            assert daq.stdout.readline().strip() == "ready"
            said = called([sys.executable, "watch.py"], tmp_path)
        finally:
            daq.stdin.close()
            daq.wait(60)
    assert len(said.splitlines()) == 100
    assert re.fullmatch(r"-?0\.\d\d Hz, 11\d\d µm, x -?\d+ µm", said.splitlines()[-1])


def test_every_kind_of_event_is_told(recorded):
    page = (FOLDER / "messages.md").read_text(encoding="utf-8")
    with rigtwin.Recording(recorded) as recording:
        kinds = {event.kind for event in recording.events()}
        topics = set(recording.topics())
    assert len(kinds) > 8
    assert [kind for kind in sorted(kinds) if f"`{kind}`" not in page] == []
    assert "rig/thesis-ball/twin/summary" in topics


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A short recording with impacts and the twin's estimates."""
    folder = tmp_path_factory.mktemp("recorded")
    (folder / "short.toml").write_text(PLAN, encoding="utf-8")
    rig = rigtwin.load_rig("thesis-ball")
    rigtwin.simulate(rig, rigtwin.load_plan(folder / "short.toml", rig), folder / "run.mcap")
    return folder / "run.mcap"


def write_files(page, folder):
    for example in page:
        if example.file:
            (folder / example.file).write_text(example.text, encoding="utf-8")


def run(page, folder, **variables):
    """Do what a page's examples say, in their order; return how many commands and scripts that were."""
    names, done = {"__name__": "example"}, 0
    for example in page:
        if example.file:
            write_files([example], folder)
        elif example.kind == "python":
            exec(compile(example.text, "example", "exec"), names)
            done += 1
        elif example.kind == "console":
            lines = [line[2:] for line in example.text.splitlines() if line.startswith("$ ")]
            for line in lines:
                called(["sh", "-c", line], folder, **variables)
            done += len(lines)
    return done


def called(command, folder, **variables):
    result = subprocess.run(
        command,
        cwd=folder,
        env=os.environ | {"PATH": programs()} | variables,
        capture_output=True,
        text=True,
        timeout=240,
    )
    assert result.returncode == 0, f"{command}\n{result.stdout}{result.stderr}"
    return result.stdout


@cache
def programs():
    return f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"


def install(folder):
    """Do what pip does with the package's entry points."""
    project = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    installed = folder / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
    installed.mkdir()
    head = f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
    (installed / "METADATA").write_text(head)
    sections = [
        f"[{group}]\n" + "".join(f"{name} = {value}\n" for name, value in entries.items())
        for group, entries in project["entry-points"].items()
    ]
    (installed / "entry_points.txt").write_text("\n".join(sections))
