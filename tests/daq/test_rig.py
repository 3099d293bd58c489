# ruff: noqa: E501  a table of cases reads best with one case a line
"""Rig descriptions: what is read, what is resolved, and what is refused in which words."""

import subprocess
import sys
import tomllib
from contextlib import suppress
from datetime import date, datetime
from math import tau
from pathlib import Path

import pytest
import tomli_w

from daq.rig import load_rig, rig_from_text, shipped_rigs, toml_source, with_ports
from simulator.rig import BearingKind, RigError

BALL = Path(__file__).parents[2] / "rigs" / "thesis-ball.toml"


@pytest.mark.parametrize("name", shipped_rigs())
def test_shipped_rig_is_valid_and_named_as_its_file(name):
    assert load_rig(name).name == name


@pytest.mark.parametrize("name", shipped_rigs())
def test_resolved_text_gives_the_same_rig(name, tmp_path):
    overrides = ["limits.displacement.reason=another", "link.daq=7001"]
    if load_rig(name).model:
        overrides += ["rotor.unbalance=9e-5", "emulator.actual.rotor.unbalance_angle=2.1"]
    rig = load_rig(name, overrides)
    assert rig_from_text(rig.toml) == rig
    path = tmp_path / "resolved.toml"
    path.write_text(rig.toml, encoding="utf-8")
    assert load_rig(path) == rig


def test_speeds_are_in_radians_and_lengths_in_metres():
    rig = load_rig("thesis-ball")
    assert rig.limits.speed.trip == pytest.approx(22.0 * tau)
    assert rig.command.max_speed == pytest.approx(25.0 * tau)
    assert rig.safe_state.ramp == pytest.approx(40.0 * tau)
    assert rig.limits.displacement.trip == 1.9e-3
    assert rig.model.backup_bearing.clearance == 1.5e-3


def test_a_rig_on_a_base_changes_only_what_it_says():
    ball, pinned = load_rig("thesis-ball"), load_rig("thesis-pinned")
    assert pinned.model.backup_bearing.kind == BearingKind.PINNED
    assert pinned.model.backup_bearing.friction == 0.2
    assert pinned.model.rotor == ball.model.rotor
    assert pinned.limits.displacement.persistence == ball.limits.displacement.persistence
    assert pinned.channels == ball.channels
    assert "base" not in pinned.toml.split("[rotor]")[0]


def test_rows_on_a_base_are_matched_by_name(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(
        '[rig]\nbase = "thesis-ball"\nname = "mine"\n'
        '[[channel]]\nname = "proximity_x"\nsensitivity = -7870.0\n'
        '[[channel]]\nname = "room"\nquantity = "temperature"\nunit = "K"\ndisplay_unit = "K"\n'
        'terminal = "ai9"\nsensitivity = 0.01\noffset = 0.0\nrange = [0.0, 5.0]\n'
    )
    ball, mine = load_rig("thesis-ball"), load_rig(path)
    assert mine.channels.names == (*ball.channels.names, "room")
    assert mine.channels["proximity_x"] == ball.channels["proximity_x"]._replace(sensitivity=-7870.0)


def test_a_base_may_be_a_file_beside_it(tmp_path):
    (tmp_path / "first.toml").write_text(BALL.read_text(encoding="utf-8"), encoding="utf-8")
    (tmp_path / "second.toml").write_text('[rig]\nbase = "first.toml"\nname = "second"\n')
    assert load_rig(tmp_path / "second.toml").name == "second"


def test_overrides_reach_tables_rows_and_the_actual_rig():
    rig = load_rig(
        "thesis-ball",
        [
            "rotor.unbalance=9e-5",
            "rig.name=mine",
            "limits.force.trip=300",
            "channel.proximity_x.sensitivity=2400",
            "channel.proximity_x.delay_s=1e-5",
            "solenoid.horizontal.max_force = 50",
            "emulator.seed=7",
            "emulator.actual.rotor.unbalance_angle=2.1",
        ],
    )
    assert rig.name == "mine"
    assert rig.model.rotor.unbalance == 9e-5
    assert rig.limits.force.trip == 300.0
    assert rig.channels["proximity_x"].sensitivity == 2400.0
    assert rig.channels["proximity_x"].delay_s == 1e-5
    assert rig.solenoid("horizontal").max_force == 50.0
    assert rig.emulator.seed == 7
    assert rig.model.rotor.unbalance_angle == 0.0
    assert rig.emulated_model.rotor == rig.model.rotor._replace(unbalance_angle=2.1)


def test_actual_rig_that_does_not_differ_is_none():
    rig = load_rig("thesis-ball", ["emulator.actual.rotor.unbalance=75e-6"])
    assert rig.actual is None
    assert rig.emulated_model is rig.model


def test_ports_are_set_in_the_order_of_the_link_table():
    rig = with_ports(load_rig("thesis-ball"), [7001, 7002, 7003, 7004])
    assert (rig.link.daq, rig.link.control, rig.link.twin, rig.link.operator) == (7001, 7002, 7003, 7004)
    assert rig_from_text(rig.toml) == rig
    assert rig.link.endpoint("control") == "tcp/127.0.0.1:7002"


def test_a_rig_without_model_solenoid_and_encoder(tmp_path):
    path = tmp_path / "foreign.toml"
    path.write_text(
        '[rig]\nname = "foreign"\ndescription = "two accelerometers"\nplan = "none"\n'
        "[command]\nmax_speed_hz = 50.0\nmax_ramp_hz_per_s = 5.0\ndefault_ramp_hz_per_s = 1.0\n"
        '[safe_state]\nramp_hz_per_s = 5.0\n[acquisition]\nbackend = "replayed"\nrate = 1000.0\nread = 2\nblock = 10\n'
        '[[channel]]\nname = "acceleration"\nquantity = "acceleration"\nunit = "m/s2"\ndisplay_unit = "g"\n'
        'terminal = "ai0"\nsensitivity = 0.01\noffset = 0.0\nrange = [-10.0, 10.0]\n'
        'calibrated = 2026-01-31\n[limits]\n[twin]\nmodel = "none"\n'
    )
    rig = load_rig(path)
    assert rig.model is None
    assert rig.encoder is None
    assert rig.solenoids == ()
    assert rig.limits.force.trip == float("inf")
    assert rig_from_text(rig.toml) == rig
    with pytest.raises(RigError, match="foreign has no model to emulate"):
        _ = rig.emulated_model


TWICE = (
    '[[solenoid]]\nname = "horizontal"\nstation = 0.3\nangle_deg = 0.0\nmax_force = 1.0\nmax_duration = 0.01\n'
    "force_per_ampere = 1.0\n[[solenoid]]"
)

# Each case: an edit of thesis-ball.toml (what stands there, what shall stand there), what the message names.
BAD_FILES = {
    "misspelt table": ("[rotor]", "[roter]", r"\[roter\] is not a table of a rig; did you mean rotor\?"),
    "misspelt key": ("mass = 1.28", "maas = 1.28", r"\[rotor\] maas is not a key of this table; did you mean mass\?"),
    "misspelt key in a limit": ("warn = 150.0", "wran = 150.0", r"\[limits\.force\] wran .* did you mean warn\?"),
    "misspelt limit": ("[limits.force]", "[limits.forse]", r"\[limits\.forse\] is not a limit; did you mean force\?"),
    "misspelt key in a channel": ('terminal = "ai1"', 'termnal = "ai1"', r"\[\[channel\]\] proximity_y termnal .*terminal\?"),
    "misspelt key in a solenoid": ("max_force = 60", "max_forse = 60", r"\[\[solenoid\]\] horizontal max_forse .*max_force\?"),
    "misspelt key in the link": ("control = 0", "controll = 0", r"\[link\] controll .* did you mean control\?"),
    "misspelt key in the encoder": ("direction = 1", "directon = 1", r"\[encoder\] directon .* did you mean direction\?"),
    "misspelt key in the emulator": ("latency =", "latencey =", r"\[emulator\] latencey .* did you mean latency\?"),
    "misspelt table of the actual rig": ("# rotor.unbalance_angle", "roter.unbalance_angle", r"\[emulator\.actual\.roter\].*rotor\?"),
    "misspelt key of the actual rig": ("# rotor.unbalance_angle", "rotor.unbalance_angl", r"\[emulator\.actual\.rotor\] unbalance_angl .*unbalance_angle\?"),
    "missing key": ("mass = 1.28", "", r"\[rotor\] lacks mass \(kg\)"),
    "missing table": ("[safe_state]\nramp_hz_per_s = 40.0", "", r"table \[safe_state\] is missing"),
    "text for a number": ("mass = 1.28", 'mass = "1.28 kg"', r'\[rotor\] mass = "1\.28 kg" must be a number in kg'),
    "truth for a number": ("mass = 1.28", "mass = true", r"\[rotor\] mass = true must be a number"),
    "number for a text": ('plan = "resonance"', "plan = 3", r"\[rig\] plan = 3 must be a non-empty text"),
    "empty text": ('plan = "resonance"', 'plan = ""', r'\[rig\] plan = "" must be a non-empty text'),
    "fraction for a whole number": ("read = 50", "read = 50.5", r"\[acquisition\] read = 50\.5 must be a whole number"),
    "table twice": ("[command]", "[rotor]", r"mine\.toml: not TOML: .*rotor"),
    "table for rows": ("[[solenoid]]", "[solenoid]", r"solenoid must be rows \[\[solenoid\]\]"),
    "name with a slash": ('name = "thesis-ball"', 'name = "a/b"', r'\[rig\] name = "a/b" must be a name'),
    "length in millimetres": ("shaft_radius = 12.5e-3", "shaft_radius = 12.5", r"shaft_radius = 12\.5 is outside 0\.0001 to 1 m"),
    "clearance in micrometres": ("clearance = 1.5e-3", "clearance = 1500", r"clearance = 1500 is outside .* check its unit"),
    "wrong sign": ("mass = 1.28", "mass = -1.28", r"mass = -1\.28 is outside .* sign"),
    "not a number": ("mass = 1.28", "mass = nan", r"mass = nan is outside"),
    "unknown bearing": ('kind = "ball"', 'kind = "roller"', r'kind = "roller" must be one of ball, plain, pinned'),
    "unknown direction": ("direction = 1 ", "direction = 2 ", r"\[encoder\] direction = 2 must be one of 1, -1"),
    "unknown model": ('model = "contact"', 'model = "fem"', r'\[twin\] model = "fem" must be one of contact, none'),
    "channel not in SI": ('unit = "m"\n', 'unit = "mm"\n', r'proximity_x unit = "mm" must be "m".*sensitivity.*display_unit = "mm"'),
    "unit of another quantity": ('unit = "m"\n', 'unit = "N"\n', r'proximity_x unit = "N" must be "m", the SI unit of displacement$'),
    "unknown display unit": ('display_unit = "µm"', 'display_unit = "inch"', r'display_unit = "inch" must be one of m, mm, µm'),
    "unknown quantity": ('quantity = "displacement"', 'quantity = "displacment"', r"did you mean displacement\?"),
    "sensitivity of zero": ("sensitivity = 2500.0", "sensitivity = 0.0", r"proximity_x sensitivity = 0 must not be 0"),
    "range the wrong way round": ("range = [-10.0, 10.0]", "range = [10.0, -10.0]", r"proximity_x range .* lower end first"),
    "range with one end": ("range = [-10.0, 10.0]", "range = [10.0]", r"proximity_x range = \[10\.0\] must be \[lower, upper\]"),
    "ok outside the range": ("ok = [-9.9, 9.9]", "ok = [-11.0, 9.9]", r"proximity_x ok = .* must be inside range"),
    "station without angle": ("angle_deg = 0.0\n", "", r"proximity_x has only one of station and angle_deg"),
    "date as text": ("offset = 0.0 ", 'calibrated = "2026-01-31"\noffset = 0.0 ', r"calibrated = .* must be a date without quotes"),
    "due before calibrated": ("offset = 0.0 ", "calibrated = 2026-01-31\ndue = 2025-01-31\noffset = 0.0 ", r"due = 2025-01-31 is before"),
    "channel twice": ('name = "proximity_y"', 'name = "proximity_x"', r"\[\[channel\]\] proximity_x stands there twice"),
    "terminal twice": ('terminal = "ai1"', 'terminal = "ai0"', r'proximity_y terminal = "ai0" is taken by proximity_x'),
    "warn above trip": ("warn = 150.0", "warn = 450.0", r"\[limits\.force\] warn = 450 is above trip = 400"),
    "block of broken reads": ("block = 250", "block = 260", r"block = 260 must be a multiple of read = 50"),
    "read too long to protect": ("rate = 25000.0", "rate = 2500.0", r"read = 50 lasts 0\.02 s; .* 0\.01 s: 25 samples"),
    "default ramp above the steepest": ("default_ramp_hz_per_s = 26.7", "default_ramp_hz_per_s = 60", r"default_ramp_hz_per_s = 60 is above"),
    "address of a network": ('host = "127.0.0.1"', 'host = "192.168.0.4"', r'\[link\] host = "192\.168\.0\.4" .* TLS.*127\.0\.0\.1'),
    "every interface": ('host = "127.0.0.1"', 'host = "0.0.0.0"', r'\[link\] host = "0\.0\.0\.0" is not a loopback address'),
    "port out of range": ("daq = 0 ", "daq = 70000 ", r"\[link\] daq = 70000 is outside 0 to 65535"),
    "unknown key in the link": ("daq = 0 ", "display = 0\ndaq = 0 ", r"\[link\] display is not a key .*; its keys are host, daq"),
    "encoder against its channel": ("counts_per_turn = 4096", "counts_per_turn = 2048", r"encoder_angle sensitivity = 651\.89.* must be 325\.94"),
    "twin without its channel": ('name = "motor_speed"', 'name = "speed"', r'\[twin\] model = "contact" needs a \[\[channel\]\] named motor_speed'),
    "no TOML": ("mass = 1.28", "mass = ", r"mine\.toml: not TOML: .*line 11"),
    "base that is none": ("[rig]", '[rig]\nbase = "thesis-bal"', r"\[rig\] base: .*thesis-ball"),
    "base that is no name": ("[rig]", "[rig]\nbase = 3", r"\[rig\] base = 3 must be the name or path of a rig"),
    "solenoid twice": ("[[solenoid]]", TWICE, r"\[\[solenoid\]\] horizontal stands there twice; each name must be unique"),
    "name of a computer": ('host = "127.0.0.1"', 'host = "localhost"', r'\[link\] host = "localhost" is not a loopback address'),
    "base on itself": ("[rig]", '[rig]\nbase = "mine.toml"', r"\[rig\] base: mine\.toml stands on itself"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD_FILES)
def test_bad_description_is_refused_in_one_line_that_names_it(case, tmp_path):
    found, put, message = BAD_FILES[case]
    text = BALL.read_text(encoding="utf-8")
    assert found in text, "the edit does not fit thesis-ball.toml any more"
    path = tmp_path / "mine.toml"
    path.write_text(text.replace(found, put, 1), encoding="utf-8")
    with pytest.raises(RigError, match=message) as caught:
        load_rig(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


BAD_OVERRIDES = {
    "rotor.unblance=1e-5": r"--set rotor\.unblance=1e-5: \[rotor\] unblance .* did you mean unbalance\?",
    "roter.unbalance=1e-5": r"--set .*\[roter\] .* did you mean rotor\?",
    "rotor.mass.x=1": r"rotor\.mass is a value, not a table",
    "channel.proximity_z.offset=1": r"no channel is named proximity_z; did you mean proximity_[xy]\?",
    "channel.proximity_x=1": r"name the key of \[\[channel\]\] proximity_x",
    "rotor.mass=heavy": r'\[rotor\] mass = "heavy" must be a number in kg',
    "rotor.mass": r"write it as table\.key=value",
    "mass=1": r"write it as table\.key=value",
    "rotor..mass=1": r"write it as table\.key=value",
    "limits.force.trip=10": r"\[limits\.force\] warn = 150 is above trip = 10",
    "link.control=80": r"\[link\] .* = 80 is also the port of",
    "limits.force.multiplier=2.0": r"\[limits\.force\] has only one of multiplier and multiplier_hz; give both",
    "emulator.actual=3": r"\[emulator\.actual\] must be a table, not 3",
    "rig.base=thesis-pinned": r"\[rig\] base is not a key",
}


@pytest.mark.parametrize("setting", BAD_OVERRIDES)
def test_bad_override_is_refused(setting):
    settings = [setting, "link.daq=80"] if "link" in setting else [setting]
    with pytest.raises(RigError, match=BAD_OVERRIDES[setting]):
        load_rig("thesis-ball", settings)


@pytest.mark.parametrize("name", ["rotor", "command", "limits", "emulator", "link", "encoder", "channel"])
def test_value_in_place_of_a_table_is_refused(name):
    tables = tomllib.loads(load_rig("thesis-ball").toml) | {name: 3}
    with pytest.raises(RigError, match=rf"{name}\]? must be (a table|rows \[\[channel\]\]), not 3"):
        rig_from_text(tomli_w.dumps(tables))


@pytest.mark.parametrize(
    ("removed", "message"),
    [
        ("limits.force", r"table \[limits\.force\] is missing, and the rig has force channels"),
        ("rotor", r"table \[rotor\] is missing; it holds: mass"),
        ("channel", r"there is no \[\[channel\]\]"),
        ("acquisition", r"table \[acquisition\] is missing"),
    ],
)
def test_missing_table_is_named(removed, message):
    tables = tomllib.loads(load_rig("thesis-ball").toml)
    *parents, key = removed.split(".")
    table = tables
    for parent in parents:
        table = table[parent]
    del table[key]
    with pytest.raises(RigError, match=message):
        rig_from_text(tomli_w.dumps(tables))


def leaves(table, path=()):
    """Yield the path of each value in nested tables and rows."""
    for key, value in table.items() if isinstance(table, dict) else enumerate(table):
        yield (*path, key)
        if isinstance(value, dict | list):
            yield from leaves(value, (*path, key))


@pytest.mark.parametrize(
    "strange", [{}, [], [3], "", True, -1, float("nan"), datetime(2026, 1, 31), date(2026, 1, 31)]
)
def test_strange_value_anywhere_is_refused_or_taken_but_never_breaks(strange):
    text = load_rig("thesis-ball").toml
    for path in leaves(tomllib.loads(text)):
        if path[0] == "channel" and path[1:] and path[1] > 0:
            continue  # one row stands for all
        tables = tomllib.loads(text)
        table = tables
        for key in path[:-1]:
            table = table[key]
        table[path[-1]] = strange
        with suppress(RigError):
            rig_from_text(tomli_w.dumps(tables))


def test_emulator_needs_a_model():
    tables = tomllib.loads(load_rig("thesis-ball").toml)
    for name in ("rotor", "magnetic_bearing", "backup_bearing", "housing", "drive"):
        del tables[name]
    with pytest.raises(RigError, match="needs the tables rotor"):
        rig_from_text(tomli_w.dumps(tables))


def without_model(**more):
    """Tables of a rig on another backend, without a model; `more` replaces or adds some."""
    tables = tomllib.loads(load_rig("thesis-ball", ["acquisition.backend=card", "twin.model=none"]).toml)
    for name in ("rotor", "magnetic_bearing", "backup_bearing", "housing", "drive"):
        del tables[name]
    return tables | more


def test_an_actual_rig_needs_one_to_differ_from():
    tables = without_model(emulator={"actual": {"rotor": {"mass": 1.0}}})
    with pytest.raises(
        RigError, match=r"\[emulator\.actual\] needs the tables rotor, .* from which it differs"
    ):
        rig_from_text(tomli_w.dumps(tables))


def test_the_twin_needs_to_know_where_its_probes_are():
    tables = tomllib.loads(load_rig("thesis-ball").toml)
    for row in tables["channel"]:
        if row["name"] == "proximity_y":
            del row["station"], row["angle_deg"]
    with pytest.raises(
        RigError, match=r"\[\[channel\]\] proximity_y needs station and angle_deg for the twin"
    ):
        rig_from_text(tomli_w.dumps(tables))


def test_a_file_that_cannot_be_read(tmp_path):
    with pytest.raises(RigError, match=r"cannot be read: Is a directory"):
        toml_source.read(tmp_path)


def test_a_value_cannot_smuggle_in_another_key():
    with pytest.raises(RigError, match="must be a number"):
        load_rig("thesis-ball", ["rotor.mass=1.0\nother = 2"])


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("thesis-bal", r'no rig is named "thesis-bal"; did you mean thesis-ball\?.*thesis-pinned'),
        ("zzz", r'no rig is named "zzz"; the shipped rigs are .*; or give the path'),
        ("nowhere/mine.toml", r"nowhere/mine\.toml does not exist"),
        ("tests", r"tests is a folder"),
    ],
)
def test_rig_that_is_not_there(name, message, tmp_path, monkeypatch):
    (tmp_path / "tests").mkdir()
    monkeypatch.chdir(tmp_path)
    with pytest.raises(RigError, match=message):
        load_rig(name)


def test_file_that_is_no_text(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(RigError, match="is not UTF-8 text"):
        load_rig(path)


def test_reading_a_rig_imports_nothing_heavy():
    code = (
        "import sys; from daq.rig import load_rig; load_rig('thesis-ball'); "
        "print([name for name in ('numba', 'scipy', 'zenoh', 'mcap', 'rerun') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
