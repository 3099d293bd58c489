"""Which ports a rig's processes use: free ones for a run that begins, those of the run for who joins it."""

from daq.link import LinkError, free_ports, is_taken
from daq.rig import Rig, rig_from_text, with_ports
from daq.runtime import running


def with_free_ports(rig: Rig) -> Rig:
    """Return the rig with free ports where its description leaves them open (0)."""
    given = [rig.link.daq, rig.link.control, rig.link.twin, rig.link.operator]
    return with_ports(rig, [port or free for port, free in zip(given, free_ports(4), strict=True)])


def check_free(rig: Rig) -> None:
    """Refuse a rig whose description fixes ports that another process listens on.

    Raises:
        LinkError: one is in use.
    """
    host, *ports = rig.link
    for name, port in zip(rig.link._fields[1:], ports, strict=True):
        if port and is_taken(host, port):
            raise LinkError(
                f"link.{name} = {port}: the port is in use by another process: stop that one, give another "
                "port, or 0 for one that is free"
            )


def as_it_runs(rig: Rig) -> Rig:
    """Return the rig with the ports of its present run where its description leaves them open.

    Raises:
        NotRunning: it leaves them open, and the rig is not running.
    """
    return rig_from_text(running(rig.name)["toml"], rig.name) if 0 in rig.link else rig
