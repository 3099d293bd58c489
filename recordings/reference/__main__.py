"""Makes the reference recordings and their table of digests anew: `python -m recordings.reference`."""

import tomli_w

from daq.recording import Recording
from daq.recording.fingerprint import numeric_fingerprint
from recordings.reference import FOLDER, REFERENCES, SEED, TABLE, Reference

HEAD = """\
# Signal digests of the reference recordings. Written by `python -m recordings.reference`, which makes the
# recordings anew; `command` makes one alone, from the repository's root.

"""


def row(reference: Reference) -> dict[str, object]:
    """Return a recording's row of the table."""
    with Recording(reference.path) as recording:
        account = recording.check().certificate
    plan = reference.plan.relative_to(FOLDER)
    command = (
        f"rigtwin simulate recordings/reference/{plan} --rig {reference.rig} --seed {SEED} "
        f"-o {reference.path.name}"
    )
    return {
        "file": reference.path.name,
        "plan": str(plan),
        "rig": reference.rig,
        "seed": SEED,
        "command": command,
        "samples": account.received,
        "digests": account.signal_digests,
    }


def main() -> None:
    """Write recordings and table."""
    for reference in REFERENCES:
        reference.path.unlink(missing_ok=True)
        reference.simulate(reference.path)
        print(f"{reference.path.name}: {reference.path.stat().st_size / 1e6:.1f} MB")
    rows = {"fingerprint": numeric_fingerprint()} | {each.name: row(each) for each in REFERENCES}
    TABLE.write_text(HEAD + tomli_w.dumps(rows), encoding="utf-8")


if __name__ == "__main__":
    main()
