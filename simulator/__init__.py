"""The rig's physics: parameters, contact, rotor, housing, drive and sensors. No I/O, no clock, no threads."""
