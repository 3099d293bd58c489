"""The tutorial's commands and examples are run as they stand."""

import os
import re
import subprocess
import sys
from pathlib import Path

TUTORIAL = Path(__file__).resolve().parents[2] / "docs" / "tutorial.md"


def test_every_command_and_example_of_the_tutorial_works(tmp_path):
    blocks = re.findall(r"```(console|python)\n(.*?)```", TUTORIAL.read_text(encoding="utf-8"), re.DOTALL)
    assert len(blocks) > 5
    programs = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    for kind, text in blocks:
        commands = [[sys.executable, "-c", text]] if kind == "python" else shell(text)
        for command in commands:
            result = subprocess.run(
                command,
                cwd=tmp_path,
                env=os.environ | {"PATH": programs},
                capture_output=True,
                text=True,
                timeout=240,
            )
            assert result.returncode == 0, f"{command}\n{result.stdout}{result.stderr}"


def shell(text):
    """The commands of a console block."""
    return [["sh", "-c", line[2:]] for line in text.splitlines() if line.startswith("$ ")]
