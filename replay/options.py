"""What the options of a replay mean, on every command line that takes them."""

import argparse
import math

SLOWEST = 0.01  # times real time


def rate(text: str) -> float:
    """Return times real time; infinite for `max`."""
    times = math.inf if text == "max" else number(text)
    if not times >= SLOWEST:
        raise argparse.ArgumentTypeError(f"{text!r} must be a number from {SLOWEST:g} on, or max")
    return times


def pace(times: float) -> str:
    """Return a rate in words."""
    return "as fast as it is taken" if math.isinf(times) else f"at {times:g} times real time"


def seconds(text: str) -> float:
    """Return a time from the beginning of a recording."""
    found = number(text)
    if not 0.0 <= found < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r} must be a number of seconds from 0 on")
    return found


def number(text: str) -> float:
    """Return a number; NaN for what is none."""
    try:
        return float(text)
    except ValueError:
        return math.nan
