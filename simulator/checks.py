"""What a model cannot be although each of its numbers is in range: one clear line for each case.

`place` and `parent` are how messages name the tables: "[backup_bearing]", or "emulator.actual" as a parent.
"""

from simulator.rig import BackupBearing, BearingKind, ContactLaw, DampingMode, Model, Pin, Rotor
from simulator.validation import RigError, written

LEAST_RESTITUTION = 0.01  # some laws divide by it


def check_model(model: Model, parent: str = "") -> None:
    """Refuse a model that contradicts itself. Raises `RigError`."""
    prefix = f"{parent}." if parent else ""
    check_rotor(model.rotor, f"[{prefix}rotor]")
    check_bearing(model.backup_bearing, f"[{prefix}backup_bearing]")


def check_rotor(rotor: Rotor, place: str = "[rotor]") -> None:
    """Refuse inertias that no distribution of the mass has. Raises `RigError`."""
    least = rotor.mass * rotor.centre_of_mass_station**2
    if rotor.inertia < least:
        raise RigError(
            f"{place} inertia = {rotor.inertia:g} kg m2 is less than the mass alone has at its station, "
            f"mass x centre_of_mass_station^2 = {least:.4g} kg m2; give the inertia about the pivot"
        )
    if rotor.polar_inertia > 2.0 * rotor.inertia:
        raise RigError(
            f"{place} polar_inertia = {rotor.polar_inertia:g} kg m2 is more than twice the inertia = "
            f"{rotor.inertia:g} kg m2, which no body has; check which is which"
        )


def check_bearing(bearing: BackupBearing, place: str = "[backup_bearing]") -> None:
    """Refuse a backup bearing that lacks what its kind and law need. Raises `RigError`."""
    if bearing.kind == BearingKind.BALL and bearing.ring_inertia <= 0.0:
        raise RigError(
            f"{place} ring_inertia = {bearing.ring_inertia:g} kg m2 must be above 0 for a ball "
            'bearing; give its inertia, or set kind = "plain" for a ring that does not spin'
        )
    check_law(bearing, place)
    if bearing.kind == BearingKind.PINNED:
        for pin in bearing.pins:
            check_pin(bearing, pin, f"[{place.strip('[]')}.pin.{pin.number}]")


def check_law(bearing: BackupBearing, place: str) -> None:
    """Refuse a contact law without what it needs. Raises `RigError`."""
    law = ContactLaw(bearing.law)
    if law not in (ContactLaw.LANKARANI_NIKRAVESH, ContactLaw.FLORES, ContactLaw.GONTHIER):
        return
    if bearing.damping_mode != DampingMode.LATCHED:
        raise RigError(
            f'{place} damping_mode = "fixed" does not go with law = "{written(law)}", whose damping '
            'comes from restitution and closing speed; set damping_mode = "latched"'
        )
    if law != ContactLaw.LANKARANI_NIKRAVESH and bearing.restitution < LEAST_RESTITUTION:
        raise RigError(
            f"{place} restitution = {bearing.restitution:g} is below {LEAST_RESTITUTION:g}, "
            f'where law = "{written(law)}" has no finite damping; give a larger one'
        )


def check_pin(bearing: BackupBearing, pin: Pin, place: str) -> None:
    """Refuse a pin that is not there, or that leaves the shaft no gap. Raises `RigError`."""
    if pin.number > bearing.pin_count:
        raise RigError(f"{place} is not one of the pin_count = {bearing.pin_count} pins, which count from 1")
    gap = bearing.clearance + pin.wear
    if gap <= 0.0:
        raise RigError(
            f"{place} wear = {pin.wear:g} m leaves a gap of {gap:g} m under the pin, whose clearance is "
            f"{bearing.clearance:g} m; it must be above 0"
        )
