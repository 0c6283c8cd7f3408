"""A template's trajectory is a program of its own: forwards, backwards, in steps, in rounds, and sound as any other."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from affordance_templates import catalogue
from affordance_templates.instance import Instance
from affordance_templates.server import AffordanceServer
from engines.activities.waypoints import chosen
from engines.programs import program as programs
from engines.programs.from_template import Wish, expand
from engines.template_runs import TemplateRuns
from handrail.messages import ExpandTemplate, PlaceInstance, Pose, RunTemplate
from handrail.robot import library as robots
from handrail.topics import RefusedError


@pytest.fixture(scope="module")
def robot():
    return robots.load("talos_upper_grippers")


def placed(template: str) -> Instance:
    return Instance("it", catalogue.load(template), Pose(position=(0.5, -0.3, 0.1)))


@pytest.fixture
def read(tmp_path):
    """An expanded program, read and checked as any file."""

    def read(expanded):
        file = tmp_path / f"{expanded.name}.yaml"
        file.write_text(expanded.text)
        return programs.read(file)

    return read


@pytest.mark.parametrize("template", sorted(catalogue.files()))
def test_every_trajectory_of_the_library_is_a_sound_program_both_ways_and_in_rounds(robot, read, template):
    for name, trajectory in placed(template).resolve().trajectories.items():
        wishes = [Wish(name, "right"), Wish(name, "left", rounds=3)]
        pushes = any(each.approach == "along" and each.force is not None for each in trajectory.waypoints)
        wishes += [] if trajectory.entry or pushes else [Wish(name, "right", back=True)]
        for wish in wishes:
            program = read(expand(robot, placed(template), wish))
            assert set(program.resources) == {"arm", "what"}
            assert program.parameters.keys() == ({"rounds"} if wish.rounds > 1 else set())
            moving = [state.file.with_ for state in program.states() if state.file.do == "trajectory"]
            names = [waypoint.name for waypoint in trajectory.waypoints]
            if not trajectory.entry:
                assert [each["first"] for each in moving] == (list(reversed(names)) if wish.back else names)


def test_before_each_motion_the_operator_is_asked_once_and_planned_ways_are_there_to_be_seen(robot, read):
    program = read(expand(robot, placed("box"), Wish("grasp", "right")))
    into: dict[str, list[str]] = {}
    does = {state.id: state.file.do for state in program.states()}
    for state in program.states():
        for way in state.transitions:
            if does.get(way.file.target) == "trajectory":
                into.setdefault(way.file.target, []).append(way.file.autonomy)
                assert does[state.id] == "plan" or way.file.target != "to_before"
    assert into == {name: ["high"] for name in ("to_before", "to_around", "to_hold", "to_lift")}


def test_what_waypoints_before_have_moved_counts_as_moved(robot):
    valve = placed("lever_valve")
    whole = chosen(robot, valve, "turn", "right")
    names = [each.waypoint.name for each in whole]
    by = next(each.waypoint for each in whole if each.waypoint.approach == "along")
    turned = replace(valve, joint_state={by.joint: float(by.to)})
    for number, name in enumerate(names):
        now = turned if number > names.index(by.name) else valve
        (one,) = chosen(robot, now, "turn", "right", first=name, last=name)
        assert np.allclose(one.tip_in_world, whole[number].tip_in_world), name
    back = chosen(robot, turned, "turn", "right", back=True)
    assert [each.waypoint.name for each in back] == names[::-1]
    assert all(np.allclose(one.tip_in_world, other.tip_in_world) for one, other in zip(back, whole[::-1], strict=True))


@pytest.mark.parametrize(("template", "trajectory"), [("lever_valve", "turn"), ("box", "grasp")])
def test_steps_back_are_the_legs_and_shapes_of_the_whole_way_back(robot, template, trajectory):
    whole = chosen(robot, placed(template), trajectory, "right", back=True)
    assert whole[0].waypoint.approach == "straight"
    for leaving, asked in pairwise(whole):
        (one,) = chosen(
            robot, placed(template), trajectory, "right", back=True,
            first=asked.waypoint.name, last=asked.waypoint.name, leaving=leaving.waypoint.name,
        )  # fmt: skip
        assert (one.waypoint.approach, one.waypoint.to, one.fingers) == (
            asked.waypoint.approach,
            asked.waypoint.to,
            asked.fingers,
        )


class Desk:
    """Template runs of an engine whose hand is where the test puts it."""

    def __init__(self, robot, folder):
        self.tip = np.zeros(3)
        self.instances = AffordanceServer(folder / "instances.json")
        self.instances.place(
            PlaceInstance(name="it", template="box", pose_in_world=Pose(position=(0.5, -0.3, 0.1)), parameters={})
        )
        services = SimpleNamespace(
            description=robot,
            affordances=self.instances,
            daemon=SimpleNamespace(command=lambda: np.zeros(len(robot.joints))),
            tip=lambda command, arm: self.tip,
        )
        self.runs = TemplateRuns(services, folder / "programs")  # type: ignore[arg-type]
        self.robot = robot

    def reach(self, waypoint: str) -> None:
        """A run has brought the hand there."""
        deployed = self.runs.deploy(RunTemplate(instance="it", trajectory="grasp", arm="right"))
        self.runs.told(deployed, SimpleNamespace(data={"at": waypoint}))  # type: ignore[arg-type]
        (there,) = chosen(self.robot, self.instances.get("it"), "grasp", "right", first=waypoint, last=waypoint)
        self.tip = there.tip_in_world[:3, 3]

    def way(self, **call) -> list[str]:
        text = self.runs.program(ExpandTemplate(instance="it", trajectory="grasp", arm="right", **call)).text
        return [line.strip(" :")[3:] for line in text.splitlines() if line.startswith("  to_")]


@pytest.fixture
def desk(robot, tmp_path):
    return Desk(robot, tmp_path)


def test_steps_go_on_from_where_the_last_run_left_the_hand_if_it_is_there_still(desk):
    assert desk.way(steps=1) == ["before"]
    desk.reach("around")
    assert desk.way(steps=1) == ["hold"]
    assert desk.way(steps=2) == ["hold", "lift"]
    assert desk.way(steps=1, backwards=True) == ["before"]
    assert desk.way() == ["before", "around", "hold", "lift"]
    assert desk.way(first="hold") == ["hold", "lift"]
    desk.reach("lift")
    assert desk.way(backwards=True) == ["hold", "around", "before"]
    with pytest.raises(RefusedError, match="stands at lift, and nothing is left that way"):
        desk.way(steps=1)
    desk.tip = desk.tip + 0.2
    assert desk.way(steps=1) == ["before"]
    assert desk.way(backwards=True) == ["lift", "hold", "around", "before"]


@pytest.mark.parametrize(
    ("call", "words"),
    [
        ({"trajectory": "nothing"}, "field trajectory, value nothing, expected one of: grasp"),
        ({"arm": "third"}, "field arm, value third, expected one of: right, left"),
        ({"first": "nowhere"}, "field first, value nowhere, expected one of: before, around, hold, lift"),
        ({"loop": 2, "steps": 1}, "field steps, value 1, expected none beside loop"),
        ({"loop": 2, "backwards": True}, "field backwards, value True, expected none beside loop"),
        ({"instance": "other"}, "field name, value other, expected one of: it"),
    ],
)
def test_what_can_not_be_gone_is_refused_and_told(desk, call, words):
    with pytest.raises(RefusedError, match=words):
        desk.runs.program(ExpandTemplate(**{"instance": "it", "trajectory": "grasp", "arm": "right", **call}))


def test_a_rigid_tool_that_would_have_to_close_is_refused_before_anything_moves():
    with pytest.raises(RefusedError, match="no hand that could open and close"):
        expand(robots.load("talos_upper"), placed("box"), Wish("grasp", "right"))


STROKE = ["approach", "standoff", "engage", "turn", "release", "withdraw"]


@pytest.mark.parametrize(
    ("wish", "gone"),
    [
        ({}, STROKE),
        ({"rounds": 2}, STROKE),
        ({"steps": 3}, STROKE[:3]),
        ({"first": "approach", "steps": 1, "stands": "engage", "plan": "plan-1"}, STROKE[:1]),
        ({"steps": 1, "stands": "engage", "plan": "plan-1"}, ["turn"]),
        ({"first": "turn", "stands": "engage", "plan": "plan-1"}, STROKE[3:]),
    ],
)
def test_a_stroke_is_planned_as_a_whole_and_gone_from_waypoint_to_waypoint(robot, read, wish, gone):
    program = read(expand(robot, placed("wheel"), Wish("turn", "right", **wish)))
    does = [(state.file.do, state.file.with_.get("to")) for state in program.states() if state.file.do]
    planned = [("plan", None)] if gone[0] == "approach" else []
    assert does == planned + [("execute", name) for name in gone]
    assert program.variables["plan"] == ("" if planned else "plan-1")


@pytest.mark.parametrize(
    ("wish", "words"),
    [
        ({"back": True}, "turn is a stroke, and what it has turned does not come back with the tool; field backwards"),
        ({"first": "turn"}, "the tool is not at engage on such a plan; field first, value turn, expected approach"),
        ({"first": "turn", "stands": "standoff", "plan": "p"}, "value turn, expected approach or engage"),
        ({"rounds": 2, "steps": 1}, "field steps, value 1, expected none beside loop"),
    ],
)
def test_a_stroke_is_not_begun_in_its_middle_nor_gone_back(robot, wish, words):
    with pytest.raises(RefusedError, match=words):
        expand(robot, placed("wheel"), Wish("turn", "right", **wish))


def test_a_way_back_over_a_push_is_refused_since_what_was_pushed_stays_where_it_is(robot, read):
    with pytest.raises(RefusedError, match="turn pushes stem, which does not come back with the hand"):
        expand(robot, placed("lever_valve"), Wish("push", "right", back=True))
    back = read(expand(robot, placed("lever_valve"), Wish("push", "right", back=True, steps=3)))
    assert [state.file.with_["first"] for state in back.states() if state.file.do] == ["back", "leave", "turn"]
    with pytest.raises(RefusedError, match="turn pushes stem"):
        expand(robot, placed("lever_valve"), Wish("push", "right", back=True, steps=1, stands="turn"))
