"""`handrail daemon stats`, `hardware status` and `safety explain` against a robot that is up, and where none is."""

import msgspec
import pytest
from typer.testing import CliRunner

from daemon import cli
from hal.drives.lifecycle import DriveError
from hal.hil.daemon import OWNER
from handrail import messages as m

pytestmark = [pytest.mark.handrail(robot="sea_bench"), pytest.mark.timeout(300)]

JOINTS = ("shoulder_joint", "elbow_joint")


def table(text: str) -> dict[str, dict[str, str]]:
    """The first word of each row → heading → word."""
    heads, *rows = (line.split() for line in text.splitlines() if line and not line.startswith("handrail "))
    return {row[0]: dict(zip(heads, row, strict=True)) for row in rows}


def test_the_commands_tell_of_the_running_robot_and_name_what_is_wrong(robot, handrail_rig):
    def run(app, *words: str):
        return CliRunner().invoke(app, [*words, "--runtime", str(handrail_rig.folder)])

    robot.plant.wait(0.3)
    told = run(cli.daemon, "stats", "--json", "--reset")
    assert told.exit_code == 0, told.output
    timing = msgspec.json.decode(told.stdout, type=m.LoopTiming)
    assert timing.clock == "lockstep"
    assert timing.cycles == sum(timing.work.counts) > 150
    assert 1.0 < timing.work.p50_us <= timing.work.p90_us <= timing.work.p99_us <= timing.work.max_us
    assert not any(timing.late.counts)
    robot.plant.wait(0.1)
    shown = run(cli.daemon, "stats")
    assert shown.exit_code == 0, shown.output
    robot.plant.wait(0.2)  # a status is told now and then: that of before may be older than what was shown
    all_cycles = robot.daemon.call(m.GetStatus()).loop.cycles
    assert 0 < int(shown.stdout.split()[0]) <= all_cycles - timing.cycles, "--reset counts anew"
    assert "overrun: the plant waits for the loop" in shown.stdout
    counted = [line.split() for line in shown.stdout.splitlines() if "…" in line]
    assert sum(int(line[line.index("%") - 2]) for line in counted) == int(shown.stdout.split()[0])
    assert any(line[-1].startswith("█") for line in counted)

    assert run(cli.daemon, "speed").stdout == "motions run at 100 % of the planned speed\n"
    assert run(cli.daemon, "speed", "40").stdout == "motions run at 40 % of the planned speed\n"
    robot.daemon.wait_status(lambda status: status.speed == 0.4, "every client hears it")
    assert run(cli.daemon, "speed", "5").exit_code == 2
    assert "no such action is running" in run(cli.daemon, "speed", "50", "--action", "nobody's").output

    well = run(cli.hardware, "status")
    assert well.exit_code == 0, well.output
    parts = table(well.stdout)
    for joint in JOINTS:
        assert parts[joint]["life"] == "active"
        assert parts[joint]["state"] == "operation_enabled"
        assert int(parts[joint]["protocol"]) > 0
        assert int(parts[joint]["firmware"]) > 0
        assert int(parts[joint]["age"]) <= 2
        assert float(parts[joint]["°C"]) > 10.0
    assert parts["supply"]["life"] == "active"
    free = run(cli.safety, "explain")
    assert free.exit_code == 0, free.output
    assert "no safety rule holds it" in free.stdout
    assert "every part is free" in run(cli.safety, "leases").stdout
    robot.daemon.call(m.TakeLease(owner=OWNER, part="body"))
    assert run(cli.safety, "leases").stdout.splitlines()[1].split() == ["body", OWNER, "1"]
    robot.daemon.call(m.SwitchRelay(power="supply", closed=False, force=True))
    robot.plant.wait_state(JOINTS, "fault")
    robot.daemon.wait_status(lambda status: all(d.state == "fault" for d in status.drives), "the faults are told")
    ill = run(cli.hardware, "status")
    assert ill.exit_code == 1
    parts = table(ill.stdout)
    assert {parts[joint]["life"] for joint in JOINTS} == {"inactive"}
    assert {parts[joint]["error"] for joint in JOINTS} == {str(int(DriveError.UNDERVOLTAGE))}
    assert "elbow_joint: fault: undervoltage" in ill.output
    why = run(cli.safety, "explain")
    assert why.exit_code == 1
    assert "is inactive, held by drive_fault (the drive of shoulder_joint: fault: undervoltage)" in why.stdout
    told = msgspec.json.decode(run(cli.safety, "explain", "--json").stdout, type=m.SafetyReport)
    assert [rule.rule for rule in told.rules if rule.holds] == ["drive_fault"]


@pytest.mark.parametrize(
    ("app", "words"),
    [
        (cli.daemon, ["stats"]),
        (cli.daemon, ["speed", "50"]),
        (cli.hardware, ["status"]),
        (cli.safety, ["explain"]),
        (cli.safety, ["keepalive", "me"]),
    ],
)
def test_the_commands_say_in_a_line_that_no_robot_is_up_and_what_to_do(tmp_path, app, words):
    nobody = CliRunner().invoke(app, [*words, "--runtime", str(tmp_path)])
    assert nobody.exit_code == 1
    assert "no robot is up in" in nobody.output and "handrail up" in nobody.output
    assert len(nobody.output.strip().splitlines()) == 1
