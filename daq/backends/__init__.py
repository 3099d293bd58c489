"""Devices that the acquisition can read and drive, each behind `daq.backend.Backend`."""
