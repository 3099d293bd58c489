"""A real acquisition process and a client that hears and commands it over the real link."""

import os
import subprocess
import sys
import threading
import time
from pathlib import Path

from daq import keys
from daq.link import Inbox, Link, free_ports
from daq.messages import decode_series
from daq.messages_pb2 import Answer, Command, Event, Status
from daq.rig import load_rig, with_ports

PATIENCE = 60.0
REPOSITORY = Path(__file__).parents[2]
RENEWAL = 0.02


def until(condition, seconds=PATIENCE):
    """Wait for the condition; fail when it does not come."""
    deadline = time.monotonic() + seconds
    while not (result := condition()):
        assert time.monotonic() < deadline, "what was waited for did not come"
        time.sleep(0.005)
    return result


PATIENT = "command.lease=1"  # s: a busy machine may hold an operator up for longer than the shipped 0.1 s


class DaqProcess:
    """`python -m daq acquire` as a child; `rig` has the ports that it listens on."""

    def __init__(self, folder, *arguments, overrides=(), rig=None, packages=None):
        self.rig = rig or with_ports(load_rig("thesis-ball", [PATIENT, *overrides]), free_ports(4))
        path = folder / "rig.toml"
        path.write_text(self.rig.toml)
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-m", "daq", "acquire", "--rig", str(path), *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(map(str, filter(None, (REPOSITORY, packages))))},
        )

    def wait_until_ready(self):
        assert self.process.stdout.readline() == "ready\n", self.process.stderr.read()
        return self

    def finish(self):
        """Wait for the end: (exit code, what it said on standard error)."""
        if not self.process.stdin.closed:
            self.process.stdin.close()
        code = self.process.wait(PATIENCE)
        return code, self.process.stderr.read()

    def close(self):
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait(PATIENCE)
        for pipe in (self.process.stdin, self.process.stdout, self.process.stderr):
            pipe.close()


class Client:
    """Hears all that a daq publishes, losslessly, as a recorder would, and sends it commands."""

    def __init__(self, rig):
        self.rig = rig
        self.blocks, self.events, self.statuses = [], [], []
        self.data = Link(connect=[rig.link.endpoint("daq")])
        self.control = Link(connect=[rig.link.endpoint("control")], lease_ms=200)
        self._inbox = Inbox(10_000, "wait")
        self._lease = ""
        self._renewing = threading.Event()
        self._ended = threading.Event()
        self._lease_publisher = self.control.publish(keys.lease(rig.name))
        self.data.subscribe(keys.block(rig.name), self._inbox, recover=True)
        self.data.subscribe(keys.event(rig.name, "daq"), self._inbox, recover=True)
        self.data.subscribe(keys.status(rig.name, "daq"), self._inbox)
        self._threads = [threading.Thread(target=self._hear), threading.Thread(target=self._renew)]
        for thread in self._threads:
            thread.start()
        self._announced = self.data.announce(keys.alive(rig.name, "recorder"))

    def close(self):
        self._ended.set()
        self._renewing.set()
        self._inbox.close()
        for thread in self._threads:
            thread.join(PATIENCE)
        self.control.close()
        self.data.close()

    def ask(self, name, who="anna", lease=None, **given):
        texts = {key: value for key, value in given.items() if isinstance(value, str)}
        values = {key: value for key, value in given.items() if key not in texts}
        lease = self._lease if lease is None else lease
        command = Command(name=name, who=who, lease=lease, values=values, texts=texts)
        payload = self.control.ask(keys.command(self.rig.name, name), command.SerializeToString(), 10.0)
        return Answer.FromString(payload)

    def arm(self):
        """Arm the rig and renew the lease from now on."""
        answer = self.ask("arm")
        assert answer.accepted, answer.text
        self._lease = answer.lease
        self._renewing.set()
        return answer

    def fall_silent(self):
        """Renew the lease no longer."""
        self._renewing.clear()

    def hear_the_end(self):
        """Wait for the end and all that came before it, then let the daq go; return the number of samples."""
        samples = int(self.event("end").details["samples"])
        until(lambda: self.spans()[-1][1] == samples)
        self._announced.close()
        return samples

    def kinds(self):
        return [event.kind for event in list(self.events)]

    def event(self, kind):
        """Wait for an event of this kind and return it."""
        return until(lambda: next((event for event in list(self.events) if event.kind == kind), None))

    def state(self):
        return self.statuses[-1].state if self.statuses else ""

    def spans(self):
        """First sample and one past the last, of every block that came, in order of arrival."""
        series = [decode_series(payload) for payload in list(self.blocks)]
        return [(block.first_sample, block.first_sample + block.samples.shape[1]) for block in series]

    def channel(self, name):
        """Newest value of a channel."""
        block = decode_series(self.blocks[-1])
        return float(block.samples[block.names.index(name), -1])

    def _hear(self):
        while not self._ended.is_set():
            item = self._inbox.get(0.2)
            if item is None:
                continue
            key, payload = item
            if key == keys.block(self.rig.name):
                self.blocks.append(payload)
            elif key == keys.event(self.rig.name, "daq"):
                self.events.append(Event.FromString(payload))
            else:
                self.statuses.append(Status.FromString(payload))

    def _renew(self):
        while not self._ended.is_set():
            self._renewing.wait(PATIENCE)
            if self._lease and not self._ended.is_set():
                self._lease_publisher.put(self._lease.encode())
            time.sleep(RENEWAL)
