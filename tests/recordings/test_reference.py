"""The reference recordings: today's rig, acquisition and twin still give the same answer."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from daq.recording import Recording
from daq.recording.fingerprint import COMPILER, numeric_fingerprint
from recordings.reference import FOLDER, REFERENCES, compare, table
from replay.verify import BOUND, EQUIVALENT, IDENTICAL, verify

LARGEST = 8_000_000  # bytes of all of them
EACH = pytest.mark.parametrize("reference", REFERENCES, ids=lambda each: each.name)
REMEDY = "where that is meant: python -m recordings.reference"


def expected_verdict() -> str:
    return IDENTICAL if table()["fingerprint"] == numeric_fingerprint() else EQUIVALENT


@EACH
def test_a_new_simulation_gives_the_same_signals(reference, tmp_path):
    again = tmp_path / "again.mcap"
    reference.simulate(again)
    with Recording(again) as recording:
        account = recording.check().certificate
    row = table()[reference.name]
    assert account.received == row["samples"]
    if expected_verdict() == IDENTICAL:
        assert account.signal_digests == row["digests"], REMEDY
    for name, comparison in compare(reference.path, again).items():
        assert comparison.beyond is None, f"{name}: {comparison.beyond}; {REMEDY}"
        assert not comparison.unrecorded, name


@EACH
def test_the_stored_one_is_sound_and_today_s_twin_repeats_it(reference):
    with Recording(reference.path) as recording:
        check = recording.check()
    assert check.verdict == "valid"
    row = table()[reference.name]
    assert check.certificate.signal_digests == row["digests"]
    assert row["command"].split()[2] == str(reference.plan.relative_to(FOLDER.parents[1]))
    found = verify(reference.path)
    assert found.verdict == expected_verdict(), f"{found}; {REMEDY}"


def test_there_is_contact_in_each_and_they_are_small():
    for reference in REFERENCES:
        with Recording(reference.path) as recording:
            force = recording.series("truth", ["normal_force"]).samples[0]
        assert np.count_nonzero((force[1:] > 1.0) & (force[:-1] <= 1.0)) >= 8
    assert sum(reference.path.stat().st_size for reference in REFERENCES) < LARGEST


def verdict_with(variables: dict[str, str]) -> dict:
    """What `rigtwin verify --json` says of a reference recording in a process with other variables."""
    result = subprocess.run(
        [sys.executable, "-m", "rigtwin", "verify", "--json", str(REFERENCES[0].path)],
        cwd=FOLDER.parents[1],
        env=os.environ | variables,
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    verdict = json.loads(result.stdout)
    assert verdict["verdict"] == (EQUIVALENT if verdict["changed"] else IDENTICAL)
    assert verdict["largest"] <= BOUND
    return verdict


def test_a_processor_without_vector_units_gives_an_equivalent_answer():
    """With numpy's, OpenBLAS' and the C library's choice of processor features set otherwise."""
    found = np.show_config(mode="dicts")["SIMD Extensions"]["found"]
    lesser = {
        "NPY_DISABLE_CPU_FEATURES": " ".join(found),
        "OPENBLAS_CORETYPE": "Prescott",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX512F,-AVX2,-AVX,-FMA,-FMA4",
    }
    assert not found or "features" in verdict_with(lesser)["changed"]


@pytest.mark.slow
def test_kernels_compiled_for_a_lesser_processor_give_an_equivalent_answer(tmp_path):
    """Compiled anew, without AVX and fused multiplication; the fingerprint tells it."""
    lesser = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": "", "NUMBA_CACHE_DIR": str(tmp_path)}
    assert "target" in verdict_with(lesser)["changed"]
    assert list(tmp_path.rglob("*.nbc")), "nothing was compiled"


@pytest.mark.parametrize("name", COMPILER)
def test_a_variable_that_changes_machine_code_changes_the_fingerprint(monkeypatch, name):
    for each in COMPILER:
        monkeypatch.delenv(each, raising=False)
    before = numeric_fingerprint()
    monkeypatch.setenv(name, "")
    after = numeric_fingerprint()
    assert (before["target"], after["target"]) == ("host", f"{name}=")
    assert before == after | {"target": "host"}
