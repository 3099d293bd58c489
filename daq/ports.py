"""Which ports a rig's processes use: free ones for a run that begins, those of the run for who joins it."""

from daq.link import free_ports
from daq.rig import Rig, rig_from_text, with_ports
from daq.runtime import running


def with_free_ports(rig: Rig) -> Rig:
    """Return the rig with free ports where its description leaves them open (0)."""
    given = [rig.link.daq, rig.link.control, rig.link.twin, rig.link.operator]
    return with_ports(rig, [port or free for port, free in zip(given, free_ports(4), strict=True)])


def as_it_runs(rig: Rig) -> Rig:
    """Return the rig with the ports of its present run where its description leaves them open.

    Raises:
        NotRunning: it leaves them open, and the rig is not running.
    """
    return rig_from_text(running(rig.name)["toml"], rig.name) if 0 in rig.link else rig
