"""Mends a recording that was cut off or damaged, and says what was saved."""

from pathlib import Path

from daq.recording import Recovered, recover

SHOWN = 10  # lines of damage and of gaps

__all__ = ["recover", "report"]


def report(source: str | Path, recovered: Recovered) -> str:
    """Return what `recover` did, for people to read."""
    account = recovered.certificate
    lines = [f"{source}: {fault}" for fault in recovered.damage[:SHOWN]]
    if len(recovered.damage) > SHOWN:
        lines.append(f"and {len(recovered.damage) - SHOWN} more faults")
    lines += [f"samples {first} to {last} are lost" for first, last in account.gaps[:SHOWN]]
    if len(account.gaps) > SHOWN:
        lines.append(f"and {len(account.gaps) - SHOWN} more gaps")
    lines.append(
        f"{recovered.path}: {account.received} samples and {sum(account.messages.values())} messages saved, "
        f"{account.lost} samples lost between the first and the last that are known"
    )
    return "\n".join(lines)
