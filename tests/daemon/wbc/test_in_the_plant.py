"""Whole-body control judged by what TALOS' upper body does in the plant: drives with springs, 500 Hz, no bus."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pinocchio as pin
import pytest

from daemon.wbc.constraints import JointLimits, PointContact
from daemon.wbc.hierarchy import WholeBody
from daemon.wbc.impedance import ImpedanceOutput
from daemon.wbc.model import WholeBodyModel
from daemon.wbc.tasks import CartPos, JPos, QuaternionOrientation, Wrench
from hal.plant.scene import EMPTY, Box, Scene
from hal.plant.world import World
from handrail.messages import Pose
from handrail.robot import library as robots
from handrail.robot.kinematics import Kinematics
from tests.plant.conftest import Host

HAND = "tool_right_tip"
PERIOD = 0.002


class Robot:
    """A world with enabled drives, commanded by whole-body control: τ, q, q̇, K, D."""

    def __init__(self, scene: Scene = EMPTY):
        description = robots.load("talos_upper")
        kinematics = Kinematics(description)
        self.world = World(description, scene)
        self.host = Host(self.world, kinematics)
        self.host.enable()
        self.model = WholeBodyModel.of(kinematics)
        self.look()
        self.output = ImpedanceOutput(len(description.joints), PERIOD, leak=20.0)
        self.output.start(self.world.position, self.world.velocity)
        self.damping = self.host.command.damping.copy()

    def look(self) -> None:
        self.model.place(self.world.position, self.world.velocity)

    def cycle(self, body: WholeBody) -> None:
        self.look()
        result = body.solve()
        assert result.solved, result.why
        rows, world, command = self.model.rows, self.world, self.host.command
        self.output.advance(result.acceleration[rows], world.position, world.velocity)
        command.torque[:] = result.torque[rows]
        command.position[:], command.velocity[:] = self.output.position, self.output.velocity
        command.stiffness[:], command.damping[:] = 0.2 * world.description.stiffness, 0.2 * self.damping
        world.drives.command(command)
        world.advance(2)

    def hand(self) -> np.ndarray:
        self.look()
        return self.model.frame(HAND).translation.copy()


@pytest.fixture
def robot_in() -> Iterator[Callable[..., Robot]]:
    made: list[Robot] = []

    def make(scene: Scene = EMPTY) -> Robot:
        made.append(Robot(scene))
        return made[-1]

    yield make
    for robot in made:
        robot.world.close()


def test_a_posture_that_swings_hardly_moves_the_hand_that_is_held_above_it(robot_in) -> None:
    """A lower task disturbs a higher one by less than 4 mm and 1.5°, though the arm moves by more than 0.1 rad."""
    robot = robot_in()
    body = WholeBody(
        robot.model,
        [
            [
                CartPos(frame=HAND, name="hand", stiffness=200.0),
                QuaternionOrientation(frame=HAND, name="turn", stiffness=200.0),
            ],
            [JPos(name="posture", stiffness=50.0)],
        ],
        [JointLimits()],
    )
    body.warm_up()
    start, turned = robot.hand(), robot.model.frame(HAND).rotation.copy()
    home = robot.world.position.copy()
    furthest = moved = angle = 0.0
    for cycle in range(1000):
        swing = 0.4 * np.sin(2 * np.pi * 0.5 * cycle * PERIOD)
        body["posture"].joints(home + swing)
        robot.cycle(body)
        furthest = max(furthest, float(np.linalg.norm(robot.hand() - start)))
        angle = max(angle, float(np.linalg.norm(pin.log3(turned.T @ robot.model.frame(HAND).rotation))))
        moved = max(moved, float(np.abs(robot.world.position - home)[:7].max()))
    assert moved > 0.1
    assert furthest < 4e-3
    assert angle < np.radians(1.5)


def test_a_hand_goes_where_it_is_told(robot_in) -> None:
    robot = robot_in()
    body = WholeBody(robot.model, [[CartPos(frame=HAND, name="hand")], [JPos(name="posture")]], [JointLimits()])
    goal = robot.hand() + np.array([0.0, 0.08, 0.06])
    start = robot.hand()
    for cycle in range(1000):
        share = min(cycle / 500, 1.0)
        body["hand"].pose(position=start + share**3 * (10 - 15 * share + 6 * share**2) * (goal - start))
        robot.cycle(body)
    assert np.linalg.norm(robot.hand() - goal) < 5e-3


def test_a_contact_holds_and_pushes_as_told_while_the_posture_moves(robot_in) -> None:
    ready = robot_in()
    tip = ready.model.frame(HAND)
    end = tip.act(np.array([0.0, 0.0, -0.031]))
    pose = pin.SE3(tip.rotation, tip.act(np.array([0.0, 0.0, -0.031 - 0.05])))
    quaternion = pin.Quaternion(pose.rotation)
    where = Pose(position=tuple(pose.translation), orientation=(quaternion.x, quaternion.y, quaternion.z, quaternion.w))
    wall = Box(pose_in_world=None, size=(0.3, 0.3, 0.1), friction=0.8)
    robot = robot_in(Scene(EMPTY.file, {"wall": wall}, {"wall": where}))
    point = (0.0, 0.0, -0.03)
    body = WholeBody(
        robot.model,
        [[Wrench(frame=HAND, name="push", force=(0.0, 0.0, -12.0))], [JPos(name="posture", stiffness=50.0)]],
        [PointContact(frame=HAND, point=point, name="wall", friction=0.5, stiffness=100.0), JointLimits()],
    )
    home = robot.world.position.copy()
    forces, places = [], []
    for cycle in range(1200):
        body["posture"].joints(home + 0.15 * np.sin(2 * np.pi * 0.5 * max(cycle - 300, 0) * PERIOD))
        robot.cycle(body)
        if cycle >= 300:
            forces.append(robot.world.contact_force["wall"])
            places.append(robot.model.frame(HAND).act(np.array(point)))
    assert np.mean(forces) == pytest.approx(12.0, abs=3.0), "N"
    assert min(forces) > 3.0, "it never lets go"
    assert np.linalg.norm(np.ptp(places, axis=0)) < 0.01, "nor slips"
    assert np.linalg.norm(end - places[0]) < 0.01
    assert np.abs(robot.world.position - home).max() > 0.03, "though the arm moves"


def test_energy_and_momentum_balance_with_what_the_joints_put_in(robot_in) -> None:
    """Kinetic and potential energy grow by the joints' work; joint momentum by τ − g + Cᵀ q̇: both within 3 %."""
    robot = robot_in()
    body = WholeBody(
        robot.model, [[CartPos(frame=HAND, name="hand", stiffness=300.0)], [JPos(name="posture")]], [JointLimits()]
    )
    start = robot.hand()
    model, data = robot.model.model, robot.model.model.createData()
    drives, at_joints = robot.world.drives, np.zeros(len(robot.world.position))
    step = drives.step

    def watched(*arguments) -> np.ndarray:
        at_joints[:] = step(*arguments)
        return at_joints

    drives.step = watched

    def energy() -> float:
        robot.look()
        q, v = robot.model.q, robot.model.v
        return pin.computeKineticEnergy(model, data, q, v) + pin.computePotentialEnergy(model, data, q)

    def momentum() -> np.ndarray:
        """Joint momentum M q̇."""
        robot.look()
        return robot.model.mass_matrix @ robot.model.v

    work, impulse, before, at_first = 0.0, np.zeros(robot.model.nv), energy(), momentum()
    energies, works, drift = [], [], 0.0
    for cycle in range(400):
        body["hand"].pose(position=start + np.array([0.0, 0.1, 0.1]) * np.sin(2 * np.pi * cycle * PERIOD))
        robot.look()
        result = body.solve()
        robot.output.advance(result.acceleration[robot.model.rows], robot.world.position, robot.world.velocity)
        command = robot.host.command
        command.torque[:] = result.torque[robot.model.rows]
        command.stiffness[:], command.damping[:] = 0.0, 0.0
        drives.command(command)
        for _ in range(2):
            position, velocity = robot.world.position.copy(), robot.world.velocity.copy()
            robot.model.place(position, velocity)
            matrix = pin.computeCoriolisMatrix(model, data, robot.model.q, robot.model.v)
            gravity = pin.computeGeneralizedGravity(model, data, robot.model.q)
            robot.world.advance(1)
            torque = np.zeros(robot.model.nv)
            torque[robot.model.rows] = at_joints
            mean = np.zeros(robot.model.nv)
            mean[robot.model.rows] = 0.5 * (velocity + robot.world.velocity)
            work += 1e-3 * float(torque @ mean)
            impulse += 1e-3 * (torque - gravity + matrix.T @ robot.model.v)
        energies.append(energy() - before)
        works.append(work)
        drift = max(drift, float(np.abs(momentum() - at_first - impulse).max()))
    assert np.ptp(energies) > 1.0, "J: something moves"
    assert np.abs(np.array(works) - energies).max() < 0.03 * np.ptp(energies)
    assert drift < 0.03 * np.abs(impulse).max() + 0.05
