"""The other process of the link's tests: `python -m tests.daq.link_process ROLE PORT [ARGUMENTS]`.

It prints one line for each thing that the test waits for.
"""

import hashlib
import json
import os
import signal
import struct
import sys
import time
from itertools import pairwise

from daq.link import Inbox, Link

KEY = "rig/test/daq/block"
NUMBER = struct.Struct("<q")
END = -1


def payload_of(number: int) -> bytes:
    """Return a payload as large as a block, different for each number."""
    return NUMBER.pack(number) * 1400


def say(line: str) -> None:
    print(line, flush=True)


def summarise(numbers: list[int], digest: str) -> str:
    in_order = all(later == number + 1 for number, later in pairwise(numbers))
    first, last = (numbers[0], numbers[-1]) if numbers else (None, None)
    return json.dumps(
        {"first": first, "last": last, "count": len(numbers), "in_order": in_order, "digest": digest}
    )


def receive(port: int, recover: str, delay_ms: str, stop_at: str, lease_ms: str = "10000") -> None:
    """Receive until the end payload; sleep after each block, and stop (SIGSTOP) at one of them."""
    inbox = Inbox(50, "wait")
    numbers: list[int] = []
    digest = hashlib.sha256()
    with Link(connect=[f"tcp/127.0.0.1:{port}"], lease_ms=int(lease_ms)) as link:
        link.subscribe(KEY, inbox, recover=recover == "recover")
        link.announce("rig/test/receiver/alive")
        say("ready")
        while (message := inbox.get(60.0)) is not None:
            (number,) = NUMBER.unpack_from(message[1])
            if number == END:
                break
            numbers.append(number)
            digest.update(message[1])
            time.sleep(int(delay_ms) / 1000)
            if len(numbers) == int(stop_at):
                say("stopping")
                os.kill(os.getpid(), signal.SIGSTOP)
        inbox.close()
    say(summarise(numbers, digest.hexdigest()))


def answer(port: int) -> None:
    """Serve a command until killed."""
    with Link(listen=[f"tcp/127.0.0.1:{port}"]) as link:
        link.serve("rig/test/daq/command/echo", lambda request: request.reply(request.payload))
        link.announce("rig/test/daq/alive")
        say("ready")
        sys.stdin.read()


def greet(port: int) -> None:
    """Subscribe, then show itself; say the first message that comes."""
    inbox = Inbox(10, "wait")
    with Link(connect=[f"tcp/127.0.0.1:{port}"]) as link:
        link.subscribe(KEY, inbox)
        link.announce("rig/test/greeter/alive")
        message = inbox.get(20.0)
    say(message[1].decode() if message else "nothing came")


if __name__ == "__main__":
    {"receive": receive, "answer": answer, "greet": greet}[sys.argv[1]](int(sys.argv[2]), *sys.argv[3:])
