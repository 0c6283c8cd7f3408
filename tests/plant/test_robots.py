"""A robot with a free base hangs in its gantry, or stands. (tests/robots looks at every robot.)"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from hal.plant.bullet import pybullet as p
from hal.plant.robot_body import BASE
from hal.plant.world import World
from handrail.robot import library as robots
from handrail.robot.kinematics import Kinematics


def test_a_robot_without_its_gantry_stands_on_its_feet(host_of):
    robot = dataclasses.replace(robots.load("talos"), support="none")
    world, kinematics = World(robot), Kinematics(robot)
    host = host_of(world, kinematics)
    host.enable()
    carried = 0.0
    for _ in range(200):
        host.cycle()
        contacts = p.getContactPoints(world.robot.number, world.floor, physicsClientId=world.client)
        carried += sum(contact[9] for contact in contacts) / 200
    weight = 9.81 * sum(inertia.mass for inertia in kinematics.model.inertias)
    feet = {world.robot.links[f"leg_{side}_6_link"] for side in ("left", "right")}
    assert {contact[3] for contact in contacts} == feet
    assert carried == pytest.approx(weight, rel=0.05)
    _, position, turned, _, _ = world.robot.link_motion(BASE)
    assert np.linalg.norm(position) < 0.1
    assert 2 * np.arccos(min(1.0, abs(turned[3]))) < 0.15
    world.close()


def test_a_hung_robots_base_stays_where_it_is(host_of):
    robot = robots.load("talos")
    host = host_of(World(robot), Kinematics(robot))
    host.enable()
    host.cycle(50)
    assert host.world.robot.link_motion(BASE)[1] == (0.0, 0.0, 0.0)
    host.world.close()
