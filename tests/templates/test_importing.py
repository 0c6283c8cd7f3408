"""Templates of others become ours, and what has no counterpart is listed."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from affordance_templates import authoring, importing, template_file
from affordance_templates.cli import app
from handrail.config import ConfigError, parse

OTDF = """<?xml version="1.0" ?>
<object name="gate">
  <param name="x" default_value="0.0" inc="0.001" min="-100" max="100" />
  <param name="leaf-width" default_value="0.8" inc="0.01" min="0.3" max="1.5" />
  <param name="thickness" default_value="0.05" />
  <link name="post"><visual><geometry><cylinder radius="${thickness}" length="1.0"/></geometry></visual></link>
  <link name="leaf">
    <inertial><mass value="3"/></inertial>
    <visual>
      <origin xyz="0 ${leaf-width/2} 0" rpy="0 0 0"/>
      <geometry><box size="0.03 ${leaf-width} 0.9"/></geometry>
      <material name="red"><color rgba="0.8 0.1 0.1 1.0"/></material>
    </visual>
    <collision><geometry><box size="1 1 1"/></geometry></collision>
  </link>
  <link name="bolt"><visual><material name="steel"/><geometry><mesh filename="bolt.stl"/></geometry></visual></link>
  <joint name="hinge" type="revolute">
    <origin xyz="${thickness} 0 0" rpy="0 0 0"/><parent link="post"/><child link="leaf"/>
    <axis xyz="0 0 1"/><limit lower="0" upper="1.6" effort="30"/><dynamics damping="1"/>
  </joint>
  <joint name="weld" type="fixed"><origin xyz="0 ${leaf-width} 0" rpy="0 0 1.5"/><parent link="leaf"/><child link="bolt"/></joint>
  <bounding_volume name="near"/>
</object>
"""

ATDF = """<?xml version="1.0" ?>
<affordance_template name="Hatch" image="package://images/hatch.jpg">
  <display_objects>
    <display_object name="Root Object">
      <geometry><cylinder radius=".15" length=".2"/></geometry>
      <material name="Cyan"><color rgba="0 1.0 1.0 1.0"/></material>
      <origin xyz="0 0 0.1" rpy="0 0 0"/><controls xyz="1 1 1" rpy="1 1 1" scale="0.25"/>
    </display_object>
    <display_object name="knob" parent="Root Object">
      <geometry><sphere radius=".03"/></geometry><origin xyz="0 0 0.1" rpy="0 0 1.57"/>
    </display_object>
  </display_objects>
  <end_effector_waypoints>
    <end_effector_waypoint end_effector="0" id="0" display_object="knob">
      <origin xyz="0 0 0.2" rpy="0 0 0"/><controls xyz="1 1 1" rpy="1 1 1" scale="0.1"/>
    </end_effector_waypoint>
    <end_effector_waypoint end_effector="0" id="1" ee_pose="2" display_object="knob">
      <origin xyz="0 0 0.02" rpy="0 0 0"/>
    </end_effector_waypoint>
  </end_effector_waypoints>
</affordance_template>
"""


def nasa_json() -> dict:
    def row(side: float, pose: int) -> dict:
        origin = {"xyz": [0.0, side, -0.1], "rpy": [0.0, -1.57, 0.0]}
        return {"ee_pose": pose, "display_object": "wheel", "origin": origin, "planner_type": "CARTESIAN"}

    groups = [
        {"id": hand, "end_effector_waypoint": [row(side, 0), row(side, 2)]} for hand, side in ((0, 0.3), (1, -0.3))
    ]
    turned = {"xyz": [0, 0, 0], "rpy": [0, 1.57, 0]}
    return {
        "name": "Wheel",
        "display_objects": [{"name": "wheel", "shape": "box", "size": [0.3, 0.3, 0.05], "origin": turned}],
        "end_effector_trajectory": [{"name": "Two Handed Turn", "end_effector_group": groups}],
    }


def imported(tmp_path, name: str, text: str):
    file = tmp_path / name
    file.write_text(text)
    found = importing.read(file)
    target = tmp_path / "ours.yaml"
    return authoring.with_meshes(found.text, target, found.meshes), "\n".join(found.left_out)


def test_an_otdf_keeps_parameters_expressions_links_and_joints(tmp_path):
    gate, left = imported(tmp_path, "gate.otdf", OTDF)
    assert gate.parameters["leaf_width"].step == 0.01 and "x" not in gate.parameters
    wide = gate.resolve({"leaf_width": 1.0}, {"hinge": math.pi / 2})
    leaf = next(shape for shape in wide.shapes if shape.object == "leaf")
    assert leaf.size == (0.03, 1.0, 0.9) and leaf.color == (0.8, 0.1, 0.1, 1.0)
    assert leaf.pose_in_template[:3, 3] == pytest.approx([0.05 - 0.5, 0, 0])
    assert wide.frame("bolt")[:3, 3] == pytest.approx([0.05 - 1.0, 0, 0])
    for part in (
        "'x'",
        "<inertial>",
        "<collision>",
        "<mesh>",
        "<dynamics>",
        "limit effort",
        "<bounding_volume name='near'>",
    ):
        assert part in left


WHEEL = """<?xml version="1.0" ?>
<object name="wheel">
  <param name="n" default_value="4" min="2" max="8"/><param name="r" default_value="0.2"/>
  <link name="hub"><collision><geometry><sphere radius="0.03"/></geometry></collision></link>
  <link_pattern name="spoke" noofrepetitions="${n}">
    <visual><origin xyz="${r/2} 0 0"/><geometry><box size="${r} 0.01 0.01"/></geometry></visual>
    <collision><geometry><sphere radius="1"/></geometry></collision>
  </link_pattern>
  <joint_pattern name="spokes" type="fixed" noofrepetitions="${n}">
    <pattern_offset xyz="0 0 0" rpy="0 0 ${6.283185307/n}"/><parent link="hub"/><child link="spoke"/>
  </joint_pattern>
  <link_pattern name="key" noofrepetitions="3">
    <visual><geometry><mesh filename="package://parts/key.obj" scale="1 1 2"/></geometry></visual>
  </link_pattern>
  <joint_pattern name="press" type="prismatic" noofrepetitions="3">
    <origin xyz="0.1 0 ${r}"/><pattern_offset xyz="0 0.05 0"/><parent link="hub"/><child link="key"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="0.01"/>
  </joint_pattern>
</object>
"""
TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def test_patterns_are_as_many_as_the_parameter_says_each_further_along_and_turned(tmp_path):
    (tmp_path / "key.obj").write_text(TETRAHEDRON)
    wheel, left = imported(tmp_path, "wheel.otdf", WHEEL.replace("package://parts/", ""))
    for n in (4, 6):
        resolved = wheel.resolve({"n": n, "r": 0.4}, {"press[1]": 0.01})
        ends = [resolved.frame(f"spoke[{i}]") @ [0.4, 0, 0, 1] for i in range(n)]
        expected = [[0.4 * math.cos(2 * math.pi * i / n), 0.4 * math.sin(2 * math.pi * i / n), 0] for i in range(n)]
        assert np.array(ends)[:, :3] == pytest.approx(np.array(expected), abs=1e-8)
        assert resolved.frame("key[0]")[:3, 3] == pytest.approx([0.1, 0, 0.4])
        assert resolved.frame("key[1]")[:3, 3] == pytest.approx([0.11, 0.05, 0.4])
        hub = next(shape for shape in resolved.shapes if shape.object == "hub")
        assert (hub.kind, hub.size) == ("sphere", (0.03,)), "what is not drawn is what is kept clear of"
        assert len([shape for shape in resolved.shapes if shape.kind == "mesh"]) == 3
    assert left == "link spoke, <collision>: planners keep clear of what is drawn"


def test_meshes_come_along_and_one_that_is_not_there_is_listed(tmp_path, monkeypatch):
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path / "mine"))
    package = tmp_path / "parts"
    (package / "otdf").mkdir(parents=True)
    (package / "otdf" / "wheel.otdf").write_text(WHEEL)

    def run(name):
        return CliRunner().invoke(app, ["import", str(package / "otdf" / "wheel.otdf"), "--name", name])

    assert "left out: link key, geometry <mesh>: package://parts/key.obj: not found" in run("bare").output
    (package / "key.obj").write_text(TETRAHEDRON)
    assert "<mesh>" not in run("whole").output
    folder = tmp_path / "mine" / "affordance_templates"
    assert (folder / "meshes" / "key.obj").read_text() == TETRAHEDRON
    shape = next(each for each in template_file.read(folder / "whole.yaml").resolve().shapes if each.kind == "mesh")
    assert shape.size == (1, 1, 2) and shape.file == folder / "meshes" / "key.obj"
    (package / "key.obj").write_text(TETRAHEDRON + "# another\n")
    other = run("other")
    assert other.exit_code == 1 and "key.obj: is there already, and another mesh" in other.output + str(other.exception)
    assert not (folder / "other.yaml").exists()


def test_a_pattern_of_links_has_one_of_joints(tmp_path):
    with pytest.raises(ConfigError, match="link_pattern spoke, joint spokes: several of one"):
        imported(
            tmp_path, "wheel.otdf", WHEEL.replace("joint_pattern", "joint", 1).replace("/joint_pattern", "/joint", 1)
        )


def test_nasas_meshes_come_along(tmp_path):
    (tmp_path / "hatch.stl").write_text("solid hatch\nendsolid hatch\n")
    given = ATDF.replace('<sphere radius=".03"/>', '<mesh filename="hatch.stl" scale="2 2 2"/>')
    (tmp_path / "hatch.atdf").write_text(given)
    found = importing.read(tmp_path / "hatch.atdf")
    assert found.meshes == {"meshes/hatch.stl": tmp_path / "hatch.stl"}
    assert "kind: mesh" in found.text and "2" in found.text


def test_an_atdf_keeps_objects_and_waypoints(tmp_path):
    hatch, left = imported(tmp_path, "hatch.atdf", ATDF)
    resolved = hatch.resolve()
    assert resolved.frame("knob")[:3, 3] == pytest.approx([0, 0, 0.2])
    first, second = resolved.trajectories["waypoints"].waypoints
    assert first.position == pytest.approx([0, 0, 0.4]) and second.hand_pose == "pose2"
    assert resolved.shapes[0].color == (0, 1, 1, 1)
    assert "image" in left and "controls" in left


def test_a_trajectory_for_two_hands_becomes_two_that_meet(tmp_path):
    wheel, left = imported(tmp_path, "wheel.json", json.dumps(nasa_json()))
    both = wheel.resolve().syncs["two_handed_turn"]
    assert both.trajectories == ("two_handed_turn_hand0", "two_handed_turn_hand1") and len(both.points) == 2
    assert wheel.hands == ("hand0", "hand1")
    assert "planner_type" in left


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("a.otdf", "<object name='a'><link>", "not XML"),
        ("a.otdf", OTDF.replace('default_value="0.8"', 'default_value="wide"'), "got 'wide'; expected a number"),
        ("a.otdf", OTDF.replace('upper="1.6"', ""), "limit upper"),
        ("a.otdf", OTDF.replace('xyz="0 0 1"/><limit', 'xyz="0 1"/><limit'), "expected 3 numbers"),
        ("a.otdf", "<!DOCTYPE object [<!ENTITY a 'b'>]><object/>", "entities"),
        ("a.xml", "<robot/>", "got <robot>"),
        ("a.json", "{", "not JSON"),
        ("a.json", '{"name": "a"}', "display_objects"),
        ("a.json", '{"display_objects": [3]}', "expected a mapping"),
        ("a.json", '{"display_objects": [], "end_effector_trajectory": 3}', "expected a list"),
        (
            "a.json",
            '{"display_objects": [], "end_effector_trajectory": [{"end_effector_group": 3}]}',
            "expected a list",
        ),
        ("a.json", '{"display_objects": [{"name": "a", "origin": {"xyz": [1, 2]}}]}', "expected 3 numbers"),
    ],
)
def test_a_file_that_is_none_of_these_is_told_what_was_expected(tmp_path, name, text, says):
    file = tmp_path / name
    file.write_text(text)
    with pytest.raises(ConfigError, match=says) as caught:
        importing.read(file)
    assert str(file) in str(caught.value)


def test_import_writes_a_file_that_checks_and_never_over_one_that_is_there(tmp_path, monkeypatch):
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    (tmp_path / "gate.otdf").write_text(OTDF)
    first = CliRunner().invoke(app, ["import", str(tmp_path / "gate.otdf")])
    assert first.exit_code == 0 and "3 objects, 1 joints" in first.output and "left out: " in first.output
    assert template_file.read(tmp_path / "affordance_templates" / "gate.yaml").title == "gate"
    again = CliRunner().invoke(app, ["import", str(tmp_path / "gate.otdf")])
    assert again.exit_code != 0 and "is there already" in str(again.exception) + again.output


@given(data=st.data())
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_mangled_file_is_imported_or_refused(data, tmp_path):
    whole = data.draw(st.sampled_from([OTDF, ATDF, json.dumps(nasa_json())]))
    start = data.draw(st.integers(0, len(whole) - 1))
    piece = data.draw(st.sampled_from(["", "0", '"', "<", ">", "null", "${", "[", "1e999"]))
    file = tmp_path / "mangled"
    file.write_text(whole[:start] + piece + whole[start + data.draw(st.integers(0, 25)) :])
    try:
        found = importing.read(file)
        template_file.of(parse(found.text, file), found.text.encode())
    except ConfigError as problem:
        assert str(file) in str(problem)
