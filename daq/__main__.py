"""`python -m daq acquire` owns a rig's hardware, `operate` performs plans on it, `device` is emulated."""

import argparse
import sys
from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the process that the arguments name; return its exit code, 2 when it cannot do its work."""
    options = _parser().parse_args(arguments)
    try:
        return options.run_process(options)
    except (RuntimeError, ValueError) as error:
        print(f"daq: {error}", file=sys.stderr, flush=True)
        return 2


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m daq", description=__doc__)
    processes = parser.add_subparsers(required=True, metavar="PROCESS")
    acquire = processes.add_parser(
        "acquire", help="acquire, protect and publish a rig until standard input ends or says stop"
    )
    acquire.add_argument("--rig", required=True, metavar="NAME|PATH", help="rig description")
    acquire.add_argument("--run", default="", metavar="ID", help="run id (default: made of the time)")
    acquire.add_argument(
        "--wait-for",
        default="",
        metavar="NAMES",
        help="processes that must be there before the first sample, separated by commas",
    )
    acquire.add_argument("--duration", type=float, metavar="S", help="end after this many seconds")
    acquire.add_argument(
        "--meta", action="append", default=[], metavar="KEY=VALUE", help="goes into the recording"
    )
    acquire.set_defaults(run_process=_acquire)
    operate = processes.add_parser("operate", help="hold the lease, perform plans, pass commands on")
    operate.add_argument("--rig", required=True, metavar="NAME|PATH", help="rig description")
    operate.add_argument("--plan", metavar="NAME|PATH", help="plan to perform (default: none)")
    operate.set_defaults(run_process=_operate)
    device = processes.add_parser("device", help="be the emulated device of a daq, which starts this itself")
    device.add_argument("--socket", type=int, required=True, metavar="N", help="inherited descriptor")
    device.add_argument(
        "--watchdog", type=float, required=True, metavar="S", help="silence that stops the rig"
    )
    device.set_defaults(run_process=_device)
    return parser


def _acquire(options: argparse.Namespace) -> int:
    from daq.recording.metadata import metadata_of
    from daq.rig import load_rig
    from daq.service import acquire

    wait_for = tuple(name for name in options.wait_for.split(",") if name)
    meta = metadata_of(options.meta)
    acquire(load_rig(options.rig), options.run, wait_for, options.duration, meta)
    return 0


def _operate(options: argparse.Namespace) -> int:
    from daq.commanding.operator import operate

    operate(options.rig, options.plan)
    return 0


def _device(options: argparse.Namespace) -> int:
    from daq.device import serve

    serve(options.socket, options.watchdog)
    return 0


if __name__ == "__main__":
    sys.exit(main())
