"""Several milliseconds at once are the same as one after the other."""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np
import pytest

from hal.drives.lifecycle import State, controlword_towards
from hal.joint import JointCommand, Mode
from hal.plant import scene
from hal.plant.world import World
from handrail.robot import library as robots


def _one_by_one(world: World, steps: int) -> None:
    for left in range(steps, 0, -1):
        world.step(felt=left == 1)


def _at_once(world: World, steps: int) -> None:
    world.advance(steps)


def _trace(world: World, go_on: Callable[[World, int], None]) -> tuple[np.ndarray, list[bool]]:
    """What drives, bodies and sensors say after each turn of a life: enabled, moving, left alone until the brakes have closed."""
    drives, n = world.drives, len(world.description.joints)
    command, words = JointCommand(n), np.zeros(n, np.uint8)
    command.position[:], command.mode[:] = world.position, Mode.IMPEDANCE
    command.stiffness[:], command.damping[:] = world.description.stiffness, 0.05 * world.description.stiffness
    rows, brakes = [], []
    for turn in range(260):
        if turn < 100:
            words[:] = controlword_towards(State.OPERATION_ENABLED, drives.state, words)
            drives.control(words)
            command.position[-2:] += 0.002
            drives.command(command)
        go_on(world, 1 + turn % 3)
        told = world.devices.measure().values
        rows.append(np.concatenate([world.position, world.velocity, drives.actuators.spring_torque, told.ravel()]))
        brakes.append(bool(drives.brakes[0]))
    world.close()
    return np.array(rows), brakes


@pytest.mark.parametrize("name", ["talos_upper", "talos_upper_grippers"])
def test_steps_made_at_once_give_the_bits_of_steps_made_one_by_one(name):
    robot, objects = robots.load(name), scene.load("valve")
    slow, brakes = _trace(World(robot, objects), _one_by_one)
    fast, same = _trace(World(robot, objects), _at_once)
    assert brakes == same and brakes[0] and not brakes[90] and brakes[-1], "brakes opened and closed on the way"
    assert np.abs(fast - fast[0]).max() > 0.05, "it moved"
    assert fast.tobytes() == slow.tobytes()


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the library's private symbols are not looked up")
def test_it_goes_on_at_once_until_somebody_looks():
    world = World(robots.load("talos_upper"), scene.load("valve"))
    world.step()  # brakes close
    assert [world.go_on(2), world.go_on(1), world.go_on(9), world.go_on(5)] == [2, 1, 4, 4]
    assert world.steps == 12
    world.close()
