"""Acquires the rig's channels, drives and protects it, and publishes everything."""
