"""The thesis beside the simulator: docs/validation.md with its figures. Run `python -m benchmarks.thesis`.

The first time takes some minutes; results are kept in the user's cache folder until the simulator changes.
Needs matplotlib: `pip install "rigtwin[docs]"`.
"""

import os
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from string import Template
from typing import Any

from benchmarks import thesis_drop_figures as drop_figures
from benchmarks import thesis_experiments as experiments
from benchmarks import thesis_figures as figures
from benchmarks import thesis_scan as scan
from benchmarks.report import Figure, parser, show
from benchmarks.thesis_cache import performed
from benchmarks.thesis_claims import REGIONS, Claim, Results, agreement, claims, dropped, regions
from benchmarks.thesis_plotting import save
from benchmarks.thesis_readings import last_contact
from benchmarks.thesis_runs import Hit

DOCS = Path(__file__).parents[1] / "docs"
FOLDER = "validation"

PAGE = Path(__file__).with_name("thesis_page.md")


def main() -> None:
    """Run what is not kept, draw, write, and report how much is reproduced."""
    arguments = parser(__doc__)
    arguments.add_argument("--processes", type=int, default=os.cpu_count() or 1, metavar="N")
    options = arguments.parse_args()
    ball, pinned = experiments.model("thesis-ball"), experiments.model("thesis-pinned")
    found = performed(experiments.jobs() | scan.jobs(ball, pinned), options.processes)
    chapters = claims(found)
    pictures = draw(found)
    (DOCS / "validation.md").write_text(document(found, chapters, pictures), encoding="utf-8")
    show(summary(chapters), options.json)


def summary(chapters: Mapping[str, Iterable[Claim]]) -> dict[str, Figure]:
    """Return how many items have each verdict."""
    verdicts = Counter(claim.verdict for chapter in chapters.values() for claim in chapter)
    total = float(sum(verdicts.values()))
    return {name: Figure(float(count), "items", total, "all") for name, count in verdicts.most_common()}


def draw(found: Results) -> list[tuple[str, str]]:
    """Draw all figures; return their names with captions."""
    ball, pinned = experiments.model("thesis-ball"), experiments.model("thesis-pinned")
    freed = next((hit for hit in upward_hits(found) if hit.freed), None)
    kinds = {"ball": found["ball"], "pinned": found["pinned"]}
    selected = [found[f"lifted {value:.6f}"] for value in experiments.DROPPED]
    drops = {
        name: [found[f"bifurcation {key} {value:.6f}"] for value in experiments.BIFURCATION]
        for name, key in (("as published", "published"), ("with a lifting coupling [HYPOTHESIS]", "lifted"))
    }
    makers: dict[str, tuple[Callable[[], Any], str]] = {
        "hysteresis": (
            lambda: figures.hysteresis(kinds, freed),
            "Largest radius against speed, up and down (P2 figure 11, P3 figure 13). Arrow: one upward hit.",
        ),
        "orbits-ball": (
            lambda: figures.orbits(ball, kinds["ball"]),
            "Orbits in the ball bearing (P2 figure 14, P3 figure 14): two walls up to 12.5 Hz, then the hop.",
        ),
        "orbits-pinned": (
            lambda: figures.orbits(pinned, kinds["pinned"]),
            "Orbits between the pins (P2 figure 14, P3 figure 15): several pins, then one, on the diagonal.",
        ),
        "poincare-ball": (
            lambda: figures.poincare(ball, kinds["ball"]),
            "Poincaré sections, once a turn: many points where the orbit does not repeat, few where it does.",
        ),
        "force": (
            lambda: figures.forces(kinds | {"ball, published contact": found["nominal"]}),
            "Largest transducer resultant against speed (P2 figure 17, P3 figure 16).",
        ),
        "transition": (
            lambda: figures.transitions(transitions(found)),
            "Transition to the safe orbit by the step in speed (P3 figures 17 and 18).",
        ),
        "waterfall": (
            lambda: figures.waterfalls(
                {"residual unbalance": kinds["ball"], "30 g at 33 mm": found["heavy"]}
            ),
            "Double-sided spectra over speed, without and with 30 g at 33 mm (P2 figure 16). Dotted: 1X, 2X.",
        ),
        "orbits-heavy": (
            lambda: figures.orbits(ball, found["heavy"]),
            "Orbits with 30 g at 33 mm (P2 figure 15).",
        ),
        "drop-test": (
            lambda: figures.drop_tests(
                {"published": found["drop test"], "calibrated": found["drop test, calibrated"]}
            ),
            "First impact of a drop at standstill (P3 figures 11 and 12).",
        ),
        "bifurcation": (
            lambda: drop_figures.bifurcation(drops),
            "Bifurcation over unbalance, 6 to 12 s after the drop at 10 Hz (P1 figure 5, C1 figure 4).",
        ),
        "drop-orbits": (
            lambda: drop_figures.orbits(selected, ball.backup_bearing.clearance),
            "Orbits after the drop, with the lifting coupling [HYPOTHESIS] (P1 figures 6 to 10).",
        ),
        "drop-spectra": (
            lambda: drop_figures.spectra(selected),
            "Double-sided spectra after the drop (P1 figure 11, C1 figure 5); forward is positive.",
        ),
        "drop-forces": (
            lambda: drop_figures.forces(selected),
            "Forces after the drop (P1 figure 12).",
        ),
        "drop-poincare": (
            lambda: drop_figures.poincare(selected[4:], ball.backup_bearing.clearance),
            "Poincaré sections after the drop, once a turn.",
        ),
        "readings": (
            lambda: scan.figure(found),
            "Published items met by each reading of the rig, of seven.",
        ),
    }
    if freed is not None:
        makers["hit"] = (
            lambda: figures.freeing_hit(freed, "upward hit on the hopping orbit at 15 Hz"),
            "A hit that frees the rotor (P2 figures 11a and 12a), and the spectra before and after.",
        )
    for name, (make, _) in makers.items():
        save(make(), DOCS / FOLDER / f"{name}.png")
    return [(name, caption) for name, (_, caption) in makers.items()]


def upward_hits(found: Results) -> list[Hit]:
    """Return the hits upwards in the ball bearing."""
    return [hit for force in experiments.FORCES for hit in found[f"ball hit 90 {force:g}"]]


def transitions(found: Results) -> dict[str, Any]:
    """Return for each bearing the first speed without contact, and the gap."""
    chosen = {}
    for name in ("ball", "pinned"):
        run = found[name]
        after = next(dwell for dwell in run.up if dwell.hz > last_contact(run.up))
        chosen[name] = (after, experiments.model(f"thesis-{name}").backup_bearing.clearance)
    return chosen


def document(found: Results, chapters: Mapping[str, list[Claim]], pictures: Iterable[tuple[str, str]]) -> str:
    """Return the page."""
    return Template(PAGE.read_text(encoding="utf-8")).substitute(
        count=counted(chapters),
        chapters="\n".join(f"## {title}\n\n{table(chapter)}" for title, chapter in chapters.items()).rstrip(),
        lifts=lifts(found),
        scan=scan.page(found),
        figures="\n".join(f"![{text}]({FOLDER}/{name}.png)\n\n{text}\n" for name, text in pictures).rstrip(),
    )


def counted(chapters: Mapping[str, list[Claim]]) -> str:
    """Return the verdicts' counts in a sentence."""
    counts = ", ".join(f"{figure.value:.0f} {name}" for name, figure in summary(chapters).items())
    return f"Of {sum(len(chapter) for chapter in chapters.values())} published items: {counts}."


def table(rows: Iterable[Claim]) -> str:
    """Return claims as a table."""
    lines = ["| item | thesis | published | here | verdict | why it differs, or what it rests on |"]
    lines.append("|---|---|---|---|---|---|")
    for row in rows:
        cells = [cell.replace("|", "/") for cell in row]
        lines.append(f"| {' | '.join([*cells[:4], f'**{cells[4]}**', cells[5]])} |")
    return "\n".join(lines) + "\n"


def lifts(found: Results) -> str:
    """Return P1's regions over the coupling's force and the contact, as a table."""
    unbalances = " | ".join(f"{1e6 * value:.0f}" for value in experiments.DROPPED)
    lines = [
        f"| coupling force [N] | contact | {unbalances} g mm | met |",
        "|" + "---|" * (len(experiments.DROPPED) + 3),
        f"| P1, measured | | {' | '.join(REGIONS)} | |",
    ]
    for contact in experiments.DROP_CONTACTS:
        for force in experiments.LIFTS:
            ours = regions(dropped(found, f"{contact} {force:g}"))
            lines.append(f"| {force:g} | {contact} | {' | '.join(ours)} | {agreement(ours)} |")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
