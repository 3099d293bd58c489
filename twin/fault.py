"""What the health watch finds: a fault of a sensor or of the rig."""

from typing import NamedTuple


class Fault(NamedTuple):
    """A fault, as far as the measurement tells."""

    kind: str  # drift, gain, skew, runout, lost, stuck, noise; unbalance, magnet, clearance, pin
    channel: str  # of the sensor; empty: it is the rig's
    size: float  # in `unit`
    unit: str
    confidence: float  # 0 to 1, among the faults that are known
    onset: int  # sample since when, about
    pin: int = 0  # number of the pin, counted with rotation from 1; 0: it is no pin's

    def __str__(self) -> str:
        """Say what it is in a sentence's middle."""
        said = SENTENCES[self.kind].format(size=self.size, unit=self.unit, pin=self.pin)
        if self.kind == "pin" and self.confidence < CLEAR:
            said += PERHAPS
        return f"{self.channel} {said}" if self.channel else said


SENTENCES = {
    "lost": "is lost: it reads outside its OK range",
    "stuck": "is stuck: its reading does not change",
    "noise": "is noisy: {size:.3g} {unit} rms",
    "drift": "has drifted by {size:.3g} {unit}",
    "gain": "has another gain, {size:.3g} times what it was: it may be loose",
    "skew": "lags by {size:.3g} {unit}",
    "runout": "has a runout of {size:.3g} {unit} once a turn",
    "unbalance": "the unbalance has changed by {size:.3g} {unit}",
    "magnet": "the magnetic bearing is lost: it carries {size:.0%} of what it should",
    "clearance": "the backup bearing's clearance has changed by {size:.3g} {unit}",
    "pin": "pin {pin} stands {size:.3g} {unit} farther out than it did: it is worn",
}
PERHAPS = ", or the clearance has changed: no other pin was hit since then"
CLEAR = 0.9  # confidence from which that is not said
