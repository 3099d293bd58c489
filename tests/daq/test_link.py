import errno
import hashlib
import json
import logging
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from queue import SimpleQueue

import pytest

from daq.link import (
    Inbox,
    Link,
    LinkError,
    NoAnswer,
    NoAnswerInTime,
    Refused,
    Request,
    free_ports,
)
from daq.link.recovery import STAMP, stamp_of
from tests.daq.link_process import END, KEY, NUMBER, payload_of

ROOT = Path(__file__).parents[2]
PATIENCE = 30.0
COMMAND = "rig/test/daq/command/echo"


@pytest.fixture
def port():
    return free_ports(1)[0]


@pytest.fixture
def links(port):
    """A listening link and one that is connected to it."""
    with Link(listen=[endpoint(port)]) as server, Link(connect=[endpoint(port)]) as client:
        server.announce("rig/test/server/alive")
        wait_until(lambda: client.alive("rig/test/server/alive"))
        yield server, client


@pytest.fixture
def start():
    """Start the other process; all are killed after the test."""
    processes = []

    def start_process(*arguments):
        process = subprocess.Popen(
            [sys.executable, "-m", "tests.daq.link_process", *map(str, arguments)],
            cwd=ROOT,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        processes.append(process)
        return process

    yield start_process
    for process in processes:
        process.kill()
        process.communicate()


def endpoint(port):
    return f"tcp/127.0.0.1:{port}"


def wait_until(condition):
    give_up = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < give_up, "it did not happen"
        time.sleep(0.005)


def publish_range(publisher, numbers, period=0.0):
    for number in numbers:
        publisher.put(payload_of(number))
        if period:
            time.sleep(period)


def digest_of(numbers):
    digest = hashlib.sha256()
    for number in numbers:
        digest.update(payload_of(number))
    return digest.hexdigest()


def all_of(count, first=0):
    numbers = range(first, count)
    return {
        "first": first,
        "last": count - 1,
        "count": len(numbers),
        "in_order": True,
        "digest": digest_of(numbers),
    }


def numbers_in(inbox, count):
    """Get so many messages and return their numbers."""
    numbers = []
    for _ in range(count):
        message = inbox.get(PATIENCE)
        assert message is not None, f"only {len(numbers)} of {count} came"
        numbers.append(NUMBER.unpack_from(message[1])[0])
    return numbers


def sockets_of_this_process():
    """Return (file, local address, state) of each IP socket that this process has open, in hexadecimal."""
    inodes = set()
    for descriptor in Path("/proc/self/fd").iterdir():
        try:
            target = str(descriptor.readlink())
        except FileNotFoundError:
            continue
        if target.startswith("socket:["):
            inodes.add(target[8:-1])
    sockets = []
    for name in ("tcp", "tcp6", "udp", "udp6"):
        table = Path("/proc/self/net") / name
        for line in table.read_text().splitlines()[1:] if table.exists() else ():
            fields = line.split()
            if fields[9] in inodes:
                sockets.append((name, fields[1], fields[3]))
    return sockets


@pytest.mark.skipif(not Path("/proc/self/net/tcp").exists(), reason="needs Linux' /proc")
class TestSockets:
    LISTENING = "0A"

    def test_a_link_without_endpoints_opens_no_socket(self):
        with Link():
            assert sockets_of_this_process() == []

    def test_a_link_listens_where_it_is_told_and_nowhere_else(self, port):
        with Link(listen=[endpoint(port)]):
            assert sockets_of_this_process() == [("tcp", f"0100007F:{port:04X}", self.LISTENING)]

    def test_a_connecting_link_does_not_listen(self, links):
        listening = [each for each in sockets_of_this_process() if each[2] == self.LISTENING]
        assert len(listening) == 1
        assert not [each for each in sockets_of_this_process() if each[0].startswith("udp")]


class TestEndpoints:
    def test_a_port_in_use_is_named_with_the_remedy(self, port):
        with (
            Link(listen=[endpoint(port)]),
            pytest.raises(LinkError, match=rf"^tcp/127\.0\.0\.1:{port} is in use.*take another port$"),
        ):
            Link(listen=[endpoint(port)])

    @pytest.mark.parametrize("wrong", ["127.0.0.1:7447", "tcp/127.0.0.1", "tcp/:7447", "7447", ""])
    def test_a_malformed_endpoint_is_named(self, wrong):
        with pytest.raises(LinkError, match=r"expected protocol/host:port"):
            Link(connect=[wrong])

    def test_an_unknown_protocol_is_named_in_one_line(self):
        with pytest.raises(LinkError, match=r"xyz") as caught:
            Link(listen=["xyz/127.0.0.1:7447"])
        assert "\n" not in str(caught.value)

    def test_an_address_of_another_machine_is_named(self):
        with pytest.raises(LinkError, match=r"no address of this machine"):
            Link(listen=["tcp/192.0.2.1:7447"])

    def test_free_ports_differ_and_can_be_listened_on(self):
        ports = free_ports(5)
        assert len(set(ports)) == 5
        with Link(listen=[endpoint(each) for each in ports]):
            pass

    @pytest.mark.skipif(sys.platform != "linux", reason="held on Linux only")
    def test_a_free_port_is_kept_from_others_until_it_is_listened_on(self):
        (port,) = free_ports(1)
        with socket.socket() as other, pytest.raises(OSError, match="in use"):
            other.bind(("127.0.0.1", port))  # as another process's search for free ports would
        with socket.socket() as caller:
            assert caller.connect_ex(("127.0.0.1", port)) == errno.ECONNREFUSED
        with Link(listen=[endpoint(port)]), pytest.raises(LinkError, match="in use"):
            Link(listen=[endpoint(port)])

    def test_who_connects_first_finds_who_listens_later(self, port):
        inbox = Inbox(10, "wait")
        with Link(connect=[endpoint(port)]) as client:
            client.subscribe(KEY, inbox)
            client.announce("rig/test/client/alive")
            for payload in (b"first life", b"second life"):
                with Link(listen=[endpoint(port)]) as server:
                    wait_until(lambda server=server: server.alive("rig/test/client/alive"))
                    server.publish(KEY).put(payload)
                    assert inbox.get(PATIENCE) == (KEY, payload)


class TestPublishing:
    @pytest.mark.parametrize("cache", [0, 10])
    def test_payloads_arrive_as_they_were_sent(self, links, cache):
        server, client = links
        inbox = Inbox(10, "wait")
        client.subscribe("rig/test/**", inbox, recover=cache > 0)
        client.announce("rig/test/ready")
        wait_until(lambda: server.alive("rig/test/ready"))
        sent = [b"", b"\x00\xff", os.urandom(300_000 if cache else 20_000)]
        publisher = server.publish(KEY, cache=cache)
        for payload in sent:
            publisher.put(payload)
        assert [inbox.get(PATIENCE) for _ in sent] == [(KEY, payload) for payload in sent]

    def test_a_function_can_take_the_messages(self, links):
        server, client = links
        taken = SimpleQueue()
        client.subscribe(KEY, lambda key, payload: taken.put((key, payload)))
        publisher = server.publish(KEY)
        wait_until(lambda: publisher.put(b"x") or not taken.empty())
        assert taken.get() == (KEY, b"x")

    def test_a_closed_subscription_takes_nothing_more(self, links):
        server, client = links
        inbox = Inbox(10, "wait")
        subscription = client.subscribe(KEY, inbox)
        other = Inbox(10, "wait")
        client.subscribe("rig/test/other", other)
        publisher, other_publisher = server.publish(KEY), server.publish("rig/test/other")
        wait_until(lambda: other_publisher.put(b"") or other.get(0.05))
        subscription.close()
        subscription.close()
        publisher.put(b"late")
        other_publisher.put(b"")
        assert other.get(PATIENCE)
        assert inbox.get(0.0) is None

    def test_publishing_on_a_closed_link_is_an_error(self, port):
        link = Link(listen=[endpoint(port)])
        plain, caching = link.publish(KEY), link.publish(KEY, cache=3)
        link.close()
        link.close()
        for publisher in (plain, caching):
            with pytest.raises(LinkError, match="closed"):
                publisher.put(b"x")

    def test_misuse_is_refused(self, port):
        with Link(listen=[endpoint(port)]) as link:
            with pytest.raises(ValueError, match="wait_for_room"):
                link.publish(KEY, wait=True)
            with pytest.raises(ValueError, match="needs an Inbox"):
                link.subscribe(KEY, print, recover=True)

    def test_a_full_inbox_drops_what_cannot_be_recovered_and_counts_it(self, links):
        server, client = links
        inbox = Inbox(3, "wait")
        client.subscribe(KEY, inbox)
        publisher = server.publish(KEY)
        wait_until(lambda: publisher.put(payload_of(0)) or inbox.dropped >= 5)
        assert numbers_in(inbox, 3) == [0, 0, 0]


class TestDamage:
    """zenoh may deliver a message whose end belongs to others; here one is made on purpose."""

    def damage(self, publisher, payload, stamp):
        publisher._entities[0].put(payload[:-1] + b"x", attachment=STAMP.pack(*stamp))

    def test_a_damaged_message_is_fetched_whole(self, links):
        server, client = links
        inbox = Inbox(10, "wait")
        client.subscribe(KEY, inbox, recover=True)
        publisher = server.publish(KEY, cache=10)
        publisher.put(payload_of(0))
        stamp = publisher._cache.stamp(payload_of(1))
        self.damage(publisher, payload_of(1), stamp)
        publisher._cache.keep(payload_of(1), stamp)
        publisher.put(payload_of(2))
        assert [inbox.get(PATIENCE) for _ in range(3)] == [(KEY, payload_of(number)) for number in range(3)]

    def test_a_damaged_message_that_nobody_keeps_is_dropped(self, links):
        server, client = links
        inbox, taken = Inbox(10, "drop_oldest"), SimpleQueue()
        client.subscribe(KEY, inbox)
        client.subscribe(KEY, lambda key, payload: taken.put(payload))
        publisher = server.publish(KEY)
        wait_until(lambda: self.damage(publisher, b"whole", stamp_of(b"whole")) or inbox.dropped)
        publisher.put(b"whole")
        assert inbox.get(PATIENCE) == (KEY, b"whole")
        assert taken.get(timeout=PATIENCE) == b"whole"

    def test_messages_of_other_programs_are_taken_as_they_are(self, links):
        server, client = links
        inbox = Inbox(10, "wait")
        client.subscribe(KEY, inbox, recover=True)
        wait_until(lambda: server._session.put(KEY, b"theirs", attachment=b"?") or inbox.fill)
        assert inbox.get(PATIENCE) == (KEY, b"theirs")


class TestRecovery:
    def test_a_late_subscriber_gets_what_was_published_before(self, links):
        server, client = links
        publisher = server.publish(KEY, cache=100)
        publish_range(publisher, range(60))
        inbox = Inbox(10, "wait")
        client.subscribe(KEY, inbox, recover=True)
        assert numbers_in(inbox, 60) == list(range(60))
        publish_range(publisher, range(60, 100))
        assert numbers_in(inbox, 40) == list(range(60, 100))

    def test_only_what_the_cache_holds_can_be_recovered(self, links):
        server, client = links
        publish_range(server.publish(KEY, cache=20), range(60))
        inbox = Inbox(10, "wait")
        client.subscribe(KEY, inbox, recover=True)
        assert numbers_in(inbox, 20) == list(range(40, 60))

    def test_a_full_inbox_holds_nobody_up_and_loses_nothing(self, links):
        server, client = links
        inbox = Inbox(5, "wait")
        client.subscribe("rig/test/**", inbox, recover=True)
        server.serve(COMMAND, lambda request: request.reply(request.payload))
        publisher = server.publish(KEY, cache=500)
        publish_range(publisher, range(400))
        wait_until(lambda: client.ask(COMMAND, b"x") == b"x")
        assert numbers_in(inbox, 400) == list(range(400))
        assert inbox.get(0.3) is None

    @pytest.mark.parametrize("when_full", ["wait", "drop_oldest"])
    def test_streams_of_several_keys_are_recovered_into_one_inbox(self, links, when_full):
        server, client = links
        inbox = Inbox(3, when_full)
        keys = [f"rig/test/twin/{number}" for number in range(3)]
        publishers = [server.publish(key, cache=100) for key in keys]
        plain = server.publish("rig/test/twin/plain")
        client.subscribe("rig/test/twin/*", inbox, recover=True)
        for number in range(50):
            for publisher in (*publishers, plain):
                publisher.put(payload_of(number))
        received = {key: [] for key in keys}
        while any(len(received[key]) < 50 for key in keys):
            key, payload = inbox.get(PATIENCE)
            received.setdefault(key, []).append(NUMBER.unpack_from(payload)[0])
        assert {key: received[key] for key in keys} == {key: list(range(50)) for key in keys}

    def test_a_publisher_that_starts_anew_is_a_new_stream(self, links):
        server, client = links
        inbox = Inbox(10, "wait")
        client.subscribe(KEY, inbox, recover=True)
        for _ in range(2):
            publisher = server.publish(KEY, cache=10)
            publish_range(publisher, range(5))
            assert numbers_in(inbox, 5) == list(range(5))
            publisher.close()

    def test_a_gap_that_nobody_can_fill_is_passed_over(self, links):
        server, client = links
        inbox = Inbox(2, "wait")
        client.subscribe(KEY, inbox, recover=True)
        publisher = server.publish(KEY, cache=5)
        wait_until(lambda: publisher.put(payload_of(0)) or inbox.fill == 1.0)
        publish_range(publisher, range(100, 200))
        numbers = numbers_in(inbox, 2)
        while numbers[-1] < 199:
            numbers += numbers_in(inbox, 1)
        received = [number for number in numbers if number >= 100]
        assert received == sorted(set(received))
        assert received[-5:] == list(range(195, 200))

    @pytest.mark.parametrize("period", [0.003, pytest.param(0.01, marks=pytest.mark.slow)])
    def test_a_process_stopped_for_long_misses_nothing(self, port, start, period):
        """900 messages are far more than the system's buffers hold; 9 s of them last just below its lease."""
        with Link(listen=[endpoint(port)]) as link:
            publisher = link.publish(KEY, cache=3000)
            receiver = start("receive", port, "recover", 0, 100)
            assert receiver.stdout.readline() == "ready\n"
            publish_range(publisher, range(100), period=period)
            assert receiver.stdout.readline() == "stopping\n"
            publish_range(publisher, range(100, 1000), period=period)
            os.kill(receiver.pid, signal.SIGCONT)
            publish_range(publisher, range(1000, 1100), period=period)
            publisher.put(NUMBER.pack(END))
            assert json.loads(receiver.stdout.readline()) == all_of(1100)

    def test_a_process_stopped_until_its_link_is_given_up_misses_nothing(self, port, start):
        gone = SimpleQueue()
        with Link(listen=[endpoint(port)]) as link:
            publisher = link.publish(KEY, cache=3000)
            link.watch("rig/test/receiver/alive", lambda key, alive: alive or gone.put(key))
            receiver = start("receive", port, "recover", 0, 50, 300)
            assert receiver.stdout.readline() == "ready\n"
            publish_range(publisher, range(50), period=0.002)
            assert receiver.stdout.readline() == "stopping\n"
            publish_range(publisher, range(50, 100), period=0.002)
            gone.get(timeout=PATIENCE)
            publish_range(publisher, range(100, 400), period=0.002)
            os.kill(receiver.pid, signal.SIGCONT)
            publish_range(publisher, range(400, 500), period=0.002)
            publisher.put(NUMBER.pack(END))
            assert json.loads(receiver.stdout.readline()) == all_of(500)

    def test_a_killed_process_gets_the_history_when_it_comes_back(self, port, start):
        with Link(listen=[endpoint(port)]) as link:
            publisher = link.publish(KEY, cache=3000)
            first = start("receive", port, "recover", 0, -1)
            assert first.stdout.readline() == "ready\n"
            publish_range(publisher, range(200), period=0.002)
            first.kill()
            publish_range(publisher, range(200, 400), period=0.002)
            second = start("receive", port, "recover", 0, -1)
            assert second.stdout.readline() == "ready\n"
            publish_range(publisher, range(400, 600), period=0.002)
            publisher.put(NUMBER.pack(END))
            assert json.loads(second.stdout.readline()) == all_of(600)

    def test_a_process_that_stops_while_it_recovers_does_not_hold_the_publisher_up(self, port, start):
        """With zenoh's own cache the longest put takes 5 s here, the whole time-out of a stuck link."""
        with Link(listen=[endpoint(port)]) as link:
            publisher = link.publish(KEY, cache=3000)
            publish_range(publisher, range(2500))
            receiver = start("receive", port, "recover", 0, 50)
            assert receiver.stdout.readline() == "ready\n"
            assert receiver.stdout.readline() == "stopping\n"
            longest = 0.0
            for number in range(2500, 2900):
                started = time.monotonic()
                publisher.put(payload_of(number))
                longest = max(longest, time.monotonic() - started)
                time.sleep(0.002)
            assert longest < 2.0
            os.kill(receiver.pid, signal.SIGCONT)
            publisher.put(NUMBER.pack(END))
            assert json.loads(receiver.stdout.readline()) == all_of(2900)


class TestWaiting:
    def test_a_slow_subscriber_gets_everything_from_a_publisher_that_waits(self, port, start):
        with Link(listen=[endpoint(port)], wait_for_room=True) as link:
            publisher = link.publish(KEY, wait=True)
            receiver = start("receive", port, "plain", 2, -1)
            assert receiver.stdout.readline() == "ready\n"
            wait_until(lambda: link.alive("rig/test/receiver/alive"))
            publish_range(publisher, range(1000))
            publisher.put(NUMBER.pack(END))
            assert json.loads(receiver.stdout.readline()) == all_of(1000)

    def test_closing_a_link_releases_a_callback_that_waits_for_room(self, port):
        inbox = Inbox(1, "wait")
        with Link(listen=[endpoint(port)], wait_for_room=True) as server:
            client = Link(connect=[endpoint(port)])
            client.subscribe(KEY, inbox)
            publisher = server.publish(KEY, wait=True)
            wait_until(lambda: publisher.put(payload_of(0)) or inbox.fill == 1.0)
            publish_range(publisher, range(3))
            closing = threading.Thread(target=client.close)
            closing.start()
            closing.join(PATIENCE)
            assert not closing.is_alive()

    def test_commands_pass_a_data_link_that_is_stuck(self, port):
        control_port = free_ports(1)[0]
        inbox = Inbox(1, "wait")
        with (
            Link(listen=[endpoint(port)], wait_for_room=True) as data,
            Link(listen=[endpoint(control_port)]) as control,
            Link(connect=[endpoint(port)]) as slow,
            Link(connect=[endpoint(control_port)]) as operator,
        ):
            control.serve(COMMAND, lambda request: request.reply(request.payload))
            slow.subscribe(KEY, inbox)
            publisher = data.publish(KEY, wait=True)
            wait_until(lambda: publisher.put(payload_of(0)) or inbox.fill == 1.0)
            publish_range(publisher, range(50))
            answers = [operator.ask(COMMAND, str(number).encode()) for number in range(50)]
            assert answers == [str(number).encode() for number in range(50)]
            inbox.close()


class TestQueries:
    def test_an_answer_comes_back(self, links):
        server, client = links
        server.serve(COMMAND, lambda request: request.reply(request.payload + b"!"))
        wait_until(lambda: answer_or_none(client, COMMAND) is not None)
        assert client.ask(COMMAND, b"hello") == b"hello!"
        assert client.ask(COMMAND, b"") == b"!"

    def test_another_thread_may_answer(self, links):
        server, client = links
        requests: SimpleQueue[Request | None] = SimpleQueue()
        server.serve(COMMAND, requests.put)

        def work():
            while (request := requests.get()) is not None:
                request.reply(request.key.encode())
                request.reply(b"a second answer is not sent")

        worker = threading.Thread(target=work)
        worker.start()
        wait_until(lambda: answer_or_none(client, COMMAND) == COMMAND.encode())
        requests.put(None)
        worker.join(PATIENCE)

    def test_nobody_serves(self, links):
        _, client = links
        with pytest.raises(NoAnswer, match="nobody answers on rig/test/daq/command/echo"):
            client.ask(COMMAND, b"")

    def test_no_answer_in_time(self, links):
        server, client = links
        kept = []
        server.serve(COMMAND, kept.append)
        wait_until(lambda: answer_or_none(client, COMMAND) is None and kept)
        with pytest.raises(NoAnswerInTime, match=r"within 0\.1 s"):
            client.ask(COMMAND, b"", timeout=0.1)

    def test_a_request_thrown_away_is_no_answer(self, links):
        server, client = links
        seen = []
        server.serve(COMMAND, lambda request: seen.append(request.key))
        wait_until(lambda: answer_or_none(client, COMMAND) is None and seen)
        with pytest.raises(NoAnswer):
            client.ask(COMMAND, b"")

    @pytest.mark.parametrize("selector", ["rig/test/**", "rig/test/daq/command/*", f"{COMMAND}?speed=3"])
    def test_a_selector_that_is_not_the_exact_key_is_refused(self, links, selector):
        server, client = links
        called = []
        server.serve(COMMAND, lambda request: called.append(request) or request.reply(b"done"))
        wait_until(lambda: answer_or_none(client, COMMAND) == b"done")
        called.clear()
        with pytest.raises(Refused, match="is not the exact key"):
            client.ask(selector, b"")
        assert called == []

    def test_a_handler_that_fails_is_a_refusal_and_is_logged(self, links, caplog):
        server, client = links

        def fail(request):
            raise ValueError("no such speed")

        server.serve(COMMAND, fail)
        wait_until(
            lambda: answer_or_none(client, COMMAND) == "rig/test/daq/command/echo failed: no such speed"
        )
        wait_until(lambda: any(record.levelno == logging.ERROR for record in caplog.records))

    def test_a_stopped_process_does_not_answer_in_time_and_a_killed_one_is_nobody(self, port, start):
        server = start("answer", port)
        assert server.stdout.readline() == "ready\n"
        with Link(connect=[endpoint(port)]) as client:
            wait_until(lambda: answer_or_none(client, COMMAND) == b"")
            os.kill(server.pid, signal.SIGSTOP)
            os.waitpid(server.pid, os.WUNTRACED)
            with pytest.raises((NoAnswerInTime, NoAnswer)):
                client.ask(COMMAND, b"", timeout=0.1)
            os.kill(server.pid, signal.SIGCONT)
            wait_until(lambda: answer_or_none(client, COMMAND) == b"")
            server.kill()
            wait_until(lambda: raises_no_answer(client, COMMAND))

    def test_asking_on_a_closed_link_is_an_error(self, port):
        link = Link(listen=[endpoint(port)])
        link.close()
        with pytest.raises(LinkError, match="closed"):
            link.ask(COMMAND, b"")


class TestPresence:
    def test_who_is_announced_has_subscribed(self, port, start):
        seen = SimpleQueue()
        with Link(listen=[endpoint(port)]) as link:
            publisher = link.publish(KEY)
            link.watch("rig/test/*/alive", lambda key, alive: seen.put((key, alive)))
            greeter = start("greet", port)
            assert seen.get(timeout=PATIENCE) == ("rig/test/greeter/alive", True)
            publisher.put(b"welcome")
            assert greeter.stdout.readline() == "welcome\n"
            assert seen.get(timeout=PATIENCE) == ("rig/test/greeter/alive", False)

    def test_a_killed_process_is_noticed(self, port, start):
        seen = SimpleQueue()
        server = start("answer", port)
        assert server.stdout.readline() == "ready\n"
        with Link(connect=[endpoint(port)]) as link:
            link.watch("rig/test/daq/alive", lambda key, alive: seen.put(alive))
            assert seen.get(timeout=PATIENCE)
            assert link.alive("rig/test/*/alive") == {"rig/test/daq/alive"}
            server.kill()
            assert not seen.get(timeout=PATIENCE)
            assert link.alive("rig/test/*/alive") == set()

    def test_an_announcement_can_be_taken_back(self, links):
        server, client = links
        seen = SimpleQueue()
        client.watch("rig/test/recorder/alive", lambda key, alive: seen.put(alive))
        announcement = server.announce("rig/test/recorder/alive")
        assert seen.get(timeout=PATIENCE)
        announcement.close()
        assert not seen.get(timeout=PATIENCE)


def answer_or_none(link, key):
    """Return the answer or the refusal's text; None where there is neither."""
    try:
        return link.ask(key, b"", timeout=0.2)
    except Refused as refusal:
        return str(refusal)
    except LinkError:
        return None


def raises_no_answer(link, key):
    try:
        link.ask(key, b"", timeout=0.2)
    except NoAnswer:
        return True
    except LinkError:
        return False
    return False
