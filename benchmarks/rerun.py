"""How fast the twin runs again over a recording: `rigtwin verify` and `rigtwin twin`, against real time.

Both read the whole recording, check it against its certificate and estimate over every block; `verify`
compares each estimate with the recorded one, `twin` writes a recording anew. The twin's kernels are compiled
before: the recording was made in the same process.
"""

import tempfile
from pathlib import Path

from benchmarks.report import Figure, in_turns, parser, show, timed
from daq.commanding.plan import load_plan
from daq.rig import load_rig
from replay.rerun import estimate
from replay.verify import IDENTICAL, verify
from rigtwin.simulate_command import simulate

RIG = "thesis-ball"


def measure(path: Path, rounds: int) -> dict[str, float]:
    """Return the median time of each way to run the twin again, s."""
    anew = path.with_name("anew.mcap")

    def prove() -> None:
        assert verify(path).verdict == IDENTICAL

    def replace() -> float:
        seconds = timed(lambda: estimate(path, anew))
        anew.unlink()
        return seconds

    return in_turns({"verify": lambda: timed(prove), "twin": replace}, rounds)


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--rounds", type=int, default=3)
    options.add_argument("--plan", default="impacts")
    chosen = options.parse_args()
    with tempfile.TemporaryDirectory() as name:
        rig, path = load_rig(RIG), Path(name) / "run.mcap"
        duration = simulate(rig, load_plan(chosen.plan, rig), path).samples / rig.acquisition.rate
        seconds = measure(path, chosen.rounds)
    figures = {
        "verify_speed": Figure(duration / seconds["verify"], "s/s", 1.0, "real time"),
        "twin_again_speed": Figure(duration / seconds["twin"], "s/s", 1.0, "real time"),
    }
    show(figures, chosen.json)


if __name__ == "__main__":
    main()
