"""Which waypoints an arm can reach: each with room, near which limit, or not and what is missed; from what was found before."""

from __future__ import annotations

import math
import socket
import threading
from dataclasses import replace

import pytest

from affordance_templates import catalogue
from affordance_templates.instance import Instance
from engines.nodes.wire import Wire
from engines.planning.along import touching
from engines.planning.ik.mechanism import Mechanism
from engines.planning.planners import Planners
from engines.reach.reachability import Question, Reachability
from engines.reach.wire import Ask, Told
from engines.reach.worker import Worker
from handrail.messages import Pose
from handrail.robot import library as robots
from handrail.robot.kinematics import Kinematics

HERE = (0.55, -0.35, 0.1)
LONG_S = 60.0


@pytest.fixture(scope="module")
def planners(description):
    return Planners(description)


@pytest.fixture
def reach(planners, description):
    return Reachability(planners, description)


@pytest.fixture
def question(description):
    def question(template: str, trajectory: str, place=HERE, arm: str = "right", others=()) -> Question:
        it = Instance("it", catalogue.load(template), Pose(position=place))
        return Question("it", trajectory, arm, 0.01, [it, *others], description.home_position("ready"))

    return question


def told(waypoints) -> dict[str, str]:
    return {each.name: each.state for each in waypoints}


def test_what_is_at_hand_is_reached_with_room_and_what_is_far_away_is_missed_by_metres(reach, question):
    near = reach.quick(question("lever_valve", "push"))
    assert told(near) == dict.fromkeys(("before", "around", "touch", "turn", "leave", "back"), "reached")
    far = reach.quick(question("lever_valve", "push", (2.55, -0.35, 0.1)))
    for each in far:
        assert (each.state, each.constraint, each.unit) == ("not", "position", "m")
        assert 1.0 < each.by < 2.0, each


def test_between_reached_and_not_reached_lies_near_and_the_joint_is_named(reach, question):
    found = []
    for y in (-0.3, -0.4, -0.5):
        asked = question("box", "grasp_top", (0.55, y, 0.1))
        reach.quick(asked)
        settled = reach.settle(asked, lambda: False)
        assert settled is not None
        found.append(settled[0])
    assert [each.state for each in found] == ["reached", "near", "not"]
    assert (found[1].constraint, found[1].about, found[1].unit) == ("joint limits", "arm_right_6_joint", "rad")
    assert 0.0 <= found[1].by < 0.1
    assert "left" in str(found[1]) and "missed by" in str(found[2])


def test_what_stands_in_the_way_is_named_where_the_place_itself_could_be_reached(reach, question):
    size = {"depth": 0.5, "width": 0.5, "height": 0.5}
    asked = question("box", "grasp", others=[Instance("wall", catalogue.load("box"), Pose(position=HERE), size)])
    reach.quick(asked)
    for each in reach.settle(asked, lambda: False):
        assert (each.state, each.constraint, each.unit) == ("not", "clearance", "m")
        assert each.about.endswith("of wall") and each.by > 0.05


def test_what_is_found_while_dragging_is_what_a_search_from_scratch_finds(planners, description, question):
    dragged = Reachability(planners, description)
    places = [(0.55 + 0.02 * k, -0.35 + 0.02 * k, 0.1) for k in range(12)]
    for place in places:
        asked = question("box", "grasp", place)
        dragged.quick(asked)
    moved = dragged.settle(asked, lambda: False)
    fresh = Reachability(planners, description)
    fresh.quick(asked)
    assert told(moved) == told(fresh.settle(asked, lambda: False))


def test_fingers_may_touch_what_they_are_to_take_and_the_arm_behind_the_hand_may_not():
    mechanism = Mechanism.of(Kinematics(robots.load("talos_upper_grippers")))
    names = {name for name, _ in touching(mechanism, "gripper_right_base_link", "it")}
    assert {"gripper_right_base_link", "gripper_right_fingertip_3_link"} <= names
    assert all(name.startswith("gripper_right_") for name in names), names


def test_settling_ends_where_something_newer_waits(reach, question):
    far = question("box", "grasp", (2.5, 0.0, 0.1))
    reach.quick(far)
    assert reach.settle(far, lambda: True) is None


@pytest.mark.parametrize(
    ("template", "trajectory", "arm", "words"),
    [
        ("box", "nothing", "right", "trajectory: got 'nothing'; expected one of grasp"),
        ("box", "grasp", "third", "got third; expected one of"),
    ],
)
def test_what_can_not_be_asked_is_told(reach, question, template, trajectory, arm, words):
    with pytest.raises(ValueError, match=words):
        reach.quick(question(template, trajectory, arm=arm))


def test_the_process_answers_the_newest_question_only_and_settles_once_nothing_waits(reach, question, description):
    ours, theirs = socket.socketpair()
    engine, worker = Wire(ours, Told), Worker(reach, Wire(theirs, Ask))

    def ask(number: int, x: float, **changes) -> Ask:
        it = replace(question("box", "grasp", (x, -0.3, 0.1)).instances[0], version=number)
        at = description.home_position("ready").tolist()
        state = {"instances": [it.state()], "position": at, "base": None, "deployed": "", **changes}
        return Ask(number=number, instance="it", trajectory="grasp", arm="right", clearance=0.01, **state)

    for number, x in enumerate((0.5, 0.6, 2.5), 1):
        engine.send(ask(number, x))
    ended: list[str] = []

    def serve() -> None:
        try:
            worker.serve()
        except EOFError:
            ended.append("with its engine")

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    first, settled = engine.receive(LONG_S), engine.receive(LONG_S)
    assert [(each.number, each.version, each.settled) for each in (first, settled)] == [(3, 3, False), (3, 3, True)]
    assert {each.state for each in settled.waypoints} == {"not"}
    odd = ask(4, 0.5).instances[0]
    odd.template_hash = "another"
    engine.send(ask(4, 0.5, instances=[odd]))
    assert "was edited since it was placed" in engine.receive(LONG_S).problem
    engine.send(ask(5, 0.5, instances=[]))
    assert "instance: got 'it'; expected one of none placed yet" in engine.receive(LONG_S).problem
    engine.close()
    thread.join(LONG_S)
    assert ended == ["with its engine"]


def test_a_stroke_is_told_on_the_arc_on_which_most_of_it_is_reached(reach, question):
    asked = question("wheel", "turn", (0.55, -0.35, 0.30))
    reach.quick(asked)
    found = reach.settle(asked, lambda: False)
    assert {each.state for each in found} <= {"reached", "near"}, found
    approach, standoff, engage, turn, release, withdraw = found
    _, _, first, *_ = reach.quick(asked)
    assert first.turned == engage.turned, "it stays with the arc that it told of"
    assert approach.turned == standoff.turned == engage.turned < turn.turned, (
        "it is entered at one angle and turned to another"
    )
    assert release.turned == withdraw.turned == pytest.approx(turn.turned - math.radians(8))
    far = question("wheel", "turn", (1.1, -0.15, 0.20))
    reach.quick(far)
    settled = reach.settle(far, lambda: False)
    assert "not" in told(settled).values()
