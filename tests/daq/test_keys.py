import pytest

from daq import keys, messages_pb2

EVERY_KEY = [
    keys.block("a"),
    keys.estimate("a"),
    keys.smoothed("a"),
    keys.truth("a"),
    keys.event("a", "daq"),
    keys.event("a", "twin"),
    keys.event("a", "operator"),
    keys.summary("a"),
    keys.channel_summary("a", "force_top"),
    keys.twin_summary("a"),
    keys.status("a", "recorder"),
    keys.lease("a"),
    keys.description("a"),
    keys.command("a", "arm"),
    keys.operator_command("a", "speed"),
]


@pytest.mark.parametrize("key", EVERY_KEY)
def test_every_key_has_one_row_in_the_service_table(key):
    row = keys.topic(key)
    assert keys.SCHEMAS[row.pattern] == row.message
    assert row.message == "" or row.message in messages_pb2.DESCRIPTOR.message_types_by_name


def test_the_table_has_no_row_without_a_key():
    assert {keys.topic(key).pattern for key in EVERY_KEY} == set(keys.SCHEMAS)


def test_only_lossless_topics_have_a_cache():
    for row in keys.TOPICS:
        assert (row.cache > 0) == (row.delivery == keys.Delivery.LOSSLESS)


def test_queries_are_not_recorded():
    recorded = keys.recorded_keys("a")
    assert keys.block("a") in recorded
    assert keys.status("a", "*") in recorded
    assert not any("command" in key or "description" in key for key in recorded)


def test_a_key_of_nothing_is_refused():
    for key in ("rig/a/daq/blocks", "rig/a/b/daq/block", "daq/block", "rig/a/alive"):
        with pytest.raises(KeyError, match="no key of a rig"):
            keys.topic(key)


@pytest.mark.parametrize("name", ["", "a/b", "a b", "**", "$*", "a?b", "#", "-a", "a\n"])
def test_a_name_that_cannot_stand_in_a_key_is_refused(name):
    with pytest.raises(ValueError, match="cannot be part of a key"):
        keys.block(name)


def test_the_process_of_a_key():
    assert keys.process_of(keys.alive("a", "recorder")) == "recorder"
    assert keys.process_of(keys.block("a")) == "daq"
    assert keys.everything("a") == "rig/a/**"
