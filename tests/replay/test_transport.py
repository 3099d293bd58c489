"""When messages are due, and what the commands to a replay do; on a clock made by hand."""

import math

import pytest

from daq.messages_pb2 import Command
from replay.transport import Transport


def told(transport: Transport, name: str, **values: float) -> str:
    """Return the answer to a command that is accepted."""
    answer = transport.obey(Command(name=name, values=values))
    assert answer.accepted, answer.text
    return answer.text


@pytest.mark.parametrize(("rate", "span"), [(0.01, 200.0), (1.0, 2.0), (4.0, 0.5), (math.inf, 0.0)])
def test_messages_are_due_at_the_rate(rate, span):
    transport = Transport(rate)
    assert transport.wait(3.0, now=100.0) == 0.0
    assert transport.wait(5.0, now=100.0) == pytest.approx(span)
    assert transport.wait(5.0, now=100.0 + span) == pytest.approx(0.0)


def test_a_change_of_rate_counts_from_where_the_replay_is():
    transport = Transport(1.0)
    transport.wait(0.0, now=10.0)
    assert told(transport, "rate", times=0.5) == "at 0.5 times real time"
    assert transport.wait(1.0, now=11.0) == 0.0
    assert transport.wait(2.0, now=11.0) == pytest.approx(2.0)


def test_a_pause_shifts_all_that_follows():
    transport = Transport(1.0)
    transport.wait(0.0, now=10.0)
    transport.passed(1.0, is_block=True)
    assert told(transport, "pause") == "paused at 1.000 s"
    assert transport.state == "paused"
    assert transport.wait(1.5, now=11.0) > 60.0
    told(transport, "resume")
    assert transport.wait(1.5, now=50.0) == 0.0
    assert transport.wait(2.5, now=50.0) == pytest.approx(1.0)


def test_steps_let_so_many_blocks_through():
    transport = Transport(1.0)
    told(transport, "step", blocks=2.0)
    for is_block in (True, False, True):
        assert transport.wait(0.0, now=0.0) == 0.0
        transport.passed(0.0, is_block=is_block)
    assert transport.wait(0.0, now=0.0) > 60.0


def test_a_seek_is_absolute_or_from_here_and_stays_in_the_recording():
    transport = Transport(1.0)
    transport.duration = 20.0
    transport.passed(7.0, is_block=True)
    for values, target in (({"seconds": 12.5}, 12.5), ({"by": -5.0}, 7.5), ({"by": 99.0}, 20.0)):
        told(transport, "seek", **values)
        assert transport.target == target
    transport.go_on_from(20.0)
    told(transport, "seek", by=-50.0)
    assert transport.target == 0.0


def test_a_seek_in_a_pause_shows_the_block_that_is_there():
    transport = Transport(1.0)
    told(transport, "pause")
    told(transport, "seek", seconds=2.0)
    transport.go_on_from(2.0)
    assert transport.wait(2.0, now=0.0) == 0.0
    transport.passed(2.0, is_block=True)
    assert transport.wait(2.01, now=0.0) > 60.0


@pytest.mark.parametrize(
    ("name", "values", "words"),
    [
        ("rate", {"times": 0.001}, "0.01 or more times real time, or max, not 0.001"),
        ("rate", {"times": math.nan}, "not nan"),
        ("rate", {}, "not nan"),
        ("seek", {"seconds": 21.0}, "from 0 to 20.000 s, the recording's end, not 21 s"),
        ("seek", {"seconds": -1.0}, "not -1 s"),
        ("seek", {"by": math.nan}, "not nan"),
        ("seek", {}, "not nan"),
        ("step", {"blocks": 0.0}, "a whole number of blocks from 1 on, not 0"),
        ("step", {"blocks": 1.5}, "not 1.5"),
        ("step", {"blocks": math.inf}, "not inf"),
    ],
)
def test_what_makes_no_sense_is_refused(name, values, words):
    transport = Transport(1.0)
    transport.duration = 20.0
    answer = transport.obey(Command(name=name, values=values))
    assert not answer.accepted
    assert words in answer.text
    assert transport.rate == 1.0
    assert transport.target is None
    assert not transport.paused


def test_a_loop_is_told_by_the_state():
    transport = Transport(1.0)
    told(transport, "loop", on=1.0)
    assert transport.state == "playing in a loop"
    told(transport, "loop", on=0.0)
    assert transport.state == "playing"
