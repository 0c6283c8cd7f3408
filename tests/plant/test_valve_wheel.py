"""The wheel: Coulomb friction at its hinge, turned by contact alone, the same in every run."""

from __future__ import annotations

import hashlib
import math

import numpy as np
import pytest

from hal.plant.bodies import HINGE
from hal.plant.bullet import pybullet as p
from hal.plant.scene import Scene, Wheel, load
from hal.plant.world import World
from handrail.messages import Pose

TIP = (0.27, -0.40, 0.08)
"""the right tool's tip in the posture `ready`, m"""


START = math.radians(-20)


def _wheel_scene(tmp_path, position, friction: float, angle: float = 0.0) -> Scene:
    file = tmp_path / f"wheel_{friction}.yaml"
    file.write_text(
        f"objects:\n  valve:\n    kind: wheel\n    pose_in_world: {{position: [{', '.join(map(str, position))}]}}\n"
        f"    hinge_friction: {friction}\n    hinge_angle: {angle}\n"
    )
    return load(file)


@pytest.mark.parametrize(("torque", "turns"), [(1.9, False), (-1.9, False), (2.2, True), (-2.2, True)])
def test_a_wheel_turns_only_when_the_torque_exceeds_its_friction(robot, torque, turns):
    world = World(robot, load("valve"))
    body = world.body("valve")
    for _ in range(200):
        # A force along z at the rim's −y side gives a torque about +x of −y × force: pushed where the rim is, always.
        centre = np.array(world.scene.poses_in_world["valve"].position)
        at = centre + np.array([0.0, 0.15, 0.0])
        p.applyExternalForce(
            body, HINGE, [0, 0, torque / 0.15], at.tolist(), p.WORLD_FRAME, physicsClientId=world.client
        )
        world.step()
    angle = world.hinge_angle("valve")
    world.close()
    if turns:
        assert abs(angle) > 0.05
        assert math.copysign(1, angle) == math.copysign(1, torque)
    else:
        assert abs(angle) < 1e-3


def _push(make_host, scene: Scene):
    """The torso turns the tool, which stands between two spokes, against one of them."""
    host = make_host(scene)
    host.enable()
    torso = host.world.description.index("torso_1_joint")
    trace = hashlib.sha256()
    for cycle in range(600):
        host.command.position[torso] = 0.2 * min(1.0, cycle / 500)
        host.cycle()
        for array in (host.world.position, host.world.velocity, host.world.drives.actuators.spring_torque):
            trace.update(array.tobytes())
        trace.update(np.float64(host.world.hinge_angle("valve")).tobytes())
    return host.world, trace.hexdigest()


def _around_the_tool(tmp_path, friction: float) -> Scene:
    """The tool stands through the wheel's plane, 10 cm above the hinge, 20° before a spoke."""
    return _wheel_scene(tmp_path, (TIP[0] + 0.01, TIP[1], TIP[2] - 0.10), friction, START)


def test_contact_alone_turns_the_wheel_and_its_force_is_known(make_host, tmp_path):
    world, _ = _push(make_host, _around_the_tool(tmp_path, 2.0))
    # The tool moved towards +y above the hinge: about +x, that is backwards.
    assert world.hinge_angle("valve") < START - 0.1
    truth = world.truth()
    # 2 N·m of friction at 10 cm need 20 N.
    assert 15.0 < truth.peak_contact_force["valve"] < 100.0
    assert truth.hinges["valve"] == world.hinge_angle("valve")
    assert truth.time_ns == world.steps * 1_000_000


def test_a_wheel_that_is_stuck_stays_where_it_is(make_host, tmp_path):
    world, _ = _push(make_host, _around_the_tool(tmp_path, 100.0))
    assert abs(world.hinge_angle("valve") - START) < 0.01
    assert world.peak_contact_force["valve"] > 20.0


def test_two_runs_are_the_same_bit_for_bit(make_host, tmp_path):
    scene = _around_the_tool(tmp_path, 2.0)
    assert _push(make_host, scene)[1] == _push(make_host, scene)[1]


def test_the_truth_knows_where_the_objects_are(make_host):
    truth = make_host(load("valve")).world.truth()
    assert truth.poses_in_world == {"valve": Pose(position=(0.55, -0.35, 0.30))}
    assert truth.hinges == {"valve": 0.0}
    assert truth.joints["arm_right_4_joint"] == pytest.approx(-1.931)


def test_the_built_in_valve_is_the_one_that_the_goals_name():
    valve = load("valve").objects["valve"]
    assert isinstance(valve, Wheel)
    assert (valve.radius, valve.spokes, valve.hinge_friction) == (0.15, 4, 2.0)


def test_a_box_stands_still_and_knows_when_it_is_touched(make_host, tmp_path):
    file = tmp_path / "wall.yaml"
    # Right before the end of the tool, which points along +x and sticks 3 cm out of the tip.
    file.write_text(
        "objects:\n  wall:\n    kind: box\n"
        f"    pose_in_world: {{position: [{TIP[0] + 0.09}, {TIP[1]}, {TIP[2]}]}}\n    size: [0.1, 0.5, 0.5]\n"
    )
    host = make_host(load(file))
    host.enable()
    assert host.world.peak_contact_force["wall"] == 0.0
    host.command.position[host.world.description.index("torso_1_joint")] += 0.1  # the right shoulder goes forward
    host.cycle(100)
    truth = host.world.truth()
    assert truth.contact_force["wall"] > 5.0
    assert truth.hinges == {}
    assert truth.poses_in_world["wall"].position == pytest.approx((TIP[0] + 0.09, TIP[1], TIP[2]))
