"""Marked regions: which stretches of a run are told, and that a real acquisition tells them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daq.regions import Region, Regions
from daq.rig import load_rig
from tests.daq.test_acquisition import Bench

BEFORE, AFTER = 10, 20


def told(triggers, end, step=1):
    """Regions of triggers {sample: cause} in a run of `end` samples, looked for after every `step`."""
    regions, found = Regions(BEFORE, AFTER), []
    for sample in range(0, end, step):
        for at in range(sample, min(end, sample + step)):
            if at in triggers:
                regions.trigger(at, triggers[at])
        found += regions.over(min(end, sample + step))
    return [*found, *regions.over(end, ending=True)]


def test_a_region_lies_around_its_trigger():
    assert told({100: "trip"}, 200) == [Region(90, 120, ("trip",))]
    assert Region(90, 120, ("trip",)).text(31.0) == "region of 1.00 s around trip"


def test_overlapping_regions_are_one_and_tell_each_cause_once():
    assert told({100: "trip", 115: "mark", 118: "mark"}, 200) == [Region(90, 138, ("trip", "mark"))]


def test_regions_apart_are_two():
    assert told({100: "a", 131: "b"}, 200) == [Region(90, 120, ("a",)), Region(121, 151, ("b",))]


def test_a_region_ends_with_the_run_and_begins_with_it():
    assert told({3: "a", 95: "b"}, 100) == [Region(0, 23, ("a",)), Region(85, 99, ("b",))]


@given(st.sets(st.integers(0, 299), max_size=12), st.integers(1, 9))
def test_all_that_is_near_a_trigger_is_in_a_region(triggers, step):
    wanted, covered = np.zeros(300, bool), np.zeros(300, bool)
    for sample in triggers:
        wanted[max(0, sample - BEFORE) : sample + AFTER + 1] = True
    for first, last, _ in told(dict.fromkeys(triggers, "x"), 300, step):
        assert not covered[last]  # the ends of two regions differ
        covered[first : last + 1] = True
    np.testing.assert_array_equal(covered, wanted)


def test_the_daq_tells_the_region_of_a_mark_and_a_trip():
    bench = Bench(load_rig("thesis-ball", ["capture.before=0.1", "capture.after=0.2"])).begin()
    bench.go(0.5)
    bench.ask("mark", text="here")
    bench.go(0.1)
    bench.ask("trip")
    bench.go(0.3)
    (region,) = [event for event in bench.sink.events if event.kind == "region"]
    trip = bench.sink.event("trip").sample
    first, last = int(region.details["first"]), int(region.details["last"])
    assert (first, last) == (bench.sink.event("mark").sample - 2500, trip + 5000)
    assert region.details["causes"] == "mark, trip"
    assert last < region.sample <= last + 50
    assert region.text == f"region of {(last - first + 1) / 25000:.2f} s around mark, trip"


def test_a_region_that_the_end_cuts_is_told_before_the_end():
    bench = Bench().begin()
    bench.go(0.1)
    bench.ask("mark", text="late")
    bench.go(0.1)
    bench.acquisition.end()
    assert bench.sink.kinds()[-2:] == ["region", "end"]
    assert bench.sink.event("region").details["last"] == str(bench.acquisition.sample - 1)


def test_settings_are_checked():
    with pytest.raises(ValueError, match=r"\[capture\] before = -1"):
        load_rig("thesis-ball", ["capture.before=-1"])
