"""A gantry that lets its robot down on its feet, as whoever works the hoist does: once the robot's drives hold it."""

from __future__ import annotations

import numpy as np

from hal.plant.bullet import pybullet as p
from hal.plant.robot_body import BASE, RobotBody
from hal.plant.sensors import GRAVITY

_SPEED, _WAIT_S = 0.01, 0.5
"""m/s; s for which every brake has been open before the robot is let down"""
_LETS_GO = 0.95
"""share of the robot's weight on the floor, at which the harness is slack and taken off"""
_FORCE = 5000.0
"""N, N·m: the harness holds the base upright and in its place"""


class Hoist:
    """Holds a free base where it was, lets it down, lets it go. Once gone it does not come back."""

    def __init__(self, body: RobotBody, floor: int, step_s: float):
        """`floor`: PyBullet's number of what it is let down on; `step_s`: of the plant."""
        self._body, self._client, self._floor, self._step = body, body.client, floor, step_s
        self._at, self._turned = (np.array(part) for part in body.base_motion()[:2])
        self._harness: int | None = p.createConstraint(
            body.number,
            BASE,
            -1,
            -1,
            p.JOINT_FIXED,
            [0, 0, 0],
            [0, 0, 0],
            self._at.tolist(),
            [0, 0, 0, 1],
            self._turned.tolist(),
            physicsClientId=self._client,
        )
        p.changeConstraint(self._harness, maxForce=_FORCE, physicsClientId=self._client)
        links = range(BASE, p.getNumJoints(body.number, physicsClientId=self._client))
        self._weight = GRAVITY * sum(
            p.getDynamicsInfo(body.number, link, physicsClientId=self._client)[0] for link in links
        )
        self._held_for = 0.0

    @property
    def slack(self) -> bool:
        """The robot stands, or falls, by itself."""
        return self._harness is None

    def work(self, held: bool) -> None:
        """One step on. held: the robot's drives hold it, and no brake does."""
        if self._harness is None:
            return
        self._held_for = self._held_for + self._step if held else 0.0
        if self._held_for < _WAIT_S:
            return
        self._at[2] -= _SPEED * self._step
        p.changeConstraint(
            self._harness, self._at.tolist(), self._turned.tolist(), maxForce=_FORCE, physicsClientId=self._client
        )
        touching = p.getContactPoints(self._body.number, self._floor, physicsClientId=self._client)
        if sum(contact[9] for contact in touching) > _LETS_GO * self._weight:
            p.removeConstraint(self._harness, physicsClientId=self._client)
            self._harness = None
