"""The templates that Handrail brings, and `handrail template`."""

from __future__ import annotations

import math

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from affordance_templates import catalogue
from affordance_templates.cli import app, corners

LIBRARY = ("box", "button_panel", "cap", "cylinder", "door", "drill", "lever_valve", "wheel")


def run(*arguments: str):
    return CliRunner().invoke(app, list(arguments), env={"COLUMNS": "200"})


@pytest.mark.parametrize("name", LIBRARY)
def test_a_template_resolves_at_every_bound_of_its_parameters(name):
    assert len(corners(catalogue.load(name))) >= 14


@pytest.mark.parametrize("name", LIBRARY)
def test_no_waypoint_along_a_joint_leaves_its_limits(name):
    resolved = catalogue.load(name).resolve()
    for trajectory in resolved.trajectories.values():
        at = {joint.name: joint.position for joint in resolved.joints.values()}
        for waypoint in trajectory.waypoints:
            if waypoint.joint and waypoint.to != "arc_end":
                joint = resolved.joints[waypoint.joint]
                at[joint.name] += waypoint.to
                if trajectory.entry is None:
                    assert joint.lower - 1e-9 <= at[joint.name] <= joint.upper + 1e-9, (
                        f"{trajectory.name}.{waypoint.name}"
                    )


@pytest.mark.parametrize("hinge_side", [1, -1])
@pytest.mark.parametrize("opens", [1, -1])
def test_a_door_opens_to_its_side_and_its_handle_goes_down(hinge_side, opens):
    door = catalogue.load("door")
    shut = door.resolve({"hinge_side": hinge_side, "opens": opens})
    ajar = door.resolve({"hinge_side": hinge_side, "opens": opens}, {"hinge": 0.3, "latch": 0.3})
    assert (ajar.frame("edge")[0, 3] - shut.frame("edge")[0, 3]) * opens > 0.1
    assert shut.frame("edge")[1, 3] * hinge_side < 0
    assert ajar.frame("lever")[2, 3] < shut.frame("lever")[2, 3] - 0.02
    swing = next(each for each in shut.trajectories["open"].waypoints if each.name == "swing")
    expected = door.resolve(
        {"hinge_side": hinge_side, "opens": opens}, {"hinge": math.radians(30), "latch": math.radians(40)}
    )
    assert swing.position == pytest.approx(expected.frame("lever")[:3, 3])


def test_a_thread_raises_the_cap_by_its_pitch():
    cap = catalogue.load("cap")
    turned = cap.resolve({"pitch": 4}, {"thread": 2 * math.pi})
    assert turned.frame("lid")[2, 3] == pytest.approx(0.004)
    twist = cap.resolve({"pitch": 4, "twist": 180}).trajectories["twist"].waypoints
    hold, twisted = (next(each for each in twist if each.name == name) for name in ("hold", "twist"))
    assert twisted.position[2] - hold.position[2] == pytest.approx(0.002)
    assert hold.pose_in_template[:3, 1] @ twisted.pose_in_template[:3, 1] == pytest.approx(-1)


def test_a_lever_turns_to_the_operators_right_and_the_hand_with_it():
    valve = catalogue.load("lever_valve").resolve()
    turned = next(each for each in valve.trajectories["turn"].waypoints if each.name == "turn")
    assert turned.position == pytest.approx([0, -0.128, 0], abs=1e-9)
    assert np.linalg.norm(turned.force) == pytest.approx(40) and turned.force[2] == pytest.approx(-40)


def test_the_third_button_is_in_the_second_row():
    panel = catalogue.load("button_panel").resolve({"buttons": 3})
    assert panel.frame("button[2]")[1:3, 3] == pytest.approx([0.03, -0.03])
    assert list(panel.trajectories) == ["push[0]", "push[1]", "push[2]"]


def test_show_says_what_there_is_with_the_numbers_given():
    shown = run("show", "door", "--set", "opening=45", "--joint", "hinge=0.2")
    assert shown.exit_code == 0
    assert "edge(height)" in shown.output and "hinge to 0.785" in shown.output


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["show", "whale"], "no such template"),
        (["show", "door", "--set", "opening"], "expected NAME=NUMBER"),
        (["show", "door", "--set", "opening=400"], "expected 2 to 110"),
        (["show", "door", "--joint", "lid=1"], "expected one of hinge, latch"),
        (["render", "box", "--trajectory", "fly"], "expected one of grasp"),
    ],
)
def test_what_can_not_be_shown_is_refused_with_what_was_expected(arguments, says):
    refused = run(*arguments)
    assert refused.exit_code != 0 and says in f"{refused.output}{refused.exception}"


def test_check_fails_for_a_file_that_resolves_only_at_some_bounds(tmp_path):
    file = tmp_path / "half.yaml"
    text = (
        catalogue.files()["box"]
        .read_text()
        .replace("depth: {default: 0.06, unit: m, min: 0.01", "depth: {default: 0.06, min: 0")
    )
    file.write_text(text)
    checked = run("check", "box", str(file))
    assert checked.exit_code == 1
    assert "box: sound" in checked.output and "with depth 0:" in checked.output


def test_what_is_wrong_is_said_whole_and_its_file_once(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "odd.yaml").write_text("title: Odd\nobjects: {bar: {shapes: [{kind: box, size: [1, 1]}]}}\n")
    checked = run("check", "odd.yaml")
    assert checked.exit_code == 1 and checked.output.count("odd.yaml") == 1
    assert "objects.bar.shapes[0].size" in checked.output, "brackets are no colours"
    assert run("check", "nothing").output.startswith("nothing: template: no such template; expected one of box")


def test_a_picture_shows_the_object_and_the_hand(tmp_path):
    file = tmp_path / "box.png"
    assert run("render", "box", "--png", str(file)).exit_code == 0
    picture = np.asarray(Image.open(file)).astype(int)
    red, blue = picture[..., 0], picture[..., 2]
    assert picture.shape == (720, 960, 3)
    assert (red > blue + 40).sum() > 5000, "the box"
    assert (blue > red + 40).sum() > 3000, "the hand"
