"""The fault campaign: its cases, its verdict, its file; and twenty of its runs."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest
from typer.testing import CliRunner

from benchmarks.campaign import cli, run, turn
from benchmarks.campaign.cases import LENGTH_S, Case, draw
from benchmarks.campaign.kinds import DEVICE_KINDS, KINDS
from benchmarks.campaign.report import write_into
from benchmarks.campaign.run import Row
from benchmarks.campaign.verdict import FORCE_LIMIT_N, Verdict, judge
from hal.hil import nursery
from hal.hil.door import Seen, Transition
from handrail.messages import GroundTruth
from handrail.robot import library as robots
from tests.soaking import kept, share_of

ROBOT = robots.load("talos_upper")
N = len(ROBOT.joints)


def seen(**changes: object) -> Seen:
    """A window in which an enabled robot stood still at home."""
    home = ROBOT.home_position().tolist()
    truth = GroundTruth(time_ns=0, joints={}, hinges={}, poses_in_world={}, contact_force={}, peak_contact_force={})
    still = Seen(
        joints=list(ROBOT.joints),
        since_ns=0,
        truth=truth,
        velocity=[0.0] * N,
        lowest=list(home),
        highest=list(home),
        fastest=[0.0] * N,
        speeding_ns=[0] * N,
        peak_contact_force={"valve": 0.0},
        states=["operation_enabled"] * N,
        errors=["none"] * N,
        braked=[False] * N,
        transitions=[],
    )
    return msgspec.structs.replace(still, **changes)


def at(values: list, row: int, value: object) -> list:
    return [*values[:row], value, *values[row + 1 :]]


def verdict(motion: Seen | None = None, rest: Seen | None = None, **changes) -> Verdict:
    told = {"end": "done", "turned": 0.5, "needed": 0.4, "enabled": True} | changes
    return judge(ROBOT, motion or seen(), rest or seen(), **told)


STOPPED = seen(states=["quick_stop_active"] * N, braked=[True] * N)


def test_a_done_turn_is_a_success_and_a_robot_stopped_behind_its_brakes_is_safe():
    assert verdict().outcome == "success"
    assert verdict(rest=STOPPED, enabled=False, end="drive_fault", turned=0.1).outcome == "safe"
    assert verdict(end="pose_error", turned=0.1).outcome == "safe"


ARM = [row for row, joint in enumerate(ROBOT.joints) if joint.startswith("arm_left")]


def arm_out(**changes: object) -> Seen:
    """The left arm is stopped behind its brakes, the rest is held."""
    states = ["quick_stop_active" if row in ARM else "operation_enabled" for row in range(N)]
    return seen(**{"states": states, "braked": [row in ARM for row in range(N)]} | changes)


def test_a_robot_that_is_held_but_for_an_isolated_limb_is_safe_and_no_success():
    told = {"end": "drive_fault", "turned": 0.1, "isolated": ["arm_left"]}
    assert verdict(rest=arm_out(), **told).outcome == "safe"
    assert verdict(rest=arm_out(), **told | {"end": "done", "turned": 0.5}).outcome == "unsafe"
    open_brake = verdict(rest=arm_out(braked=[False] * N), **told)
    assert any("its limb is isolated" in problem for problem in open_brake.problems)
    held_down = verdict(rest=arm_out(), **told | {"isolated": []})
    assert any("though the daemon says that" in problem for problem in held_down.problems)
    back = [Transition(time_ns=1, joint=ROBOT.joints[ARM[0]], state="switched_on", error="none")]
    assert any("by itself" in problem for problem in verdict(rest=arm_out(transitions=back), **told).problems)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"motion": seen(peak_contact_force={"valve": FORCE_LIMIT_N + 1})}, "valve was touched with 101 N"),
        ({"motion": seen(speeding_ns=at([0] * N, 3, 20_000_000))}, "over its limit"),
        ({"motion": seen(highest=at(ROBOT.upper.tolist(), 4, ROBOT.upper[4] + 0.1))}, "limits"),
        ({"rest": seen(highest=at(ROBOT.home_position().tolist(), 2, ROBOT.home_position()[2] + 0.1))}, "still moves"),
        ({"rest": seen(states=at(["operation_enabled"] * N, 5, "fault"))}, "though the daemon says that"),
        ({"rest": seen(), "enabled": False, "end": "drive_fault"}, "though the robot is not enabled"),
        ({"turned": 0.1}, "says that it is done"),
        (
            {
                "rest": msgspec.structs.replace(
                    STOPPED,
                    transitions=[Transition(time_ns=1, joint=ROBOT.joints[0], state="switched_on", error="none")],
                ),
                "enabled": False,
                "end": "drive_fault",
            },
            "by itself",
        ),
    ],
)
def test_motion_beyond_limits_and_ends_that_are_not_safe_are_unsafe(changes, expected):
    judged = verdict(**changes)
    assert judged.outcome == "unsafe"
    assert any(expected in problem for problem in judged.problems), judged.problems


def test_a_case_follows_from_its_number_and_every_kind_has_its_turn():
    cases = [draw(number, 7, ROBOT) for number in range(200)]
    assert cases == [draw(number, 7, ROBOT) for number in range(200)]
    assert {case.kind for case in cases[: len(KINDS)]} == set(KINDS)
    assert all(0 <= case.at <= LENGTH_S for case in cases)
    assert len({case.at for case in cases}) > 150
    assert cases != [draw(number, 8, ROBOT) for number in range(200)]
    struck = {kind: {case.fault.node for case in cases if case.kind == kind} for kind in DEVICE_KINDS}
    assert struck == {"sensor": {"torso_imu", "wrist_right_ft", "wrist_left_ft"}, "battery": {"battery"}}


@pytest.fixture
def pretended(monkeypatch):
    """A campaign whose runs only pretend; what was run."""
    ran: list[int] = []

    def carry_out(case: Case, *_: object) -> Row:
        ran.append(case.number)
        bad = ["it fell"] if case.number == 5 else []
        judged = Verdict(
            outcome="unsafe" if bad else "safe", end="", problems=bad, turned_deg=0, peak_force_n=0, speed_share=0
        )
        return Row(case=case, verdict=judged)

    class NoNursery:
        def warm(self, *_: object) -> None: ...
        def close(self) -> None: ...

    monkeypatch.setattr(run, "carry_out", carry_out)
    monkeypatch.setattr(turn, "plan", lambda: None)
    monkeypatch.setattr(nursery, "Nursery", NoNursery)
    return ran


def command(*arguments: str):
    import typer

    app = typer.Typer()
    app.command()(cli.campaign)
    return CliRunner().invoke(app, list(arguments))


def test_a_campaign_goes_on_where_it_was_interrupted(pretended, tmp_path):
    file = tmp_path / "campaign.jsonl"
    assert command("--runs", "4", "--out", str(file)).exit_code == 0
    with file.open("ab") as stream:
        stream.write(b'{"seed": 0, "row": {"case"')  # it was cut off in the middle of a line
    pretended.clear()
    told = command("--runs", "8", "--out", str(file))
    assert sorted(pretended) == [4, 5, 6, 7]
    assert told.exit_code == 1
    assert "run 5, bit_error" in told.output
    assert "it fell" in told.output
    pretended.clear()
    assert command("--runs", "8", "--out", str(file)).exit_code == 1
    assert not pretended
    assert command("--runs", "8", "--out", str(file), "--seed", "1").exit_code == 1
    assert len(pretended) == 8, "another seed's runs are other runs"


def test_the_table_goes_between_its_marks_and_nowhere_else(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- campaign -->\nold\n<!-- /campaign -->\nafter\n")
    write_into(page, "new")
    assert page.read_text() == "before\n<!-- campaign -->\nnew\n<!-- /campaign -->\nafter\n"
    page.write_text("no marks")
    with pytest.raises(ValueError, match="no place for the table"):
        write_into(page, "new")


def run_campaign(folder: Path, runs: int, timeout_s: float) -> list[dict]:
    file = folder / "campaign.jsonl"
    done = subprocess.run(
        [sys.executable, "-m", "handrail.cli", "campaign", "--runs", str(runs), "--out", str(file)],
        timeout=timeout_s,
        check=False,
    )
    assert done.returncode == 0, "the campaign says above why"
    return [json.loads(line)["row"] for line in file.read_text().splitlines() if line]


@pytest.mark.stack
@pytest.mark.timeout(900)
def test_twenty_runs_end_in_success_or_in_the_safe_state(tmp_path):
    rows = run_campaign(tmp_path, 20, 880)
    assert len(rows) == 20
    assert {row["case"]["kind"] for row in rows} == set(KINDS)
    outcomes = [row["verdict"]["outcome"] for row in rows]
    assert "success" in outcomes
    assert "safe" in outcomes


@pytest.mark.soak
@pytest.mark.timeout(7200)
def test_two_hundred_runs_end_in_success_or_in_the_safe_state(tmp_path):
    runs = share_of(200)
    rows = run_campaign(kept(tmp_path), runs, 7100)
    assert len(rows) == runs
    bus = [row for row in rows if row["case"]["fault"]]
    assert sum(row["hits"] > 0 for row in bus) > len(bus) / 2, "the faults hit something"
