"""`handrail robot`: every robot that comes with Handrail is one robot, and one that isn't is found out."""

from __future__ import annotations

import dataclasses
import json
import re
from pathlib import Path

import msgspec
import pytest
from typer.testing import CliRunner

from hal.robots.check import Row, check
from hal.robots.cli import app
from handrail.robot import library as robots
from handrail.robot.kinematics import Kinematics

BUILT_IN = sorted(file.parent.name for file in (Path(__file__).parents[2] / "hal" / "robots").glob("*/robot.yaml"))


@pytest.mark.parametrize("name", BUILT_IN)
def test_model_plant_and_network_of_a_robot_agree(name):
    rows = list(check(robots.load(name)))
    assert not [row for row in rows if not row.holds]
    assert msgspec.json.decode(msgspec.json.encode(rows), type=list[Row]) == rows
    assert {"model", "limits", "drives", "network"} <= {row.about for row in rows}


def _failing(robot):
    return [row.name for row in check(robot) if not row.holds]


@pytest.fixture(scope="module")
def bench():
    return robots.load("sea_bench")


def test_a_bus_that_is_too_slow_for_its_robot_is_found_out(bench):
    slow = tuple(msgspec.structs.replace(c, bitrate=125_000, data_bitrate=125_000) for c in bench.channels)
    failing = _failing(dataclasses.replace(bench, channels=slow))
    assert len(failing) == 1
    assert failing[0].startswith("can0: load")


def test_a_spring_that_a_step_cannot_take_is_found_out(bench):
    stiff = tuple(msgspec.structs.replace(a, spring_stiffness=1e6, rotor_inertia=100.0) for a in bench.actuators)
    assert any("springs" in name for name in _failing(dataclasses.replace(bench, actuators=stiff)))


def test_the_command_prints_a_table_writes_rows_and_says_by_its_status_whether_all_holds(tmp_path):
    out = tmp_path / "rows.json"
    good = CliRunner().invoke(app, ["check", "sea_bench", "--json", str(out)])
    assert good.exit_code == 0, good.output
    assert "none failed" in good.output
    rows = json.loads(out.read_text())
    assert {"about", "name", "value", "expected", "holds"} == set(rows[0])
    (tmp_path / "wild").mkdir()
    (tmp_path / "wild" / "robot.yaml").write_text(
        "extends: sea_bench\nname: wild\ncontrol:\n  quick_stop_damping: {elbow_joint: 60}\n"
    )
    text = (robots.find("sea_bench").parent / "bench.urdf").read_text()
    (tmp_path / "wild" / "bench.urdf").write_text(text)
    bad = CliRunner().invoke(app, ["check", str(tmp_path / "wild")])
    assert bad.exit_code == 1
    assert "1 failed" in bad.output


def test_the_list_names_every_robot_and_a_broken_one(tmp_path, monkeypatch):
    broken = tmp_path / "robots" / "broken"
    broken.mkdir(parents=True)
    (broken / "robot.yaml").write_text("name: broken\n")
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    monkeypatch.setenv("COLUMNS", "250")
    listed = CliRunner().invoke(app, ["list"])
    assert listed.exit_code == 1
    for name in [*BUILT_IN, "broken"]:
        assert name in listed.output


def test_an_unknown_robot_is_told_which_there_are():
    refused = CliRunner().invoke(app, ["check", "talso"])
    assert refused.exit_code == 1
    assert "talos_upper" in str(refused.exception or refused.output) + refused.output


def test_the_how_tos_robot_loads_as_it_stands_there(tmp_path):
    text = (Path(__file__).parents[2] / "docs" / "robots.md").read_text()
    blocks = re.findall(r"```yaml\n(.*?)```", text.split("## A robot like another one")[0], re.S)
    (tmp_path / "robot.yaml").write_text("\n".join(blocks))
    told, built_in = robots.load(tmp_path), robots.load("z1")
    assert told.joints == built_in.joints
    assert told.urdf == built_in.urdf
    assert told.arms == built_in.arms
    assert told.devices == built_in.devices
    assert (told.stiffness == built_in.stiffness).all()
    assert (told.quick_stop_damping == built_in.quick_stop_damping).all()


@pytest.mark.parametrize("name", BUILT_IN)
def test_the_recorders_frames_are_found_where_a_joint_and_a_link_share_their_name(name):
    robot = robots.load(name)
    kinematics = Kinematics(robot)
    for arm in robot.arms.values():
        assert kinematics.model.frames[kinematics.frame_id(arm.tool)].name == arm.tool
