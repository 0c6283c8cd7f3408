"""Approach, contact, close the gripper, lift: one call, no round trip, judged by the plant."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from daemon.exchange import ActionState, Outcome
from daemon.serving.robot_info import robot_info
from hal.plant.bullet import pybullet as p
from hal.plant.scene import EMPTY, Box, Scene
from handrail.behaviour_file import BehaviourFile
from handrail.messages import Pose
from handrail.robot import library as robots
from handrail.robot.kinematics import Kinematics

MASS = 0.15
BEHAVIOUR = """
frame: grasp_right
gripper: gripper_right
joints: [torso, arm_right]
steps:
  - name: approach
    motion: {type: compliant_motion, duration: 1.2, shift: [0.06, 0, 0]}
    ends: [{type: contact, threshold: 5}]
    then: {contact: close, done: end}
  - name: close
    motion: {type: compliant_motion, duration: 3}
    gripper: {position: -0.95}
    ends: [{type: gripper_holds}, {type: gripper_at, position: -0.95, tolerance: 0.02}]
    then: {gripper_holds: lift, gripper_at: end}
  - name: lift
    motion: {type: compliant_motion, duration: 1, shift: [-0.03, 0, 0.08]}
"""


def placed(pose: pin.SE3) -> Pose:
    x, y, z, w = pin.Quaternion(pose.rotation).coeffs().tolist()
    return Pose(position=tuple(pose.translation.tolist()), orientation=(x, y, z, w))


@pytest.mark.parametrize("there", [True, False], ids=["a box", "nothing"])
def test_it_grasps_what_is_between_its_fingers_where_it_meets_the_wall_and_lifts_it(in_plant, tmp_path, there) -> None:
    talos = robots.load("talos_upper_grippers")
    grasp = Kinematics(talos).frame(talos.home_position(), "grasp_right")
    ahead = np.array([0.0, 0.0, -0.03])  # the fingers point along −z
    things = {"wall": Box(pose_in_world=None, size=(0.6, 0.6, 0.05), friction=0.1)}
    places = {"wall": placed(pin.SE3(grasp.rotation, grasp.act(np.array([0.0, 0.0, -0.085]))))}
    if there:
        things["box"] = Box(pose_in_world=None, size=(0.05, 0.03, 0.05), mass=MASS, friction=0.8)
        places["box"] = placed(pin.SE3(grasp.rotation, grasp.act(ahead)))
    robot = in_plant(Scene(EMPTY.file, things, places), talos)
    file = tmp_path / "grasp.yaml"
    file.write_text(BEHAVIOUR)
    told: list[int] = []

    def carry() -> None:
        """An unseen hand has the box's weight until it is lifted."""
        if there and (not told or told[-1] < 2):
            body = robot.world.body("box")
            here, _ = p.getBasePositionAndOrientation(body, physicsClientId=robot.world.client)
            weight = (0.0, 0.0, 9.81 * MASS)
            p.applyExternalForce(body, -1, weight, here, p.WORLD_FRAME, physicsClientId=robot.world.client)

    robot.port.each_step[:] = [carry]
    if there:  # it fell while the brakes opened
        body, place = robot.world.body("box"), places["box"]
        p.resetBasePositionAndOrientation(body, place.position, place.orientation, physicsClientId=robot.world.client)
        p.resetBaseVelocity(body, (0, 0, 0), (0, 0, 0), physicsClientId=robot.world.client)
    robot.post_behaviour(*BehaviourFile(file).call("a", "o", robot_info(talos)).steps)
    robot.run()
    for _ in range(4000):
        row = robot.snapshot()["actions"][0]
        if row["state"] == ActionState.ENDED:
            break
        told.append(int(row["step"]))
        robot.run()
    assert list(dict.fromkeys(told)) == ([0, 1, 2] if there else [0, 1])
    if not there:
        assert (Outcome(int(row["outcome"])), row["condition"]) == (Outcome.CONDITION, 1), "it closed on nothing"
        return
    assert Outcome(int(row["outcome"])) is Outcome.DONE
    before = np.array(places["box"].position)
    robot.run(100)
    rose = np.array(robot.world.truth().poses_in_world["box"].position) - before
    assert rose[2] > 0.06, f"m: {rose}"
    assert robot.loop.robot.hand("gripper_right").holds
