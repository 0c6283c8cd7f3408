"""The library's programs for a robot with rigid tools, at things that are pushed; the plant's ground truth is the judge."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from handrail.messages import Pose, Prompt
from handrail.robot import library as robots
from handrail.robot.kinematics import Kinematics
from tests.stack.conftest import Stack, stacks
from tests.stack.test_library import carried_out

pytestmark = [pytest.mark.stack, pytest.mark.timeout(700)]


@pytest.fixture(scope="module")
def workshop() -> Iterator[Stack]:
    """Everything that stands there is placed where it is."""
    with stacks() as start:
        stack = start(scene=str(Path(__file__).parent / "workshop.yaml"))
        stack.wait_up()
        stack.robot = robot = stack.connect()
        robot.enable(60.0)
        robot.on(Prompt, lambda prompt: robot.answer(prompt.id, prompt.options[0]))
        robot.place_instance("valve", "lever_valve", Pose(position=(0.55, -0.28, 0.25)))
        robot.place_instance("panel", "button_panel", Pose(position=(0.52, -0.32, -0.10)))
        size = {"width": 0.5, "below": 0.5, "above": 0.5, "hinge_side": -1, "opening": 60}
        robot.place_instance("door", "door", Pose(position=(0.55, 0.0, 0.20)), size)
        yield stack


def test_the_camera_comes_to_look_at_what_it_is_told(workshop) -> None:
    description = robots.load("talos_upper")
    kinematics, truth = Kinematics(description), workshop.truth()
    for what, place in (("door", (0.55, 0.0, 0.20)), ("valve", (0.55, -0.28, 0.25))):
        ended = carried_out(workshop.robot, "look_at", {"what": what})
        assert ended.status == "succeeded", ended.detail
        joints = truth.now().joints
        eye = kinematics.frame(np.array([joints[name] for name in description.joints]), "rgbd_depth_optical_frame")
        way = np.array(place) - eye.translation
        off = math.acos(float(eye.rotation[:, 2] @ way) / float(np.linalg.norm(way)))
        assert off < math.radians(4.0), f"{what} is {math.degrees(off):.1f}° off the middle of the picture"


def test_a_tool_turns_a_lever_from_closed_to_open(workshop) -> None:
    ended = carried_out(workshop.robot, "turn_valve", {"arm": "right", "valve": "valve"})
    assert ended.status == "succeeded", ended.detail
    assert ended.data["turned_deg"] == pytest.approx(90), "it is a lever: one stroke, not a wheel's many"
    now = workshop.truth().now()
    assert now.hinges["valve.stem"] > math.radians(80), now.hinges
    assert now.peak_contact_force["valve"] < 80.0
    assert carried_out(workshop.robot, "home", {"arm": "right"}).status == "succeeded"


def test_a_tool_presses_a_doors_handle_down_and_pushes_the_leaf_open(workshop) -> None:
    truth = workshop.truth()
    assert abs(truth.now().hinges["door.hinge"]) < 0.02, "the latch holds it"
    ended = carried_out(workshop.robot, "open_door", {"arm": "left", "door": "door"})
    assert ended.status == "succeeded", ended.detail
    assert truth.now().hinges["door.hinge"] > math.radians(45), truth.now().hinges
    assert carried_out(workshop.robot, "home", {"arm": "left"}).status == "succeeded"


def test_a_tool_presses_the_button_it_is_told_and_no_other(workshop) -> None:
    truth, deepest = workshop.truth(), dict.fromkeys((f"panel.press_{k}" for k in range(4)), 0.0)
    over = threading.Event()

    def watch() -> None:
        while not over.is_set():
            for name, position in truth.now().hinges.items():
                if name in deepest:
                    deepest[name] = max(deepest[name], position)

    with ThreadPoolExecutor(1) as beside:
        watching = beside.submit(watch)
        ended = carried_out(workshop.robot, "push_button", {"arm": "right", "panel": "panel"}, button=2)
        over.set()
        watching.result()
    assert ended.status == "succeeded", ended.detail
    assert deepest.pop("panel.press_2") > 0.005, "it was down"
    assert max(deepest.values()) < 0.001, deepest
    now = workshop.truth().now()
    assert abs(now.hinges["panel.press_2"]) < 0.001, "its spring has it back"
    assert now.peak_contact_force["panel"] < 60.0
