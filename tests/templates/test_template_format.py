"""What a template's file can say, and what one that says it wrongly is told."""

from __future__ import annotations

import json
import math
from pathlib import Path

import jsonschema
import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from affordance_templates import catalogue, template_file
from affordance_templates.template_schema import json_schema
from handrail.config import ConfigError, parse


def waypoint(resolved, name):
    trajectory, _, point = name.partition(".")
    return next(each for each in resolved.trajectories[trajectory].waypoints if each.name == point)


def test_what_hangs_on_a_joint_goes_with_it_and_with_the_joints_that_carry_that(cabinet):
    closed = cabinet.resolve()
    open_ = cabinet.resolve(joint_state={"hinge": math.pi / 2, "latch": math.pi / 6})
    assert closed.frame("handle")[:3, 3] == pytest.approx([-0.05, 0.55, 0])
    assert open_.frame("handle")[:3, 3] == pytest.approx([-0.55, -0.05, 0])
    assert open_.joints["latch"].origin == pytest.approx([-0.55, 0, 0])
    assert open_.joints["latch"].axis == pytest.approx([0, 1, 0])
    assert open_.frame("frame") == pytest.approx(closed.frame("frame"))


def test_a_parameter_moves_all_that_is_said_with_it(cabinet):
    wide = cabinet.resolve({"width": 0.8, "swing": -1}, {"hinge": math.pi / 2})
    assert wide.frame("handle")[:3, 3] == pytest.approx([0.75, 0.05, 0])
    assert wide.frame("edge(0.2)")[:3, 3] == pytest.approx([0.8, 0, 0.2])
    sizes = {shape.object: shape.size for shape in wide.shapes}
    assert sizes["leaf"] == (0.02, 0.8, 0.7)


def test_features_are_picked_by_index_and_by_argument(cabinet):
    resolved = cabinet.resolve({"buttons": 4})
    assert resolved.frame("button[3]")[:3, 3] == pytest.approx([-0.01, 0, 0.15])
    assert -resolved.frame("button[3]")[:3, 2] == pytest.approx([1, 0, 0]), "a hand there points at the button"
    assert resolved.frame("edge")[:3, 3] == pytest.approx([0, 0.6, 0])
    assert resolved.frame("edge(2 * 0.1)")[:3, 3] == pytest.approx([0, 0.6, 0.2])
    assert resolved.frame("axle")[:3, 0] == pytest.approx([0, 0, 1])
    assert resolved.features["button"].indices == (4,)
    pressed = cabinet.resolve({"buttons": 4}, {"press[3]": 0.005})
    assert pressed.frame("button[3]")[0, 3] == pytest.approx(-0.005)


@pytest.mark.parametrize(
    ("reference", "says"),
    [
        ("button[7]", r"expected button\[i\], from 0 to 2"),
        ("button[0.5]", "whole number"),
        ("button", r"expected button\[i\]"),
        ("edge(9)", "height of edge: got 9; expected -0.35 to 0.35"),
        ("edge(1, 2)", r"expected edge\(height\)"),
        ("edge(__import__('os'))", "can't be called"),
        ("rim", "expected one of button, edge, axle"),
    ],
)
def test_a_feature_that_is_not_there_is_told_which_are(cabinet, reference, says):
    with pytest.raises(ValueError, match=says):
        cabinet.resolve().frame(reference)


def test_waypoints_follow_the_joints_that_those_before_them_moved(cabinet):
    resolved = cabinet.resolve()
    turned, swung, away = (waypoint(resolved, f"open.{name}") for name in ("turn", "swing", "away"))
    still = cabinet.resolve(joint_state={"latch": math.radians(30), "hinge": math.radians(60)})
    assert swung.position == pytest.approx(still.frame("handle")[:3, 3])
    assert turned.pose_in_template[:3, :3] != pytest.approx(swung.pose_in_template[:3, :3])
    assert away.position == pytest.approx((still.frame("handle") @ [-0.1, 0, 0, 1])[:3])


def test_a_waypoint_says_what_the_hand_does_there(cabinet):
    resolved = cabinet.resolve()
    grasp, turn = waypoint(resolved, "open.grasp"), waypoint(resolved, "open.turn")
    assert (grasp.until, grasp.speed, grasp.hand_pose) == (5, 0.05, "closed")
    assert grasp.tool == pytest.approx([0, 0, -0.02])
    assert grasp.tolerance.rotation == pytest.approx(np.radians([5, 5, 20]))
    assert grasp.axis == pytest.approx([1, 0, 0]) and abs(grasp.pose_in_template[2, 1]) == pytest.approx(1)
    assert np.linalg.norm(turn.force) == pytest.approx(10)
    assert grasp.stance.position == pytest.approx([-0.8, 0.3, 0])
    assert waypoint(resolved, "open.away").tolerance.rotation[2] == math.pi, (
        "nothing said how it is turned about its axis"
    )
    assert resolved.trajectories["open"].hand == "opening" and resolved.trajectories["open"].side == "right"
    assert cabinet.hands == ("opening", "holding", "hand")


def test_there_is_a_trajectory_for_each_of_what_is_repeated(cabinet):
    resolved = cabinet.resolve({"buttons": 2})
    assert [name for name in resolved.trajectories if name.startswith("push")] == ["push[0]", "push[1]"]
    assert resolved.frame("push[1].down")[:3, 3] == pytest.approx([-0.01, 0, 0.05])


def test_trajectories_of_two_hands_meet_at_the_points_that_are_said(cabinet):
    both = cabinet.resolve().syncs["both"]
    assert both.trajectories == ("open", "hold")
    assert both.points == ({"open": 2, "hold": 0}, {"open": 3, "hold": 1})


@pytest.mark.parametrize(
    ("old", "new", "field", "expectation"),
    [
        ("joint: hinge\n    shapes", "parent: handle\n    shapes", "objects.leaf", "carries itself"),
        (
            "joint: hinge\n    shapes",
            "joint: hinge\n    parent: frame\n    shapes",
            "objects.leaf.parent",
            "one of both",
        ),
        ("material: steel\n    editable", "material: stell\n    editable", "objects.frame.material", "one of steel"),
        ("editable: {y: width}", "editable: {y: depth}", "objects.frame.editable.y", "one of the parameters"),
        ("lower: 0, upper: 45", "lower: 99, upper: 45", "joints.latch.lower", "at most upper"),
        ("choices: [-1, 1]", "choices: [2]", "parameters.swing.default", "one of 2"),
        ('on: "key[i]"', 'on: "key[9]"', "features.button.on", "expected one of frame"),
        ("axis: [0, 0, 1]}", "pointing: [0, 0, 1]}", "features.axle.axis", "direction of the axis"),
        ("across: [0, 1, 0]}", "across: [1, 0, 0]}", "features.button.across", "is parallel"),
        ("frame: edge(0.1)", "frame: edge(9)", "trajectories.hold.waypoints[0].frame", "expected -0.35 to 0.35"),
        ("        until: 5\n", "", "trajectories.open.waypoints[1].until", "the force"),
        ("joint: latch, to", "joint: lach, to", "trajectories.open.waypoints[2].joint", "expected one of hinge"),
        ("speed: 0.05", "speed: -1", "trajectories.open.waypoints[1].speed", "above 0"),
        ("[open.turn, hold.touch]", "[open.turn, hold.tuch]", "sync.both.points[0][1]", "expected a waypoint"),
        ("[[open.turn, hold.touch]", "[[open.away, hold.touch]", "sync.both.points[1][0]", "in order"),
        ("trajectories: [open, hold]", "trajectories: [open, open]", "sync.both.trajectories[1]", "another hand"),
        (
            "kind: capsule, size",
            "kind: mesh, file: ../a.stl, size",
            "objects.handle.shapes[0].size",
            "expected 3 of a mesh",
        ),
        ("kind: capsule, size: [0.01, 0.1]", "kind: mesh, file: ../a.stl", "objects.handle.shapes[0].file", "beside"),
        ("width: {default: 0.6", "width: {default: .nan", "parameters.width.default", "nan"),
        (
            "repeat: {i: buttons}\n    joint",
            "repeat: {pi: buttons}\n    joint",
            "objects.key.repeat.pi",
            "another name",
        ),
        ("grip: ${width", "width: ${width", "definitions.width", "a parameter as well"),
    ],
)
def test_a_wrong_file_is_told_line_field_and_expectation(template_of, cabinet_text, old, new, field, expectation):
    assert old in cabinet_text
    with pytest.raises(ConfigError) as caught:
        template_of(cabinet_text.replace(old, new, 1))
    assert caught.value.field.startswith(field), str(caught.value)
    assert expectation in caught.value.problem
    assert caught.value.line


def test_aliases_of_aliases_are_refused_before_they_cost_anything(template_of):
    rows = "\n".join(f"  - &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 12))
    with pytest.raises(ConfigError, match="expected fewer"):
        template_of(f"title: laughter\nobjects:\n  - &a0 [1]\n{rows}\n")


def test_the_schema_takes_every_template_of_the_library_and_refuses_what_readers_refuse(cabinet_text):
    schema = jsonschema.Draft202012Validator(json.loads(json.dumps(json_schema(), allow_nan=False)))
    for name in catalogue.files():
        schema.validate(catalogue.load(name).document.data)
    whole = parse(cabinet_text, Path("cabinet.yaml")).data
    schema.validate(whole)
    whole["trajectories"]["open"]["waypoints"][0]["aproach"] = "free"
    with pytest.raises(jsonschema.ValidationError, match="aproach"):
        schema.validate(whole)


@given(data=st.data())
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_file_that_lost_or_changed_a_piece_is_read_or_refused_with_its_name(data, tmp_path, cabinet_text):
    start = data.draw(st.integers(0, len(cabinet_text) - 1))
    length = data.draw(st.integers(0, 30))
    piece = data.draw(st.sampled_from(["", "0", "-", "[", "{}", "null", "width", "&a", "${", "1e999", "\t", "true"]))
    file = tmp_path / "mangled.yaml"
    text = cabinet_text[:start] + piece + cabinet_text[start + length :]
    try:
        template_file.of(parse(text, file), text.encode())
    except ConfigError as problem:
        assert str(file) in str(problem) and problem.problem


LIBRARY = sorted((Path(template_file.__file__).parent / "library").glob("*.yaml"))
WRONG = [
    None,
    True,
    [],
    {},
    "nonsense",
    "1 +",
    "${",
    -1e9,
    1e300,
    float("nan"),
    [[1]],
    {"x": 1},
    [0, 0, 0],
    "repeat",
    3,
]


def _places(node, path=()):
    """Every field and element, innermost ones too."""
    for key, value in node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ():
        yield (*path, key)
        yield from _places(value, (*path, key))


@given(data=st.data())
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_whatever_stands_where_something_else_should_is_refused_by_line_field_and_expectation(data, tmp_path):
    whole = yaml.safe_load(data.draw(st.sampled_from(LIBRARY)).read_text())
    *above, last = data.draw(st.sampled_from(list(_places(whole))))
    parent = whole
    for key in above:
        parent = parent[key]
    match data.draw(st.sampled_from(["wrong", "gone", "unknown"])):
        case "wrong":
            parent[last] = data.draw(st.sampled_from(WRONG))
        case "gone":
            del parent[last]
        case "unknown" if isinstance(parent, dict):
            parent["colour_of_the_sky"] = 1
    file, text = tmp_path / "odd.yaml", yaml.safe_dump(whole, sort_keys=False)
    try:
        template_file.of(parse(text, file), text.encode())
    except ConfigError as problem:
        assert problem.field, str(problem)
        nowhere = problem.line is None and "missing" in problem.problem  # of the whole file
        assert nowhere or 1 <= (problem.line or 0) <= text.count("\n") + 1, str(problem)
        assert any(word in problem.problem.lower() for word in ("expected", "missing", "unknown", "no such", "must")), (
            problem.problem
        )
