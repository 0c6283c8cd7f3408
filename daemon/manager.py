"""Which controller commands which joint: claims, whole switches, and the bump taken out of each.

A switch names the controllers that go and those that come; it happens in one cycle or not at all. Every joint of an enabled robot
has exactly one controller: the joints that no motion claims, `hold` does.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from daemon.controllers.base import Array, Controller, Gains
from daemon.controllers.hold import Hold
from daemon.exchange import CONTROLLERS
from daemon.references import fade
from daemon.robot_state import RobotState
from daemon.safety.limits import effective_torque
from hal.joint import JointCommand

FADE = 0.2
"""s in which the torque that a switch would have made jump is let go"""


class ClaimError(Exception):
    """A switch that would give one joint to two controllers. Nothing was switched."""

    def __init__(self, joint: int):
        self.joint = joint
        super().__init__(f"joint {joint} is claimed by another active controller")


class ControllerManager:
    """Runs the active controllers, one a joint, into one command."""

    def __init__(self, robot: RobotState, gains: Gains):
        n = len(robot.joints)
        self.robot, self.gains = robot, gains
        self.active: list[Controller] = []
        self.command = JointCommand(n)
        """this cycle's set-points, before the final limits"""
        self.claims = np.zeros(n, np.uint8)
        """(n,) index into daemon.exchange.CONTROLLERS of each joint's controller; 0: none"""
        self._rated_torque = robot.kinematics.description.torque_limit
        self._offset = np.zeros(n)
        self._since_switch = np.full(n, np.inf)
        self._switched = np.zeros(n, bool)
        self._settled = True
        """no switch is being smoothed"""

    @property
    def enabled(self) -> bool:
        """Every joint has a controller."""
        return bool(self.active)

    def enable(self) -> None:
        """Hold every joint where it is measured, from this cycle on: the drives have just come to life."""
        hold = Hold(np.arange(len(self.claims)), self.gains, self.robot.joints.position)
        # There is no torque to continue from: the brakes carried the robot until now. Nor is there a switch to smooth, though
        # one may have been begun in the cycle in which the robot was stopped.
        self._since_switch[:] = np.inf
        self._switched[:] = False
        self._settled = True
        self._set([hold])

    def release_all(self) -> None:
        """Take away every claim at once; nothing is commanded any more."""
        self._set([])

    def switch(self, go: Sequence[Controller], come: Sequence[Controller], last: JointCommand) -> None:
        """End some controllers and start others, in this cycle; `hold` gets the joints that are left over.

        `last` is the command as it was last written, from which the newcomers start. Raises ClaimError, and changes nothing,
        when a joint would be claimed twice.
        """
        stay = [c for c in self.active if not isinstance(c, Hold) and all(c is not other for other in go)]
        free = np.ones(len(self.claims), bool)
        for controller in (*stay, *come):
            if not free[controller.joints].all():
                raise ClaimError(int(controller.joints[int(np.argmin(free[controller.joints]))]))
            free[controller.joints] = False
        # A joint that was held goes on being held at the same command: to its drive nothing happens.
        was_held = self.claims == CONTROLLERS.index(Hold.name)
        fresh: list[Controller] = list(come)
        if free.any():
            fresh.append(Hold(np.flatnonzero(free), self.gains, self._hold_position(last)))
        for controller in fresh:
            controller.activate(self.robot, last)
            self._switched[controller.joints] = True
        self._switched[free & was_held] = False
        self._settled = False
        self._set([*stay, *fresh])

    def update(self, last: JointCommand) -> JointCommand:
        """This cycle's command from all active controllers; `last` is the command as it was last written.

        What a switch would make jump in the drives' torque, at the state measured now, is added as an offset that is let go
        over `FADE` seconds.
        """
        for controller in self.active:
            controller.update(self.robot, self.command)
        if not self._settled:
            self._smooth_switch(last)
        return self.command

    def _smooth_switch(self, last: JointCommand) -> None:
        state = self.robot.joints
        if self._switched.any():
            before = effective_torque(last, state.position, state.velocity)
            after = effective_torque(self.command, state.position, state.velocity)
            self._offset[self._switched] = (before - after)[self._switched]
            self._since_switch[self._switched] = 0.0
            self._switched[:] = False
        fading = np.flatnonzero(self._since_switch < FADE)
        for joint in fading:
            self.command.torque[joint] += self._offset[joint] * fade(self._since_switch[joint], FADE)
        self._since_switch += self.robot.period
        self._settled = not len(fading)

    def _hold_position(self, last: JointCommand) -> Array:
        """(n,) rad where to hold joints: where they were commanded to be.

        One that comes from a softer controller may be far from its command: it is held no further from where it is than half
        of its rated torque bends its spring.
        """
        measured, stiffness = self.robot.joints.position, self.gains.stiffness
        reach = 0.5 * self._rated_torque / stiffness
        within_reach = np.clip(last.position, measured - reach, measured + reach)
        return np.where(last.stiffness < 0.5 * stiffness, within_reach, last.position)

    def _set(self, active: list[Controller]) -> None:
        self.active = active
        self.claims[:] = 0
        for controller in active:
            self.claims[controller.joints] = CONTROLLERS.index(controller.name)
