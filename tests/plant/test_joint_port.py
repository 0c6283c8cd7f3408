"""Torques in, a step, and joints' states out: the fast way and the plain one."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from hal.plant import joint_port
from hal.plant.bullet import pybullet as p
from hal.plant.joint_port import JointPort
from hal.plant.world import World
from handrail.robot import library as robots


def _port(world: World, *, native: bool) -> JointPort:
    joints = world.robot.joints
    return JointPort(
        world.robot.number,
        world.client,
        [joints[joint] for joint in world.description.joints],
        world.devices.joints,
        world.devices.links,
        native=native,
    )


private_symbols = pytest.mark.skipif(
    sys.platform != "linux", reason="elsewhere the library's private symbols are not looked up"
)


@private_symbols
@pytest.mark.parametrize("name", ["talos_upper", "talos_upper_grippers", "panda"])
def test_c_functions_and_python_functions_give_the_same_bits(name):
    trace = {}
    for native in (True, False):
        world = World(robots.load(name))
        for joint in world.robot.joints.values():  # no brakes: all move
            p.setJointMotorControl2(
                world.robot.number, joint, p.VELOCITY_CONTROL, force=0, physicsClientId=world.client
            )
        port = _port(world, native=native)
        assert port.native == native
        torque, rows = np.linspace(-3.0, 4.0, len(port.position)), []
        for _ in range(30):
            port.step(torque)
            port.look_at_links()
            rows.append(np.concatenate([port.position, port.velocity, port.felt.ravel(), port.moved.ravel()]))
        trace[native] = np.array(rows)
        world.close()
    assert np.abs(trace[True][-1] - trace[True][0]).max() > 1e-3  # it moved
    assert trace[True].tobytes() == trace[False].tobytes()


def test_a_look_sees_what_was_put_there_without_a_step(robot):
    world = World(robot)
    position = world.position + 0.01
    world.place(position)
    np.testing.assert_array_equal(world.position, position)
    assert not world.velocity.any()
    world.close()


def test_a_closed_world_refuses_to_step(robot):
    world = World(robot)
    world.step()
    world.close()
    with pytest.raises(p.error, match="Not connected"):
        world.step()


def test_a_world_that_somebody_else_closed_refuses_too_and_does_not_crash(robot):
    world = World(robot)
    world.step()
    p.disconnect(world.client)
    with pytest.raises(p.error, match="Not connected"):
        world.step()
    with pytest.raises(p.error, match="Not connected"):
        world.devices.measure()


@private_symbols
def test_a_body_that_was_removed_is_an_error_and_no_crash(robot):
    world = World(robot)
    port = _port(world, native=True)
    assert port.native
    p.removeBody(world.robot.number, physicsClientId=world.client)
    with pytest.raises(RuntimeError, match="does not tell the state"):
        port.step(np.zeros(len(port.position)))
    with pytest.raises(RuntimeError, match="does not tell the state"):
        port.look_at_links()
    world.close()


@pytest.fixture
def table_anew():
    """The library's table of clients is looked up again, before and after the test."""
    joint_port._table_of_clients.cache_clear()
    yield
    joint_port._table_of_clients.cache_clear()


@private_symbols
def test_a_library_of_another_version_is_used_by_its_python_functions(robot, monkeypatch, table_anew):
    monkeypatch.setattr(p, "getAPIVersion", lambda: joint_port._VERSION + 1)
    world = World(robot)
    assert not _port(world, native=True).native
    world.step()
    world.close()


@private_symbols
@pytest.mark.parametrize("function", ["_look", "_look_at_links"])
def test_c_functions_that_see_another_body_than_python_are_not_used(robot, monkeypatch, function):
    world = World(robot)
    assert _port(world, native=True).native
    really = getattr(joint_port, function)

    def elsewhere(client, body, *more):
        really(client, body, *more)
        more[-2].ravel()[0] += 1e-9  # what it has written

    monkeypatch.setattr(joint_port, function, elsewhere)
    assert not _port(world, native=True).native
    monkeypatch.setattr(joint_port, function, lambda client, body, *more: really(client, body + 1, *more))
    assert not _port(world, native=True).native
    world.close()
