"""The common face of all benchmarks: figures, each a value beside a baseline of the same run."""

import argparse
import json
import time
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from statistics import median
from typing import NamedTuple, TypeVar

Result = TypeVar("Result")


class Figure(NamedTuple):
    """One measured figure."""

    value: float
    unit: str
    baseline: float  # in the same unit, measured in the same run (or a definition, as one core)
    what: str  # what the baseline is

    @property
    def ratio(self) -> float:
        """Value over baseline."""
        return self.value / self.baseline


def parser(description: str | None) -> argparse.ArgumentParser:
    """Return the argument parser that every benchmark starts from."""
    found = argparse.ArgumentParser(description=description)
    found.add_argument("--json", action="store_true", help="print one JSON object")
    return found


def show(figures: Mapping[str, Figure], as_json: bool) -> None:
    """Print the figures, as a table or as one JSON object."""
    if as_json:
        rows = {
            name: {
                "value": figure.value,
                "unit": figure.unit,
                "baseline": figure.baseline,
                "ratio": figure.ratio,
            }
            for name, figure in figures.items()
        }
        print(json.dumps(rows, indent=1))
        return
    width = max(len(name) for name in figures)
    for name, figure in figures.items():
        print(
            f"{name:{width}}  {figure.value:10.4g} {figure.unit:8}  {figure.ratio:8.3g} x {figure.what} "
            f"({figure.baseline:.4g} {figure.unit})"
        )


def in_processes(action: Callable[..., Result], *arguments: Iterable[object]) -> list[Result]:
    """Return what an action makes of each set of arguments, in their order, computed on all cores."""
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
        return list(pool.map(action, *arguments))


def rotated(names: list[str], rounds: int) -> list[list[str]]:
    """Return the variants' order for each round: each round begins with the next one, against drift."""
    return [names[shift % len(names) :] + names[: shift % len(names)] for shift in range(rounds)]


def in_turns(variants: Mapping[str, Callable[[], float]], rounds: int) -> dict[str, float]:
    """Return the median of what each variant measures, taking turns for `rounds` rounds."""
    found: dict[str, list[float]] = {name: [] for name in variants}
    for order in rotated(list(variants), rounds):
        for name in order:
            found[name].append(variants[name]())
    return medians(found)


def timed(action: Callable[[], object]) -> float:
    """Return how long an action takes by the clock, s."""
    began = time.perf_counter()
    action()
    return time.perf_counter() - began


def medians(samples: Mapping[str, list[float]]) -> dict[str, float]:
    """Return the median of each variant's samples."""
    return {name: median(values) for name, values in samples.items()}
