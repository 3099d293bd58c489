"""How the comparison with the thesis judges, keeps and writes what the runs say."""

import numpy as np
import pytest

from benchmarks.thesis_cache import Job, performed
from benchmarks.thesis_claims import NEAR, NO, YES, verdict
from benchmarks.thesis_experiments import model
from benchmarks.thesis_readings import (
    Score,
    first_contact,
    first_hop,
    last_contact,
    one_pin,
    region,
)
from benchmarks.thesis_runs import NO_TRACE, Drop, Dwell, drop_test, extremes, levels


def dwell(hz, touched=True, width=1.0, height=1.0, hits=2.0):
    """Return a dwell with what the readings look at."""
    return Dwell(hz, touched, 9.0, 1.6e-3, 50.0, width, height, hits, 0.1, 0.0, NO_TRACE, NO_TRACE)


RUN = [
    dwell(9.0, touched=False),
    dwell(10.0, height=3.0),  # an early hop, which does not last
    dwell(11.0),
    dwell(12.0, height=3.0, hits=1.0),
    dwell(13.0, height=3.0, hits=1.01),
    dwell(14.0, touched=False),
]


def test_readings_of_a_run():
    assert first_contact(RUN) == 10.0
    assert last_contact(RUN) == 13.0
    assert first_hop(RUN) == 12.0
    assert one_pin(RUN) == (12.0, 13.0)
    assert np.isnan(first_contact(RUN[:1]))
    assert np.isnan(one_pin(RUN[:1])[0])


@pytest.mark.parametrize(("share", "turns", "y", "expected"), [
    (1.0, 0.0, -1.0, "I"),
    (1.0, 1.0, 1.0, "III"),
    (0.9, 1.0, 1.0, "II"),
    (1.0, 0.3, 1.0, "II"),
    (1.0, -5.0, 1.0, "B"),
])  # fmt: skip
def test_regions_of_a_drop(share, turns, y, expected):
    crossings = np.array([[y], [0.1], [0.0]])
    assert region(Drop(1e-4, NO_TRACE, NO_TRACE, NO_TRACE, crossings, turns, share, 9.0)) == expected


def test_speeds_are_judged_by_the_thesis_step():
    assert [verdict(ours, 15.5) for ours in (15.5, 15.0, 16.0, 14.5, float("nan"))] == [
        YES,
        NEAR,
        NEAR,
        NO,
        NO,
    ]


def test_score_counts_what_is_met():
    found = Score(0.5, -1.0, 0.0, 0.0, 9.0, 0.5, float("nan"))
    assert (found.met, found.exact) == (5, 3)


def test_levels_go_both_ways():
    assert levels(8.0, 9.0) == [8.0, 8.5, 9.0]
    assert levels(9.0, 8.0) == [9.0, 8.5, 8.0]


def test_extremes_keep_the_sign_of_the_largest():
    assert extremes(np.array([[1.0, -3.0, 2.0, 2.5, 9.0]]), 2).tolist() == [[-3.0, 2.5]]


def test_results_are_kept_until_something_changes(tmp_path, monkeypatch):
    monkeypatch.setattr("benchmarks.thesis_cache.user_cache", lambda: tmp_path)  # not that of the kernels
    job = Job(drop_test, (model("thesis-ball"),))
    first = performed({"drop": job}, 1)["drop"]
    kept = list((tmp_path / "rigtwin" / "thesis").iterdir())
    assert [path.name for path in kept] == [f"{job.digest()}.pickle"]
    kept[0].touch()
    assert job.result(kept[0]).restitution == first.restitution
    assert Job(drop_test, (model("thesis-pinned"),)).digest() != job.digest()
