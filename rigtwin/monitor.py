"""What the terminal knows of a run: it listens to the summaries and keeps the newest of each."""

from collections import deque
from dataclasses import dataclass, field

from analysis.regime import named
from daq import keys
from daq.link import Inbox, Link, free_ports
from daq.messages_pb2 import Event, Status, Summary, TwinSummary
from daq.rig import Rig

CALM = ("waiting", "recording")  # states of a recorder that has nothing to complain of


@dataclass
class Picture:
    """The newest of everything that the status line shows. SI units."""

    time: float = 0.0  # s since sample 0
    speed_hz: float = 0.0
    radius: float = 0.0  # m, largest of the newest block, at the backup bearing
    contact_force: float = 0.0  # N, the twin's
    regime: str = ""
    recorded: int = 0  # samples
    lost: int = 0  # samples
    lag: float = 0.0  # s behind real time
    state: str = "starting"
    plan_over: str | None = None  # text of the plan's end
    aborted: bool = False  # the plan did not reach its end
    ended: bool = False  # the daq has said its last word
    recorder_alarm: str = ""


@dataclass
class Monitor:
    """Subscribes, lossily, to a run and folds what comes into a `Picture`."""

    rig: Rig
    picture: Picture = field(default_factory=Picture)
    news: deque[Event] = field(default_factory=deque)

    def __post_init__(self) -> None:
        self._inbox = Inbox(4096, "drop_oldest")
        self._readers = {
            keys.summary(self.rig.name): self._on_summary,
            keys.twin_summary(self.rig.name): self._on_twin_summary,
        }
        link = self.rig.link
        self.endpoint = f"tcp/{link.host}:{free_ports(1)[0]}"  # where the recorder tells how it is
        publishers = [link.endpoint(name) for name in ("daq", "twin", "operator")]
        self._link = Link(listen=[self.endpoint], connect=publishers)
        name = self.rig.name
        for key in (
            keys.summary(name),
            keys.twin_summary(name),
            keys.status(name, "*"),
            keys.event(name, "*"),
        ):
            self._link.subscribe(key, self._inbox)

    def update(self, seconds: float) -> bool:
        """Take in all that has arrived, waiting at most `seconds` for the first; return whether any has."""
        first = item = self._inbox.get(seconds)
        while item is not None:
            self._read(*item)
            item = self._inbox.get(0.0)
        return first is not None

    def close(self) -> None:
        """Leave the run."""
        self._inbox.close()
        self._link.close()

    def _read(self, key: str, payload: bytes) -> None:
        reader = self._readers.get(key)
        if reader is not None:
            reader(payload)
        elif key.endswith("/status"):
            self._on_status(Status.FromString(payload))
        elif key.endswith("/event"):
            self._on_event(Event.FromString(payload))

    def _on_summary(self, payload: bytes) -> None:
        summary = Summary.FromString(payload)
        picture = self.picture
        picture.time = (summary.first_sample + summary.n_samples) / self.rig.acquisition.rate
        picture.speed_hz = summary.speed_hz
        picture.radius = summary.radius_maximum

    def _on_twin_summary(self, payload: bytes) -> None:
        summary = TwinSummary.FromString(payload)
        self.picture.contact_force = summary.contact_force_maximum
        regime = named(summary.regime, summary.regime_confidence)
        self.picture.regime = regime if summary.valid else "not valid"

    def _on_status(self, status: Status) -> None:
        picture = self.picture
        if status.process in ("daq", "player"):
            picture.state, picture.lag = status.state, status.lag
        elif status.process == "recorder":
            picture.recorded, picture.lost = status.samples, status.lost
            picture.recorder_alarm = "" if status.state in CALM else status.state

    def _on_event(self, event: Event) -> None:
        if event.kind == "plan_end":
            self.picture.plan_over = event.text
            self.picture.aborted = event.details.get("completed") == "no"
        elif event.kind == "end" and event.source == "daq":
            self.picture.ended = True
        self.news.append(event)
