"""An ear beside the daq: `python -m tests.end_to_end.listener RIG` prints what it hears, a line each."""

import sys

from daq import keys
from daq.link import Inbox, Link
from daq.messages import BlockStatus, decode_series
from daq.messages_pb2 import Event, Summary
from daq.rig import load_rig


def main(rig_path: str) -> None:
    """Print, until the end, `event KIND TIME EFFECT`, `speed SAMPLE HZ` and `late FIRST END`.

    TIME is s since 1970; EFFECT is the sample at which what the event tells takes effect, or None; `late`
    tells the samples of a block that the daq read later than it could.
    """
    rig = load_rig(rig_path)
    name = rig.name
    inbox = Inbox(1000, "wait")
    with Link(connect=[rig.link.endpoint("daq")]) as link:
        link.subscribe(keys.event(name, "daq"), inbox, recover=True)
        link.subscribe(keys.block(name), inbox, recover=True)
        link.subscribe(keys.summary(name), inbox)
        while (message := inbox.get(60.0)) is not None:
            key, payload = message
            if key == keys.event(name, "daq"):
                event = Event.FromString(payload)
                print("event", event.kind, event.timestamp, event.details.get("effect_sample"), flush=True)
                if event.kind == "end":
                    break
            elif key == keys.summary(name):
                summary = Summary.FromString(payload)
                print("speed", summary.first_sample + summary.n_samples, summary.speed_hz, flush=True)
            else:
                block = decode_series(payload)
                if block.status & BlockStatus.LATE:
                    end = block.first_sample + block.samples.shape[1]
                    print("late", block.first_sample, end, flush=True)
        inbox.close()


if __name__ == "__main__":
    main(sys.argv[1])
