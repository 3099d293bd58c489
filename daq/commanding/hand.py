"""The hand that pushes the shaft of an emulated rig round its bearing, as a person does at a real one."""

from daq.backend import Backend, HitOutput
from daq.rig import Rig, rig_from_text, toml_source

PUSHES = 12
FORCE = 18.0  # N: some more than magnet and gravity hold against
LASTING = 0.6  # s of each push
NAME = "hand"


def with_hand(rig: Rig) -> Rig:
    """Return an emulated rig whose shaft can be pushed in twelve directions, as by slow solenoids."""
    probe = next(each for each in rig.channels.of_quantity("displacement") if each.station)
    tables = toml_source.parse(rig.toml, rig.name)
    tables["solenoid"] = [
        *tables.get("solenoid", []),
        *(
            {
                "name": f"{NAME}_{number}",
                "station": probe.station,
                "angle_deg": 360.0 * number / PUSHES,
                "max_force": FORCE,
                "max_duration": LASTING,
                "force_per_ampere": 1.0,
            }
            for number in range(PUSHES)
        ),
    ]
    return rig_from_text(toml_source.dump(tables), f"{rig.name} with a hand")


def push_round(device: Backend, rate: float) -> None:
    """Push the shaft of a rig `with_hand` once round, beginning now."""
    begin = device.clock() + round(0.1 * rate)
    for number in range(PUSHES):
        at_sample = begin + round(number * LASTING * rate)
        device.write(HitOutput(f"{NAME}_{number}", FORCE, LASTING), at_sample)
