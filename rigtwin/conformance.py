"""The tests that a backend must pass; subclass `BackendConformance` in a pytest module of your package."""

from daq.conformance import BackendConformance

__all__ = ["BackendConformance"]
