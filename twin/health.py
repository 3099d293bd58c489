"""Which sensor or which part of the rig has a fault, by all the watches together."""

from daq.messages import Series
from daq.rig import Rig
from twin.channel_watch import ChannelWatch
from twin.estimate import Estimated
from twin.fault import Fault
from twin.layout import Tuning
from twin.probe_watch import ProbeWatch
from twin.rig_watch import RigWatch
from twin.transducer_watch import TransducerWatch
from twin.windows import Window, Windows


class Health:
    """Takes in every block with its estimate and returns the faults that they prove, each once.

    A fault that one watch has found changes what the others see: then all learn anew what is usual, and
    what was found before the measurement is whole again is not judged.

    Args:
        rig: with a model and what the observer needs.
        tuning: the noise that the observer expects.
    """

    def __init__(self, rig: Rig, tuning: Tuning) -> None:
        noises = {"displacement": tuning.displacement_noise, "force": tuning.force_noise}
        self._windows = Windows(rig)
        self._channels = ChannelWatch(rig, noises)
        self._watches = (
            (ProbeWatch(rig, tuning.displacement_noise), {"displacement"}),
            (TransducerWatch(rig), {"force"}),
            (RigWatch(rig), {"displacement", "force"}),
        )
        self._told: set[tuple[str, str]] = set()
        self._quantities = {channel.name: channel.quantity for channel in rig.channels}
        self._doubted: set[str] = set()

    def add(self, block: Series, estimated: Estimated) -> list[Fault]:
        """Take in the next block with its estimate."""
        found = self._channels.add(block)
        window = self._windows.add(block, estimated)
        if not self._channels.healthy:
            self._windows.clear()
            self._forget()
        elif window is not None and window.finite:
            found += self._judge(window)
        return [fault for fault in found if self._is_news(fault)]

    def believe(self, channel: str, good: bool) -> None:
        """Take note that a sensor is left out (not `good`) or taken in again, when its faults are news again.

        While one is left out, watches that need all sensors of its quantity do not judge.
        """
        if not good:
            self._doubted.add(channel)
            return
        self._doubted.discard(channel)
        self._told = {(kind, name) for kind, name in self._told if name != channel}
        self._channels.forgive(channel)
        self._forget()

    def _judge(self, window: Window) -> list[Fault]:
        """Return what a window proves."""
        if noisy := self._channels.judge(window):
            return noisy
        doubted = {self._quantities[name] for name in self._doubted}
        for watch, needs in self._watches:
            if not needs & doubted and (found := watch.add(window)):
                self._forget()
                return found
        return []

    def _forget(self) -> None:
        for watch, _ in self._watches:
            watch.forget()

    def _is_news(self, fault: Fault) -> bool:
        """Tell whether a fault has not been told before."""
        name = fault.kind, fault.channel
        if name in self._told:
            return False
        self._told.add(name)
        return True
