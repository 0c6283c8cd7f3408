"""The library's programs on a robot in the plant, whose ground truth is the judge."""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from handrail.messages import InstanceState, Pose, RunState
from tests.stack.conftest import Stack

pytestmark = [pytest.mark.stack, pytest.mark.timeout(700)]

TABLE = {"depth": 0.50, "width": 0.60, "height": 0.04}
"""half of it"""
STAND = {"depth": 0.16, "width": 0.16, "height": 0.04}
SIZE = {"depth": 0.06, "width": 0.05, "height": 0.13}


def carried_out(robot, program: str, bindings: Mapping[str, str], **parameters) -> RunState:
    """A run's end; what it asks is approved."""
    with robot.events(RunState, timeout_s=30.0) as runs:
        return followed(runs, robot.run(robot.deploy(program, bindings, parameters)))


def carried(robot, bindings: Mapping[str, str]) -> tuple[RunState, list[str]]:
    """A pick_and_place's end, and what the box was told to go along with until it stood again: links, empty for the world."""
    to, stands = [""], threading.Event()

    def note(state: InstanceState) -> None:
        link = state.attachment.link if state.attachment is not None else ""
        if state.name == bindings["what"] and link != to[-1]:
            to.append(link)
        if len(to) > 2:
            stands.set()

    with robot.on(InstanceState, note):
        ended = carried_out(robot, "pick_and_place", bindings)
        stands.wait(10.0 if ended.status == "succeeded" else 0.0)
    return ended, to


def followed(runs, begun: RunState) -> RunState:
    """A run's end."""
    for state in runs:
        if state.run == begun.run and state.status in ("succeeded", "failed", "stopped"):
            return state
    raise AssertionError("the connection was closed")


def test_either_hand_picks_a_box_up_and_puts_it_where_it_was_told_or_back_and_knows_when_it_has_nothing(
    start_stack,
) -> None:
    stack: Stack = start_stack(scene="boxes", robot="talos_upper_grippers")
    stack.wait_up()
    robot = stack.connect()
    robot.enable(60.0)
    truth = stack.truth()
    for arm, side in (("right", -1.0), ("left", 1.0)):
        there = np.array([0.62, side * 0.42, 0.045])
        robot.place_instance("box", "box", Pose(position=(0.58, side * 0.30, 0.045)), SIZE)
        robot.place_instance("place", "box", Pose(position=tuple(there.tolist())), SIZE)
        robot.place_instance("table", "box", Pose(position=(0.75, side * 0.30, -0.04)), TABLE)
        bindings = {"arm": arm, "what": "box", "where": "place"}
        ended, went_along = carried(robot, bindings)
        assert ended.status == "succeeded", ended.detail
        assert went_along == ["", f"grasp_{arm}", ""], "it goes along with the hand that has it, and stands again"
        believed = next(each for each in robot.instances() if each.name == "box").pose_in_world
        assert np.linalg.norm(np.array(believed.position) - there) < 0.015, believed
        now = truth.now().poses_in_world[f"box_{arm}"]
        assert np.linalg.norm(np.array(now.position) - there) < 0.01, now
        assert abs(now.orientation[3]) > np.cos(np.deg2rad(5.0) / 2), f"it has fallen over: {now}"

        for instance in ("box", "place", "table"):
            robot.remove_instance(instance)

    robot.place_instance("box", "box", Pose(position=(0.58, 0.30, 0.045)), SIZE)  # where it is no more
    robot.place_instance("table", "box", Pose(position=(0.75, 0.30, -0.04)), TABLE)
    ended = carried_out(robot, "reach", {"arm": "left", "what": "box"})
    assert ended.status == "succeeded", ended.detail
    ended = carried_out(robot, "grasp", {"arm": "left", "what": "box"})
    assert (ended.status, ended.detail) == ("failed", "the hand closed on nothing")
    ended = carried_out(robot, "home", {"arm": "left"})
    assert ended.status == "succeeded", ended.detail

    # The template alone: taken and lifted, one waypoint more and back, and put down again where it stood.
    robot.remove_instance("box")
    before = truth.now().poses_in_world["box_left"].position
    robot.place_instance("box", "box", Pose(position=before), SIZE)
    with robot.events(RunState, timeout_s=30.0) as runs:
        taken = followed(runs, robot.run_template("box", "grasp", "left", steps=3))
        assert (taken.status, taken.data["at"]) == ("succeeded", "hold"), taken.detail
        lifted = followed(runs, robot.run_template("box", "grasp", "left", steps=1))
        assert (lifted.status, lifted.data["at"]) == ("succeeded", "lift"), lifted.detail
        assert truth.now().poses_in_world["box_left"].position[2] > before[2] + 0.03
        put = followed(runs, robot.run_template("box", "grasp", "left", backwards=True))
        assert (put.status, put.data["at"]) == ("succeeded", "before"), put.detail
    now = truth.now().poses_in_world["box_left"]
    assert np.linalg.norm(np.array(now.position) - before) < 0.01, now
    assert abs(now.orientation[3]) > np.cos(np.deg2rad(5.0) / 2), f"it has fallen over: {now}"


def test_one_hand_holds_a_canister_while_the_other_one_twists_its_cap_stroke_by_stroke(start_stack) -> None:
    stack: Stack = start_stack(scene="twist_cap", robot="talos_upper_grippers")
    stack.wait_up()
    robot = stack.connect()
    robot.enable(60.0)
    truth = stack.truth()
    before = truth.now().poses_in_world["canister"]
    size = {"body_radius": 0.03, "hold_from": 120, "begin": 45, "twist": 60}
    robot.place_instance("cap", "cap", Pose(position=(0.42, -0.1, 0.05)), size)
    robot.place_instance("stand", "box", Pose(position=(0.42, -0.1, -0.14)), STAND)
    ended = carried_out(robot, "twist_cap", {"twisting": "right", "holding": "left", "cap": "cap"}, goal_deg=100)
    assert ended.status == "succeeded", ended.detail
    now = truth.now()
    assert now.hinges["canister.thread"] > math.radians(80), "two strokes of 60°, of which the grip slips a little"
    assert now.peak_contact_force["canister"] < 80.0
    there = now.poses_in_world["canister"]
    assert np.linalg.norm(np.subtract(there.position, before.position)) < 0.01, there
    turned = 2 * math.acos(min(1.0, abs(float(np.dot(there.orientation, before.orientation)))))
    assert turned < math.radians(15), "the other hand has kept the canister from turning, and from falling over"


def test_one_hand_holds_a_drill_while_the_other_one_squeezes_its_trigger(start_stack) -> None:
    stack: Stack = start_stack(scene="squeeze_trigger", robot="talos_upper_grippers")
    stack.wait_up()
    robot = stack.connect()
    robot.enable(60.0)
    truth, over = stack.truth(), threading.Event()
    turn = Pose(position=(0.48, -0.02, 0.10), orientation=(0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)))
    robot.place_instance("drill", "drill", turn)
    robot.place_instance(
        "table", "box", Pose(position=(0.48, -0.02, -0.02)), {"depth": 0.14, "width": 0.14, "height": 0.04}
    )

    def watch() -> float:
        deepest = 0.0
        while not over.is_set():
            deepest = max(deepest, truth.now().hinges["drill.trigger"])
        return deepest

    with ThreadPoolExecutor(1) as beside:
        watching = beside.submit(watch)
        ended = carried_out(robot, "squeeze_trigger", {"holding": "right", "pressing": "left", "drill": "drill"})
        over.set()
        deepest = watching.result()
    assert ended.status == "succeeded", ended.detail
    assert deepest > 0.003, "of 8 mm, against its spring"
    now = truth.now()
    assert abs(now.hinges["drill.trigger"]) < 0.001, "its spring has it back"
    # A peak where the fingers meet it: 27 to 62 N, as the machine is busy.
    assert now.peak_contact_force["drill"] < 80.0


def test_two_hands_lift_a_box_between_them_level_and_put_it_down_again(start_stack) -> None:
    stack: Stack = start_stack(scene="carry", robot="talos_upper_grippers")
    stack.wait_up()
    robot = stack.connect()
    robot.enable(60.0)
    truth = stack.truth()
    before = truth.now().poses_in_world["box"].position
    robot.place_instance(
        "box", "box", Pose(position=before), {"depth": 0.20, "width": 0.30, "height": 0.20, "lift": 0.08}
    )
    with robot.events(RunState, timeout_s=30.0) as runs:
        lifted = followed(runs, robot.run_template("box", "carry"))
        assert (lifted.status, lifted.data["at"]) == ("succeeded", "lift"), lifted.detail
        up = truth.now().poses_in_world["box"]
        assert up.position[2] > before[2] + 0.06, up
        assert abs(up.orientation[3]) > math.cos(math.radians(8.0) / 2), f"not level: {up}"
        put = followed(runs, robot.run_template("box", "carry", backwards=True))
        assert (put.status, put.data["at"]) == ("succeeded", "before"), put.detail
    down = truth.now().poses_in_world["box"]
    assert np.linalg.norm(np.subtract(down.position, before)) < 0.02, down
    assert abs(down.orientation[3]) > math.cos(math.radians(5.0) / 2), f"it has turned: {down}"
