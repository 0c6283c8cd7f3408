"""Keeps the robot from running into itself, and out of regions: brakes while there is room for it, and latches.

Every command that is about to be written is judged with the limits already applied (daemon.safety.separation): may it be written,
and the robot brake from then on, without a pair of bodies coming nearer than its margin? So the command before is always one from
which braking is safe, and if this one is not, whoever commands the joints between the two bodies brakes from there. Pairs that are
within their margin when the robot is enabled, or when a trip is acknowledged, are excused until they have left it: they may stay,
and go away from each other, but come no nearer.

What counts of a joint is what it is told; of one whose drive holds it softly, or not at all, what is measured of it. Where somebody
has pushed a stiff joint away from its command, the same is asked a second time of where it is: arms that are pushed together may
stay so, but nothing moves on towards them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from daemon.controllers.base import Ended
from daemon.controllers.brake import Brake
from daemon.controllers.manager import ControllerManager
from daemon.exchange import Outcome, Rule, frame_names
from daemon.safety.bodies import Bodies
from daemon.safety.braking import Braking
from daemon.safety.ledger import GUARDS, Ledger
from daemon.safety.separation import COMMANDED, EXCUSING, MAX_TRIPS, PUSHED, judge
from daemon.state.robot_state import RobotState
from hal.joint import JointCommand

Array = NDArray[np.float64]


class Guard:
    """Judges each cycle's command, and has the manager brake."""

    def __init__(self, manager: ControllerManager, robot: RobotState, ledger: Ledger):
        self._manager, self._ledger = manager, ledger
        self._bodies = bodies = Bodies.of(robot.kinematics)
        n, description = len(robot.joints), robot.kinematics.description
        self._rows = {name: row for row, name in enumerate(frame_names(description))}
        self._regions = {region.name: row for row, region in enumerate(description.guard.regions)}
        self._braking = Braking(robot.kinematics, bodies.limits, robot.period)
        self._kept, self._pushed = bodies.kept(), bodies.kept()
        self._moving = self._kept.moving
        self._present_speed = self._moving[1]
        self._measured, self._period = robot.joints.table, robot.period
        self._speed, self._duration = np.zeros(n), 0.0
        """of the command before: rad/s, and s that braking from it takes"""
        self._excuses, self._latched = True, False
        self._brakes: list[Brake] = []

    def begin(self) -> None:
        """Joints are commanded from this cycle on that were not before: wherever the robot stands, it may stand."""
        self._excuses = True

    def brakes(self, command: JointCommand, last: JointCommand) -> bool:
        """Whether `command` may not follow `last`, since no room would be left to brake: the manager has made another one."""
        if not len(self._bodies.pairs):
            return False
        if self._latched and not any(self._ledger.holds(rule) for rule in GUARDS):  # somebody has acknowledged it
            self._latched, self._excuses = False, True
        if self._brakes:
            self._let_go(last)
        self._braking.begin_cycle()
        if self._excuses:
            self._excuses = False
            self._judge(command, command, EXCUSING)
        found, duration, pushed = self._judge(command, last, COMMANDED)
        if found and self._brake(self._kept.trips[:found], last):
            return True
        if (
            pushed
            and (found := self._judge(command, last, PUSHED)[0])
            and self._brake(self._pushed.trips[:found], last)
        ):
            return True
        np.copyto(self._speed, self._present_speed)
        self._duration = duration
        return False

    def _judge(self, command: JointCommand, last: JointCommand, look: int) -> tuple[int, float, bool]:
        """See `judge`: by the most that braking can need, and if somebody would have to brake, by what it needs here."""
        braking, kept = self._braking, self._pushed if look == PUSHED else self._kept
        told, period = (command.table, last.table, self._measured), self._period
        found, duration, pushed = judge(*told, braking.limits, kept.table, period, look)
        if found and look != EXCUSING and braking.look(kept.moving, duration):
            found, duration, pushed = judge(*told, braking.limits, kept.table, period, look)
        return found, duration, pushed

    def _brake(self, trips: Array, last: JointCommand) -> bool:
        joints = np.unique(np.concatenate([self._bodies.between(int(pair)) for pair in trips[:, 0]]))
        if len(trips) == MAX_TRIPS:  # there may be more
            joints = np.arange(len(last))
        soft = last.stiffness < self._bodies.limits[-1]
        start, speed = np.where(soft, self._moving[0], last.position), np.where(soft, self._moving[1], self._speed)
        pair, distance, _ = trips[int(np.argmin(trips[:, 2]))]
        one, other = (self._bodies.names[body] for body in self._bodies.pairs[int(pair), :2])
        why = Ended(Outcome.TOO_CLOSE, detail=f"{one} was {distance:.3f} m from {other}")
        brake = self._manager.brake(joints, start, speed, self._duration, last, why)
        if brake is None:
            return False  # nobody moves these joints who is not braking already
        self._brakes.append(brake)
        self._latched = True
        others = np.setdiff1d(np.arange(len(last)), brake.joints)
        self._speed[others] = self._moving[1, others]
        region = self._regions.get(other)
        rule = Rule.SELF_COLLISION if region is None else Rule.WORKSPACE
        row = self._rows[other] if region is None else region
        margin = float(self._bodies.margins[int(pair)])
        self._ledger.trip(rule, self._rows[one], float(distance), margin, holds=True, other=row)
        return True

    def _let_go(self, last: JointCommand) -> None:
        """What has braked is held from now on, as any joint that nobody commands."""
        for brake in [brake for brake in self._brakes if brake.done or brake not in self._manager.active]:
            self._brakes.remove(brake)
            if brake in self._manager.active:
                self._manager.switch([brake], [], last)
