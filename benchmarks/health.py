"""How often the twin names a fault of a sensor or of the rig within 2 s, and how often it cries wolf.

A hundred faults drawn by seed, ten of each of `FAULTS`, on the ball, the plain and the pinned bearing, at
drawn times, speeds and sizes (`tests.twin.faults`, which holds the bounds). Right is a run in which kind,
channel and pin are named, and nothing else is. Then sound runs of five minutes with drawn speeds, ramps,
dwells and hits (`tests.twin.nominal`), `--hours` of them, in which nothing may be named. In all of them,
contact, coupling and unbalance differ from what the twin is told. It takes half an hour of one core, on as
many as there are, so `python -m benchmarks` leaves it out. Run `python -m benchmarks.health`.
"""

from collections.abc import Sequence
from math import nan
from statistics import median
from typing import NamedTuple

from benchmarks.report import Figure, in_processes, parser, show
from tests.twin.faults import WITHIN, drawn, is_right, told
from tests.twin.nominal import Alarm, alarms

FAULTS = {
    "drift": ("probe's drift", "transducer's drift"),
    "gain": ("probe's gain",),
    "loose transducer": ("loose transducer",),
    "lost channel": ("lost channel",),
    "runout": ("probe's runout",),
    "skew": ("probe's skew", "transducer's skew"),
    "lost magnet": ("lost magnet",),
    "added unbalance": ("added unbalance",),
    "worn pin": ("worn pin",),
    "changed clearance": ("changed clearance",),
}
"""What is drawn, and as which of `tests.twin.faults.KINDS`, in turns."""
SEED = 11_000
PIECE = 300.0  # s of a sound run
ASKED = 95.0  # % that are to be named


class Naming(NamedTuple):
    """A fault as it was drawn, and what was said of it."""

    fault: str
    seed: int
    right: bool
    said: str  # kinds, with channel or pin
    delay: float  # s until the first was said; NaN: nothing was


def naming(fault: str, seed: int) -> Naming:
    """Draw a fault by a seed, and let the watches look at it for `WITHIN`."""
    labels = FAULTS[fault]
    it = drawn(labels[seed % len(labels)], seed)
    times, faults = [], []
    for time, each in told(it):
        times.append(time - it.begin)
        faults.append(each)
    said = ", ".join(f"{each.kind} {each.channel or each.pin or ''}".strip() for each in faults)
    return Naming(fault, seed, is_right(it, faults), said or "nothing", min(times, default=nan))


def alarms_of(seed: int) -> list[Alarm]:
    """Return the false alarms of one sound run."""
    return alarms(seed, PIECE)


def print_table(namings: Sequence[Naming], false: Sequence[Alarm]) -> None:
    """Print how often each fault was named right, when, and what else was said; and each false alarm."""
    for fault in FAULTS:
        of = [each for each in namings if each.fault == fault]
        right = [each.delay for each in of if each.right]
        others = ", ".join(f"seed {each.seed}: {each.said}" for each in of if not each.right)
        delay = f"{median(right):4.2f} s" if right else ""
        print(f"{fault:18} {len(right):3} of {len(of):3}  {delay:7} {others}")
    for alarm in false:
        print(f"false alarm: {alarm.rig}, seed {alarm.seed}, after {alarm.time:.1f} s: {alarm.said}")
    print()


def figures(namings: Sequence[Naming], false: Sequence[Alarm], hours: float) -> dict[str, Figure]:
    """Return the share of faults named right, how long it took, and the false alarms per hour."""
    right = [each.delay for each in namings if each.right]
    asked = "what is asked"
    return {
        "faults_named": Figure(
            100.0 * len(right) / len(namings), "%", ASKED, f"{asked}, {len(namings)} runs"
        ),
        "time_to_name": Figure(median(right), "s", WITHIN, "what is allowed"),
        "false_alarms": Figure(
            len(false) / hours, "1/h", 1.0, f"one in an hour, {hours:.3g} h of sound runs"
        ),
    }


def main() -> None:
    """Measure and report."""
    options = parser(__doc__)
    options.add_argument("--seed", type=int, default=SEED, help="the first seed of faults and sound runs")
    options.add_argument("--each", type=int, default=10, help="faults of each kind")
    options.add_argument("--hours", type=float, default=2.0, help="of sound running")
    chosen = options.parse_args()
    cases = [(fault, chosen.seed + number) for fault in FAULTS for number in range(chosen.each)]
    pieces = max(1, round(3600.0 * chosen.hours / PIECE))
    sound = range(chosen.seed, chosen.seed + pieces)
    namings = in_processes(naming, *zip(*cases, strict=True))
    false = [alarm for each in in_processes(alarms_of, sound) for alarm in each]
    if not chosen.json:
        print_table(namings, false)
    show(figures(namings, false, pieces * PIECE / 3600.0), chosen.json)


if __name__ == "__main__":
    main()
