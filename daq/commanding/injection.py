"""Faults that are injected into an emulated rig while it runs: what the command `inject` asks for."""

from typing import Any

from daq.messages_pb2 import Command
from simulator.faults import Fault, check_fault, span_of
from simulator.validation import RigError, tuple_at

NUMBERS = ("after", "size", "angle_deg", "pin", "duration")
TEXTS = ("kind", "channel", "name")
"""What the command takes: the keys of a row `[[emulator.fault]]`, but `after` (s from now) for `at`."""


def fault_of(command: Command, sample: int, rate: float) -> Fault:
    """Return the fault that a command asks for at a sample; `rate` is samples a second.

    Raises:
        RigError: it is no fault, in the words that the rig's description gets.
    """
    row: dict[str, Any] = {**command.texts, **command.values}
    after = row.pop("after", 0.0)
    if not after >= 0.0:
        raise RigError(f"after = {after:g} s must not be negative: a fault begins now or later")
    if command.values.get("pin", 0.5).is_integer():  # numbers travel as fractions
        row["pin"] = int(row["pin"])
    fault: Fault = tuple_at(Fault, row | {"at": sample / rate + after}, "inject")
    check_fault(fault)
    span_of(fault, rate)
    return fault
