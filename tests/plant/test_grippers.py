"""Under-actuated grippers: one drive, a rigid linkage, and things that are really held."""

from __future__ import annotations

import numpy as np
import pytest

from hal.drives.lifecycle import State
from hal.plant import scene
from hal.plant.bullet import pybullet as p
from hal.plant.sensor_noise import without_noise
from hal.plant.world import World
from hal.robots.check import mass_beyond
from handrail.robot import library as robots
from handrail.robot.kinematics import Kinematics

MASS, WIDTH = 0.15, 0.03
POSITION, VELOCITY, EFFORT, TEMPERATURE, STATE, HOLDING = range(6)
# Robot, its gripper, and where that is open and closed.
HANDS = [("panda", "hand", 0.04, 0.0), ("talos_upper_grippers", "gripper_right", 0.0, -0.95)]
ONE_FINGERED = ("z1", "gripper", -1.2, 0.0)


def _command(position, speed, effort, enable=1.0):
    values = np.zeros(8)
    values[:4] = position, speed, effort, enable
    return values


@pytest.fixture(scope="module", params=HANDS, ids=lambda hand: hand[0])
def hand(request, tmp_path_factory):
    """A world with a loose box at the grasp, the gripper's row, its open and closed position."""
    name, gripper, opened, closed = request.param
    robot = robots.load(name)
    kinematics = Kinematics(robot)
    arm = next(arm for arm in robot.arms.values() if "left" not in arm.tip)
    grasp = kinematics.frame(robot.home_position(), arm.tip)
    file = tmp_path_factory.mktemp("scene") / "box.yaml"
    file.write_text(
        f"objects:\n  box:\n    kind: box\n    pose_in_world: {{position: {grasp.translation.tolist()},"
        f" orientation: {list(scene.quaternion(grasp.rotation))}}}\n    size: [0.05, {WIDTH}, 0.05]\n    mass: {MASS}\n"
        "    friction: 0.8\n"
    )
    world = World(without_noise(robot), scene.load(file))
    row = next(row for row, device in enumerate(robot.devices) if device.name == gripper)
    world.devices.grippers[row].place(opened)
    yield world, row, opened, closed
    world.close()


def _floating(world, steps):
    """Let time pass while an unseen hand carries the box's weight."""
    box = world.body("box")
    for _ in range(steps):
        here, _ = p.getBasePositionAndOrientation(box, physicsClientId=world.client)
        p.applyExternalForce(box, -1, (0, 0, 9.81 * MASS), here, p.WORLD_FRAME, physicsClientId=world.client)
        world.step()


def _linkage_error(world, row):
    joints, gripper = world.truth().joints, world.devices.grippers[row]
    driven = joints[gripper.joint]
    errors = [abs(joints[name] - m.multiplier * driven - m.offset) for name, m in gripper.followers.items()]
    return max(errors, default=0.0)


def test_a_gripper_closes_on_a_box_holds_it_and_lets_go(hand):
    world, row, opened, closed = hand
    gripper, start = world.devices.grippers[row], world.truth().poses_in_world["box"].position
    _, _, speed, effort = world.robot.description.device_limits[gripper.joint]
    effort = min(effort, 20.0)
    world.devices.command(row, _command(closed, speed, effort))
    worst = 0.0
    for _ in range(24):
        _floating(world, 50)
        worst = max(worst, _linkage_error(world, row))
    world.advance(500)  # the box hangs in the fingers alone now
    worst = max(worst, _linkage_error(world, row))
    measured = world.devices.measure().values[row].copy()
    truth = world.truth()
    assert measured[HOLDING] == 1
    assert abs(measured[POSITION] - closed) > 0.1 * abs(opened - closed)  # the box is in the way
    assert measured[STATE] == State.OPERATION_ENABLED
    assert abs(measured[EFFORT]) <= effort * 1.001
    assert truth.contact_force["box"] > 2 * MASS * 9.81
    assert np.linalg.norm(np.subtract(truth.poses_in_world["box"].position, start)) < 0.02
    assert worst < 1e-3  # rad or m
    for number, device in enumerate(world.description.devices):
        if device.name == "wrist_right_ft":  # the squeeze stays inside the hand; the box's weight does not
            weight = 9.81 * (MASS + mass_beyond(world.description, device.link))
            felt = world.devices.measure().values[number][:3]
            axes = Kinematics(world.description).frame(world.position, device.link).rotation
            np.testing.assert_allclose(axes @ felt, [0, 0, -weight], atol=0.05)
    # Without power it goes on holding; enabled anew it opens, and the box falls.
    world.devices.command(row, _command(closed, speed, effort, enable=0.0))
    world.advance(300)
    assert world.devices.measure().values[row][STATE] == State.SWITCH_ON_DISABLED
    assert world.truth().contact_force["box"] > 2 * MASS * 9.81
    world.devices.command(row, _command(opened, speed, effort))
    world.advance(1100)
    assert world.devices.measure().values[row][POSITION] == pytest.approx(opened, abs=0.01 * abs(opened - closed))
    assert world.devices.measure().values[row][HOLDING] == 0
    assert world.truth().poses_in_world["box"].position[2] < start[2] - 0.3


@pytest.mark.parametrize(("along", "height"), [(0.105, 0.02), (0.12, 0.03)])
def test_a_gripper_with_hollow_jaws_holds_a_small_box(tmp_path, along, height):
    robot = robots.load("z1")
    palm = Kinematics(robot).frame(robot.home_position(), "gripperStator")
    floor = {0.105: -0.0135, 0.12: -0.009}[along]  # the lower jaw's, there
    at = palm.act(np.array([along, 0.0, floor + height / 2]))
    (tmp_path / "box.yaml").write_text(
        f"objects:\n  box:\n    kind: box\n    pose_in_world: {{position: {at.tolist()},"
        f" orientation: {list(scene.quaternion(palm.rotation))}}}\n    size: [0.03, 0.03, {height}]\n    mass: {MASS}\n"
        "    friction: 0.8\n"
    )
    world = World(robot, scene.load(tmp_path / "box.yaml"))
    world.devices.grippers[0].place(-0.9)
    _floating(world, 20)
    assert world.truth().poses_in_world["box"].position == pytest.approx(at.tolist(), abs=1e-3), "there is room for it"
    world.devices.command(0, _command(0.0, 1.0, 10.0))
    _floating(world, 1000)
    gripped = world.truth().poses_in_world["box"].position
    world.advance(1000)
    assert world.truth().poses_in_world["box"].position == pytest.approx(gripped, abs=3e-3)
    assert world.devices.measure().values[0][POSITION] < -0.1, "it is between the jaws"
    world.close()


@pytest.mark.parametrize(("name", "gripper", "opened", "closed"), [*HANDS, ONE_FINGERED])
def test_an_empty_gripper_moves_at_the_commanded_speed_with_its_linkage_in_step(name, gripper, opened, closed):
    robot = robots.load(name)
    world = World(robot)
    row = next(row for row, device in enumerate(robot.devices) if device.name == gripper)
    drive = world.devices.grippers[row]
    drive.place(opened)
    _, _, limit, effort = robot.device_limits[drive.joint]
    world.devices.command(row, _command(closed, limit / 2, effort))
    worst, speeds = 0.0, []
    for _ in range(round(500 * abs(closed - opened) / limit)):  # a quarter of the way
        world.step()
        worst = max(worst, _linkage_error(world, row))
        speeds.append(abs(world.devices.measure().values[row][VELOCITY]))
    assert np.median(speeds) == pytest.approx(limit / 2, rel=0.02)
    world.advance(round(1500 * abs(closed - opened) / limit) + 300)
    assert world.devices.measure().values[row][POSITION] == pytest.approx(closed, abs=1e-3)
    assert world.devices.measure().values[row][HOLDING] == 0  # there is nothing in it
    assert worst < 1e-3
    world.close()


def test_pinocchio_and_the_plant_see_the_fingers_in_the_same_place():
    robot = robots.load("talos_upper_grippers")
    world, kinematics = World(without_noise(robot)), Kinematics(robot)
    row = next(row for row, device in enumerate(robot.devices) if device.name == "gripper_right")
    world.devices.grippers[row].place(-0.6)
    kinematics.set_gripper("gripper_right_joint", -0.6)
    for number in (1, 2, 3):
        link = f"gripper_right_fingertip_{number}_link"
        there = world.robot.link_motion(world.robot.links[link])[1]
        np.testing.assert_allclose(there, kinematics.frame(world.position, link).translation, atol=1e-6)
    world.close()
    with pytest.raises(KeyError):
        kinematics.set_gripper("arm_right_1_joint", 0.0)
