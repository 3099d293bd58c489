"""A rig as its description (`rigs/*.toml`) tells it."""

from daq.rig.description import (
    Rig,
    RigError,
    load_rig,
    rig_from_text,
    shipped_rigs,
    with_overrides,
    with_ports,
)

__all__ = ["Rig", "RigError", "load_rig", "rig_from_text", "shipped_rigs", "with_overrides", "with_ports"]
