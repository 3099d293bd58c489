"""The rig's physics: parameters, contact, rotor, housing, drive and sensors; no I/O, no clock."""
