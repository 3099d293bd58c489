"""The channel table: calibration, order, look-up."""

from math import pi

import numpy as np
import pytest

from daq.rig import load_rig
from daq.rig.channels import QUANTITIES, ChannelTable
from simulator.rig import RigError


@pytest.fixture
def table() -> ChannelTable:
    return load_rig("thesis-ball").channels


def test_value_is_raw_less_offset_over_sensitivity(table):
    offset = load_rig("thesis-ball", ["channel.proximity_x.offset=0.5"]).channels
    raw = np.full((len(table), 3), 3.0)
    values = offset.calibrate(raw, np.empty_like(raw))
    assert values[offset.index("proximity_x")] == pytest.approx([1e-3] * 3)
    assert values[offset.index("force_top")] == pytest.approx([150.0] * 3)
    assert values[offset.index("motor_speed")] == pytest.approx([60.0] * 3)


def test_eddy_probe_with_negative_sensitivity():
    table = load_rig(
        "thesis-ball", ["channel.proximity_x.sensitivity=-7870", "channel.proximity_x.offset=-8"]
    ).channels
    raw = np.zeros((len(table), 1))
    raw[0] = -8.787
    assert table.calibrate(raw, np.empty_like(raw))[0] == pytest.approx([1e-4])


def test_calibration_may_be_in_place(table):
    raw = np.random.default_rng(1).uniform(-10, 10, (len(table), 50))
    expected = table.calibrate(raw, np.empty_like(raw))
    assert table.calibrate(raw, raw) is raw
    assert np.array_equal(raw, expected)


def test_look_up_by_name_and_position(table):
    assert table["proximity_y"] is table[1]
    assert table[:2] == (table["proximity_x"], table["proximity_y"])
    assert "proximity_x" in table
    assert "proximity_z" not in table
    assert len(table) == len(table.names) == len(table.units) == 11
    assert [channel.name for channel in table.of_quantity("speed")] == ["motor_speed", "motor_speed_command"]
    with pytest.raises(RigError, match=r"no channel is named proximity_z; did you mean proximity_[xy]\?"):
        table.index("proximity_z")


def test_display_scale_and_full_scale(table):
    assert table["proximity_x"].display_scale == 1e6
    assert table["motor_speed"].display_scale == pytest.approx(1 / (2 * pi))
    assert table["proximity_x"].full_scale == pytest.approx(4e-3)


def test_first_unit_of_each_quantity_is_the_si_unit():
    assert all(next(iter(units.values())) == 1.0 for units in QUANTITIES.values())
