"""Makes the fixture of a released version: `python -m tests.recordings.make_fixture`, once, at its release.

It is a small recording of every kind of message, and beside it, as JSON, what is in it. A later version
must read both as they are: never make an old one anew.
"""

import json
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from daq.commanding.plan import load_plan
from daq.recording import Recording
from daq.rig import load_rig
from rigtwin import simulate

FOLDER = Path(__file__).parent / "fixtures"
SERIES = ("block", "estimate", "truth")
PLAN = """
[plan]
name = "fixture"
description = "a hit and a mark, in a tenth of a second"
[[step]]
do = "hit"
solenoid = "horizontal"
force = 40.0
duration = 0.010
[[step]]
do = "mark"
text = "here"
[[step]]
do = "wait"
duration = 0.1
"""


def facts(path: Path) -> dict[str, Any]:
    """Return what is in a recording, as far as a fixture tells it."""
    with Recording(path) as recording:
        description, certificate = recording.description, recording.certificate
        assert certificate is not None
        series = {name: recording.series(name) for name in SERIES}
        return {
            "run": description.run,
            "rig": description.rig,
            "rate": description.rate,
            "t0_ns": description.t0_ns,
            "messages": certificate.messages,
            "file_digest": certificate.file_digest,
            "signal_digests": certificate.signal_digests,
            "events": [[event.source, event.kind, event.sample] for event in recording.events()],
            "units": {key: dict(zip(each.names, each.units, strict=True)) for key, each in series.items()},
            "last": {
                key: dict(zip(each.names, each.samples[:, -1].tolist(), strict=True))
                for key, each in series.items()
            },
        }


def main() -> None:
    """Make the fixture of the installed version; one that is there already stays."""
    path = FOLDER / f"{version('rigtwin')}.mcap"
    rig = load_rig("thesis-ball", ["emulator.seed=7"])
    with TemporaryDirectory() as folder:
        plan = Path(folder) / "fixture.toml"
        plan.write_text(PLAN, encoding="utf-8")
        simulate(rig, load_plan(plan, rig), path)
    path.with_suffix(".json").write_text(json.dumps(facts(path), indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
