"""What goes wrong with a device: each fault is one event, and no sample is lost that is not told."""

from collections import Counter

import numpy as np
import pytest

from daq import keys
from daq.acquisition import Acquisition
from daq.backend import BackendError, Reading
from daq.backends.emulator import Emulator
from daq.backends.mishaps import DeviceClock
from daq.continuity import Continuity, DriftWatch
from daq.messages import BlockStatus, decode_series
from daq.messages_pb2 import Command, Event
from daq.rig import RigError, load_rig, rig_from_text
from simulator.faults import Fault, FaultKind

RATE = 25_000.0
EVENTS = {"dropped": "gap", "repeated": "repeated", "late": "late", "clock-drift": "clock_drift"}
SENSORS = ("stuck", "open", "gain")
"""Kinds of a sensor's fault: stuck, disconnected, saturated by a gain far too large."""


def rig_with(*faults):
    """The shipped rig with faults (kind, at, size); one of a sensor is on `proximity_y`, for 0.3 s."""
    rows = "".join(
        f'\n[[emulator.fault]]\nname = "f{number}"\nkind = "{kind}"\nat = {at}\n'
        + (f"size = {size}\n" if size is not None else "")
        + ('channel = "proximity_y"\nduration = 0.3\n' if kind in SENSORS else "")
        for number, (kind, at, size) in enumerate(faults)
    )
    return rig_from_text(load_rig("thesis-ball").toml + rows)


class Run:
    """The daq on a paced emulator, by a clock that the test turns in steps of a read.

    Without `keep` the blocks are only counted, so that a run may be long.
    """

    def __init__(self, rig, paced=True, keep=True):
        self.seconds = 100.0
        self.events, self.blocks, self.n_samples = [], [], 0
        self.backend = Emulator(paced=paced, clock=lambda: self.seconds)
        self.backend.open(rig)
        self.daq = Acquisition(rig, self.backend, self._hear, run="r")
        self.daq.begin()
        self.rig, self._keep = rig, keep

    def _hear(self, key, payload):
        if key == keys.event("thesis-ball", "daq"):
            self.events.append(Event.FromString(payload))
        elif key == keys.block("thesis-ball"):
            block = decode_series(payload)
            self.n_samples += block.samples.shape[1]
            if self._keep:
                self.blocks.append(block)

    def until(self, seconds):
        step = self.rig.acquisition.read / self.rig.acquisition.rate
        while self.seconds < 100.0 + seconds:
            self.seconds += step
            self.daq.elapse(step)
            self.daq.step()
            while self.daq.lag > step:  # it catches up at once, as far as the device lets it
                if not self.daq.step():
                    break
        return self


def samples_of(run):
    run.daq.end()
    return np.concatenate([block.samples for block in run.blocks], axis=1)


def assert_begins_as(found, wanted):
    """The same samples, up to the last read: its length hangs on how the steps of the clock round."""
    shortest = min(found.shape[1], wanted.shape[1])
    assert abs(found.shape[1] - wanted.shape[1]) <= 50
    np.testing.assert_array_equal(found[:, :shortest], wanted[:, :shortest])


@pytest.fixture(scope="module")
def whole():
    return samples_of(Run(rig_with()).until(0.5))


@pytest.mark.parametrize("paced", [True, False])
def test_dropped_samples_are_one_gap_of_their_number(whole, paced):
    run = Run(rig_with(("dropped", 0.1001, 777)), paced)
    while run.daq.sample < whole.shape[1]:
        run.until(run.seconds - 100.0 + 0.002) if paced else run.daq.step()
    (gap,) = [event for event in run.events if event.kind == "gap"]
    first = round(0.1001 * RATE)
    assert (int(gap.details["first"]), int(gap.details["last"])) == (first, first + 776)
    assert gap.details["cause"] == "the device skipped samples"
    assert run.daq.lost == 777
    kept = np.delete(whole, np.s_[first : first + 777], axis=1)
    assert_begins_as(samples_of(run), kept)


def test_repeated_samples_are_left_out_and_told_once(whole):
    run = Run(rig_with(("repeated", 0.1, 333))).until(0.5)
    assert [event.kind for event in run.events] == ["start", "repeated"]
    assert run.events[1].details["samples"] == "333"
    assert_begins_as(samples_of(run), whole)


def test_late_samples_are_told_once_and_all_there(whole):
    run = Run(rig_with(("late", 0.1, 0.2))).until(0.5)
    assert [event.kind for event in run.events] == ["start", "late"]
    assert float(run.events[1].details["seconds"]) == pytest.approx(0.2, abs=0.005)
    assert_begins_as(samples_of(run), whole)


def test_an_unplugged_device_fails_after_its_last_sample():
    run = Run(rig_with(("unplugged", 0.1, None)))
    with pytest.raises(BackendError, match="unplugged at sample 2500"):
        run.until(0.5)
    assert run.daq.sample == 2500


def test_a_clock_that_drifts_is_told_once():
    run = Run(rig_with(("clock-drift", 1.0, 20_000))).until(6.0)
    assert [event.kind for event in run.events] == ["start", "clock_drift"]
    # 50 ms apart at 2 % takes 2.5 s after 1 s without: 50 ms in 3.5 s
    assert float(run.events[1].details["ppm"]) == pytest.approx(0.05 / 3.5 * 1e6, rel=0.02)
    assert run.backend.clock() == pytest.approx((1.0 + 5.0 * 1.02) * RATE, abs=51 * 1.02)


def test_a_clock_goes_on_from_where_its_pace_changed():
    clock = DeviceClock(10.0, 1000.0, [Fault(FaultKind.CLOCK_DRIFT, 2.0, 1e5)])
    assert [clock.samples(now) for now in (10.0, 11.9999, 12.00001, 13.00001)] == [0, 1999, 2000, 3100]
    assert clock.samples(20.00001) == 2000 + 8 * 1100
    clock = DeviceClock(10.0, 1000.0, [Fault(FaultKind.CLOCK_DRIFT, 2.0, 1e5, duration=2.2)])
    assert [clock.samples(now) for now in (12.00001, 14.00001, 20.00001)] == [2000, 4200, 4200 + 6000]


def test_a_good_clock_is_not_complained_of():
    watch = DriftWatch(1000.0)
    found = [watch.elapse(0.1, round(100.05 * step)) for step in range(6000)]  # 500 ppm for 600 s
    assert not any(found)


def test_readings_that_overlap_count_once():
    continuity = Continuity(1000.0)
    assert continuity.admit(Reading(0, 50, 0), 50).reading == (0, 50, 0)
    assert continuity.admit(Reading(20, 30, 0), 60).reading.n_samples == 0
    arrival = continuity.admit(Reading(40, 30, BlockStatus.CLIPPED), 90)
    assert arrival == (Reading(50, 20, BlockStatus.CLIPPED), 0, 40, 0)
    assert continuity.admit(Reading(80, 10, 0), 90).missing == 10


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        (("dropped", 0.1, 1.5), r"size = 1.5 must be a whole number of samples"),
        (("late", 0.1, -1.0), r"size = -1 must not be negative"),
        (("clock-drift", 0.1, 2e5), r"size = 200000 must be from -100000 to 100000 ppm"),
        (("unplugged", 0.1, 1), r"has no size; leave it out"),
        (("late", 0.1, None), r"needs size: s during which nothing is delivered"),
    ],
)
def test_a_fault_that_cannot_be_is_refused(fault, message):
    with pytest.raises(RigError, match=message):
        rig_with(fault)


def soak_faults(seed, seconds):
    """One fault a second, each kind equally often, in an order by chance; a drift, and at last the plug."""
    chance = np.random.default_rng(seed)
    sizes = {
        "dropped": lambda: chance.integers(1, 5000),
        "repeated": lambda: chance.integers(1, 900),
        "late": lambda: round(chance.uniform(0.06, 0.3), 4),
        "stuck": lambda: None,
        "open": lambda: None,
        "gain": lambda: 1e4,  # on a shaft that hangs 1.7 mm low, so that it saturates
    }
    kinds = chance.permutation(np.resize(list(sizes), round(seconds) - 7))
    return [
        *((kind, round(at + chance.uniform(0.0, 0.6), 5), sizes[kind]()) for at, kind in enumerate(kinds, 1)),
        ("clock-drift", seconds - 5.0, 30_000),
        ("unplugged", seconds, None),
    ]


@pytest.mark.parametrize(("seed", "seconds"), [(1, 21.0), pytest.param(2, 600.0, marks=pytest.mark.slow)])
def test_every_fault_of_a_soak_is_one_event_and_its_number_of_samples(seed, seconds):
    """The faults are apart, so that none hides another; after each trip somebody resets the rig."""
    faults = soak_faults(seed, seconds)
    run = Run(rig_with(*faults), keep=False)
    resets = sum(resetting(run, second) for second in range(1, round(seconds)))
    with pytest.raises(BackendError, match="unplugged") as unplugged:
        run.until(seconds + 1.0)
    run.daq.fail(str(unplugged.value))
    run.daq.end()

    of_kind = Counter(kind for kind, *_ in faults)
    told = Counter(event.kind for event in run.events if event.kind not in ("warning", "region"))
    trips = sum(of_kind[kind] for kind in SENSORS)
    wanted = Counter({EVENTS[kind]: count for kind, count in of_kind.items() if kind in EVENTS})
    assert told == wanted + Counter(start=1, trip=trips, reset=resets, failure=1, end=1)
    assert resets == trips
    assert_warned_of_nothing_else(run.events)
    assert run.daq.lost == sum(size for kind, _, size in faults if kind == "dropped")
    assert run.n_samples + run.daq.lost == run.daq.sample == round(seconds * RATE)


def resetting(run, seconds):
    """Go on, then reset the rig if it has tripped; tell whether it had."""
    run.until(seconds)
    return bool(run.daq.first_out) and run.daq.serve(Command(name="reset", who="anna")).accepted


def assert_warned_of_nothing_else(events):
    """A warning only comes beside a trip of the same cause, whose lower level is passed, too."""
    told = {kind: [] for kind in ("trip", "warning")}
    for event in events:
        if event.kind in told:
            told[event.kind].append((event.sample // round(RATE), event.details["cause"]))
    assert set(told["warning"]) <= set(told["trip"])
    assert len(told["warning"]) <= len(told["trip"])
