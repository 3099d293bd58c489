"""What this project does: it finds the highest speed at which a rig's shaft keeps clear of its bearing."""

import numpy as np


def largest_radius(signals):
    """Largest distance of the shaft from the probes' zero, m."""
    return float(np.hypot(signals["proximity_x"], signals["proximity_y"]).max())


def highest_clear_speed(rig, speeds_hz, radius, settle=1.0):
    """Run a rig up step by step; return the last speed, Hz, at which its shaft stays within `radius`, m."""
    rig.arm()
    clear = 0.0
    for speed in speeds_hz:
        answer = rig.command("speed", speed_hz=speed)
        if not answer.accepted:
            break
        rig.run(settle)
        if rig.events("trip") or largest_radius(rig.signals("proximity_x", "proximity_y")) > radius:
            break
        clear = speed
    rig.command("stop")
    return clear
