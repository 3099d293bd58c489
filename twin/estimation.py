"""From the daq's blocks to the twin's messages: what the twin's process, a simulation and a replay share."""

from collections.abc import Mapping

import numpy as np

from analysis.regime import named
from daq import keys
from daq.events import EventCounter
from daq.messages import BlockStatus, SeriesEncoder
from daq.messages_pb2 import INFO, WARNING, Parameter, Severity
from daq.regions import KIND, Regions
from daq.rig import Rig
from daq.series_layout import SeriesDecoder
from twin.estimate import STRIDE, Estimated, EstimateStatus
from twin.fault import Fault
from twin.findings import Findings, RegimeChange
from twin.health import Health
from twin.inputs import too_late
from twin.observer import Observer
from twin.smoothing import NAMES, UNITS, Smoothed, Smoothing
from twin.trust import Change, Trust

SOURCE = "twin"
RECORDING_OFF = int(BlockStatus.RECORDING_OFF)
NOT_RECORDED = "not recorded, as commanded"
LOST_PERIOD = 1.0  # s in which a state that is lost again and again is told once


class Twin:
    """Turns blocks into estimates, summaries and events; no link, no clock.

    Equal blocks in equal order give equal messages.

    Args:
        rig: with a model.
        run: run id, as in the blocks.
        t0_ns: UTC of sample 0 in ns since 1970.
        smooth: whether to tell the motion with hindsight as well, up to half a second later.

    Raises:
        RigError: the rig has no model, or not the channels that the observer needs.
    """

    def __init__(self, rig: Rig, run: str, t0_ns: int, smooth: bool = False) -> None:
        self.run = run
        self.observer = Observer(rig)
        self.samples = 0
        """Samples estimated so far."""
        self.lost = 0
        """Samples that did not come."""
        self.reached = 0
        """Index behind the last block that was taken in."""
        self._passed_over = False  # whether the last block was not to be recorded
        self._findings = Findings(rig)
        self._health = Health(rig, self.observer.tuning)
        self._trust = Trust(self.observer)
        self._smoothing = Smoothing(self.observer) if smooth else None
        self._first_out = ""
        self._rate = rig.acquisition.rate
        self._t0 = t0_ns * 1e-9
        self._counter = EventCounter(SOURCE)
        self._quiet_until = 0
        self._regions = Regions(*rig.regions)
        self._largest_residual = rig.capture.residual
        self._decoder = SeriesDecoder()
        self._encoder = SeriesEncoder(run, self._rate, self.observer.names, self.observer.units, STRIDE)
        self._smoothed_encoder = SeriesEncoder(run, self._rate, NAMES, UNITS, STRIDE)
        self._smoothed_key = keys.smoothed(rig.name)
        self._keys = keys.estimate(rig.name), keys.twin_summary(rig.name), keys.event(rig.name, SOURCE)

    def process(self, payload: bytes, cause: str = "not received") -> list[tuple[str, bytes]]:
        """Take in the next block, as it was published, and return what to publish: (key, payload).

        `cause` says why samples before this block are missing, if any are. A block that is not to be recorded
        is passed over, so that equal estimates follow from the recording. Raises MessageError for bytes
        that are no block, ValueError for a block of another rig or from the past.
        """
        block = self._decoder.decode(payload)
        self.reached = block.first_sample + block.samples.shape[1]
        if block.status & RECORDING_OFF:
            self._passed_over = True
            return []
        estimated = self.observer.update(block)
        smoothed = self._smoothing.add(block, estimated) if self._smoothing else []
        messages = self._events(estimated, NOT_RECORDED if self._passed_over else cause)
        self._passed_over = False
        faults = self._health.add(block, estimated)
        messages += [self._fault(fault, estimated) for fault in faults]
        messages += [self._changed(change) for change in self._trust.add(block, estimated, faults)]
        messages.append(self._estimate(estimated))
        self._findings.add(estimated)
        self.samples += estimated.n_samples
        if self._findings.is_due:
            messages += self._summary()
        return messages + [self._smoothed(each) for each in smoothed]

    def _estimate(self, estimated: Estimated) -> tuple[str, bytes]:
        """Return the estimate's message."""
        timestamp = self._time(estimated.first_sample)
        values = estimated.samples.astype(np.float32)
        return self._keys[0], self._encoder.encode(
            timestamp, estimated.first_sample, estimated.status, values
        )

    def _smoothed(self, smoothed: Smoothed) -> tuple[str, bytes]:
        """Return the message of the motion with hindsight."""
        timestamp, values = self._time(smoothed.first_sample), smoothed.samples.astype(np.float32)
        return self._smoothed_key, self._smoothed_encoder.encode(
            timestamp, smoothed.first_sample, smoothed.status, values
        )

    def _summary(self) -> list[tuple[str, bytes]]:
        """Return the summary's message, and an event when the regime has changed."""
        summary, change = self._findings.summarise()
        summary.timestamp, summary.run = self._time(summary.first_sample), self.run
        found, not_told = self.observer.identified()
        summary.parameters.extend(Parameter(**each._asdict()) for each in found)
        summary.not_told.extend(not_told)
        messages = [(self._keys[1], summary.SerializeToString(deterministic=True))]
        end = summary.first_sample + summary.n_samples
        if change:
            messages.append(self._regime(change, end))
        if summary.impacts:
            self._regions.trigger(end, "impact")
        if self._largest_residual is not None and summary.residual_rms > self._largest_residual:
            self._regions.trigger(end, "residual")
        return messages + self._region(end)

    def finish(self) -> list[tuple[str, bytes]]:
        """Return what is left to publish at the run's end."""
        smoothed = self._smoothing.finish() if self._smoothing else []
        messages = [self._smoothed(each) for each in smoothed]
        return messages + self._region(self.observer.expected or 0, ending=True)

    def _region(self, sample: int, ending: bool = False) -> list[tuple[str, bytes]]:
        """Return the event of a region that is over."""
        return [
            self._event(KIND, region.text(self._rate), sample, details=region.details())
            for region in self._regions.over(sample, ending)
        ]

    def _events(self, estimated: Estimated, cause: str) -> list[tuple[str, bytes]]:
        """Return the events of a gap, a late start or a lost state."""
        first = estimated.first_sample
        if estimated.missing:
            begin, end = estimated.missing
            self.lost += 0 if cause == NOT_RECORDED else end - begin + 1
            details = {"first": begin, "last": end, "cause": cause}
            text = f"{end - begin + 1} samples before this one are missing: {cause}"
            severity = INFO if cause == NOT_RECORDED else WARNING
            return [self._event("gap", text, first, severity, details)]
        if estimated.restarted and self.samples == 0:
            text = "the estimate begins" if first == 0 else f"the estimate begins late, {self._after(first)}"
            if late := too_late(self.observer.rig):
                text += f"; delay_s of {', '.join(late)} is longer than what it makes up for: taken as 0"
            return [self._event("start", text, first)]
        if estimated.status & EstimateStatus.LOST and first >= self._quiet_until:
            self._quiet_until = first + round(LOST_PERIOD * self._rate)
            text = f"{estimated.cause}: the linear filter stands in, and the observer begins anew"
            return [self._event("lost", text, first, WARNING, {"cause": estimated.cause})]
        return []

    def _after(self, sample: int) -> str:
        return f"{sample / self._rate:.2f} s after the run"

    def _regime(self, change: RegimeChange, sample: int) -> tuple[str, bytes]:
        before, now, confidence = change
        details = {"before": before.value, "now": now.value, "confidence": f"{confidence:.2f}"}
        return self._event("regime", f"regime: {named(now, confidence)}", sample, details=details)

    def _fault(self, fault: Fault, estimated: Estimated) -> tuple[str, bytes]:
        """Return the event of a fault; its details name the first one of the run."""
        self._first_out = self._first_out or str(fault)
        since = fault.onset / self._rate
        text = f"{fault}, since about {since:.1f} s (confidence {fault.confidence:.0%})"
        sample = estimated.first_sample + estimated.n_samples - 1
        details = {**fault._asdict(), "first_out": self._first_out}
        return self._event("sensor_fault" if fault.channel else "rig_fault", text, sample, WARNING, details)

    def _changed(self, change: Change) -> tuple[str, bytes]:
        """Return the event of a sensor that is left out or taken in again; the watches follow suit."""
        self._health.believe(change.channel, not change.left_out)
        details = {"channel": change.channel, "from": change.sample}
        if change.left_out:
            text = f"{change.channel} is left out: the estimate goes on without it, and is less certain"
            return self._event("sensor_left_out", text, change.sample - 1, WARNING, details)
        text = f"{change.channel} agrees with the estimate again and is taken in"
        return self._event("sensor_taken_in", text, change.sample - 1, INFO, details)

    def _event(
        self,
        kind: str,
        text: str,
        sample: int,
        severity: Severity = INFO,
        details: Mapping[str, object] | None = None,
    ) -> tuple[str, bytes]:
        """Return the next event's message."""
        payload = self._counter.make(
            kind, text, sample, severity, details, run=self.run, timestamp=self._time(sample)
        )
        return self._keys[2], payload

    def _time(self, sample: int) -> float:
        """Return the UTC of a sample in s since 1970."""
        return self._t0 + sample / self._rate
