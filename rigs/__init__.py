"""Rig descriptions and plans that ship with rigtwin, as data."""
