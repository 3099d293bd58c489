"""`rigtwin command` drives a running rig, and refuses in plain words."""

import json

from tests.end_to_end.rig_process import PATIENT, Running, info, rigtwin, wait_until


def test_operator_drives_the_rig_from_the_command_line(tmp_path):
    path = tmp_path / "run.mcap"

    def command(*words):
        result = rigtwin("command", "--json", *words, cwd=tmp_path)
        assert result.returncode in (0, 1), result.stderr
        answer = json.loads(result.stdout)
        assert answer["accepted"] == (result.returncode == 0)
        return answer

    with Running("live", *PATIENT, "--plan", "none", "--view", "none", "--record", path, cwd=tmp_path) as run:
        run.wait_for("at rest")
        assert "arm" in command("speed", "5")["text"]  # refused: not armed
        assert command("arm")["accepted"]
        assert "25" in command("speed", "26")["text"]  # refused: the rig's largest speed
        assert command("speed", "5", "--ramp", "20")["accepted"]
        assert command("hit", "--force", "5")["accepted"]
        assert "60" in command("hit", "--force", "500")["text"]  # refused: the solenoid's largest force
        assert command("mark", "hello")["accepted"]
        assert command("stop")["accepted"]
        assert command("trip")["accepted"]
        assert "trip" in command("arm")["text"]  # refused: latched
        wait_until(lambda: command("reset")["accepted"], "the cause to be gone")
        assert command("arm")["accepted"]
        assert rigtwin("shutdown", cwd=tmp_path).returncode == 0
        assert run.wait() == 0, run.said()
    found = info(path)
    assert found["certificate"]["verdict"] == "valid"
    kinds = [event["kind"] for event in found["events"] if event["source"] == "daq"]
    for kind in ("arm", "speed", "hit", "mark", "stop", "trip", "reset", "refused", "end"):
        assert kind in kinds


PLAN = """
[plan]
name = "short"
description = "up and wait"
[[step]]
do = "speed"
speed_hz = 4.0
ramp_hz_per_s = 20.0
[[step]]
do = "wait"
duration = 60.0
"""


def test_a_plan_is_given_to_a_running_rig_cut_short_and_resumed(tmp_path):
    path, plan = tmp_path / "run.mcap", tmp_path / "short.toml"
    plan.write_text(PLAN, encoding="utf-8")
    told = ("--meta", "operator=anna")
    with Running(
        "live", *PATIENT, "--plan", "none", "--view", "none", "--record", path, *told, cwd=tmp_path
    ) as run:
        run.wait_for("at rest")
        nothing = rigtwin("plan", "resume", cwd=tmp_path)
        assert (nothing.returncode, nothing.stdout) == (
            1,
            "refused: no plan was cut short: there is nothing to resume\n",
        )
        assert rigtwin("plan", "run", plan, cwd=tmp_path).returncode == 0
        busy = rigtwin("plan", "run", plan, cwd=tmp_path)
        assert "plan short is running" in busy.stdout
        assert rigtwin("command", "stop", cwd=tmp_path).returncode == 0
        assert rigtwin("plan", "resume", cwd=tmp_path).returncode == 0
        assert "plan short is running" in rigtwin("command", "arm", cwd=tmp_path).stdout
        assert rigtwin("command", "stop", cwd=tmp_path).returncode == 0
        assert rigtwin("shutdown", cwd=tmp_path).returncode == 0
        assert run.wait() == 1, run.said()  # a plan was cut short
    found = info(path)
    assert found["meta"] == {"operator": "anna"}
    told = [event for event in found["events"] if event["source"] == "operator"]
    ends = [event["text"] for event in told if event["kind"] == "plan_end"]
    assert len(ends) == 2
    assert all(text.startswith("plan short was cut short: stop by") for text in ends)
    assert [event["kind"] for event in told].count("plan_start") == 2
