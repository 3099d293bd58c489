"""`rigtwin recordings`: list, filter and compare recordings."""

import argparse
import json
from datetime import date
from pathlib import Path


def add_parser(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add `recordings` to the command line."""
    parser = commands.add_parser(
        "recordings",
        help="list, filter and compare recordings",
        description="List recordings by what stands at their beginning and end. Exit code 1: none fits.",
    )
    parser.add_argument(
        "place", nargs="*", type=Path, metavar="DIR|FILE", help="where to look (default: recordings)"
    )
    parser.add_argument("--rig", metavar="NAME", help="of this rig")
    parser.add_argument("--bearing", metavar="KIND", help="with this backup bearing: ball, plain, pinned")
    parser.add_argument("--since", type=day, metavar="DATE", help="begun on this day (UTC) or later")
    parser.add_argument("--until", type=day, metavar="DATE", help="begun on this day (UTC) or earlier")
    parser.add_argument("--event", metavar="KIND", help="with such an event: trip, gap, mark, hit, ...")
    parser.add_argument("--min-speed", type=float, metavar="HZ", help="whose largest speed is at least this")
    parser.add_argument("--max-speed", type=float, metavar="HZ", help="whose largest speed is at most this")
    tripped = parser.add_mutually_exclusive_group()
    tripped.add_argument("--tripped", action="store_true", default=None, help="in which the rig tripped")
    tripped.add_argument(
        "--not-tripped", dest="tripped", action="store_false", default=None, help="in which it did not"
    )
    parser.add_argument(
        "--meta", action="append", type=pair, default=[], metavar="KEY=VALUE", help="with this told of it"
    )
    parser.add_argument(
        "--read",
        action="store_true",
        help="read those whole that were not closed or come from an older version, which tell little",
    )
    parser.add_argument("--compare", action="store_true", help="side by side, with differences of their rigs")
    parser.add_argument("--json", action="store_true", help="print a JSON list, in SI units and Hz")
    parser.set_defaults(run=run)


def day(text: str) -> date:
    """Return a day."""
    try:
        return date.fromisoformat(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} must be a day, as 2026-01-31") from None


def pair(text: str) -> tuple[str, str]:
    """Return a key and its value."""
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise argparse.ArgumentTypeError(f"{text!r} must be key=value, as operator=anna")
    return key.strip(), value.strip()


def run(options: argparse.Namespace) -> int:
    """List or compare; return 1 when no recording fits."""
    import sys

    from replay.catalogue import catalogue
    from replay.catalogue_text import comparison, listing
    from replay.selection import Selection

    selection = Selection(
        rig=options.rig,
        bearing=options.bearing,
        since=options.since,
        until=options.until,
        event=options.event,
        min_speed_hz=options.min_speed,
        max_speed_hz=options.max_speed,
        tripped=options.tripped,
        meta=dict(options.meta),
    )
    entries, refused = catalogue(options.place or [Path("recordings")], whole=options.read)
    verdicts = [selection.judge(entry) for entry in entries]
    wanted = [entry for entry, verdict in zip(entries, verdicts, strict=True) if verdict]
    for reason in refused:
        print(f"rigtwin: {reason}", file=sys.stderr)
    if untold := verdicts.count(None):
        print(
            f"rigtwin: {untold} more may fit, but were not closed or are older: --read reads them whole",
            file=sys.stderr,
        )
    if options.json:
        print(json.dumps([entry.to_json() for entry in wanted], indent=2))
    elif wanted:
        print(comparison(wanted) if options.compare else listing(wanted))
    else:
        print("no recording fits")
    return 0 if wanted else 1
