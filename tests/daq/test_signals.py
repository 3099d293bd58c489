"""Samples of a recording as tables of other packages, with the same numbers, times and units."""

import sys

import numpy as np
import pytest

from daq.messages import Series
from daq.optional import MissingPackage
from daq.recording.signals import Signals, joined

NAMES, UNITS = ("tilt_x", "force"), ("rad", "N")


@pytest.fixture
def signals() -> Signals:
    """Every 5th sample of two messages with one missing between them."""
    rows = np.arange(8.0, dtype=np.float32).reshape(2, 4)
    parts = [Series(0.0, "run", first, 1000.0, 0, 5, NAMES, UNITS, rows + first) for first in (100, 140)]
    return joined(parts, NAMES, 0, None, "the test")


def test_the_columns_stand_at_their_times(signals):
    expected = np.arange(100, 160, 5) / 1000.0
    np.testing.assert_array_equal(signals.time, expected)
    assert signals.column_rate == 200.0
    assert signals.gaps == ((120, 139),)


def test_pandas_has_the_same_numbers_by_time(signals):
    frame = signals.to_pandas()
    np.testing.assert_array_equal(frame["force"].to_numpy(), signals["force"])
    assert frame["force"].dtype == np.float32
    assert frame.index.name == "time"
    assert frame.loc[0.120:0.139, "tilt_x"].isna().all()
    assert frame.loc[0.140, "force"] == 144.0
    assert frame.attrs == {"units": {"tilt_x": "rad", "force": "N"}, "rate": 200.0}


def test_xarray_has_the_same_numbers_with_units(signals):
    found = signals.to_xarray()
    np.testing.assert_array_equal(found.force, signals["force"])
    assert float(found.tilt_x.sel(time=0.105)) == 101.0
    assert (found.force.units, found.time.units, found.rate) == ("N", "s", 200.0)


def test_arrow_has_the_same_numbers_with_units(signals):
    table = signals.to_arrow()
    np.testing.assert_array_equal(table["time"], signals.time)
    np.testing.assert_array_equal(table["force"], signals["force"])
    assert table.schema.field("force").metadata == {b"unit": b"N"}
    assert table.schema.metadata == {b"rate": b"200.0"}


@pytest.mark.parametrize("package", ["pandas", "xarray"])
def test_a_missing_package_is_named(signals, package, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(MissingPackage, match=rf"package {package}: pip install 'rigtwin\[export\]'"):
        getattr(signals, f"to_{package}")()
