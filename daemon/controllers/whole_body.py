"""Runs a compound task: torques of whole-body control, and an impedance about where they lead (Radford et al. 2015, §5.2.4)."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np
import pinocchio as pin

from daemon.controllers.base import Array, Gains, MotionController, NotStandingError
from daemon.controllers.frame_room import frame_room, least, point_room
from daemon.controllers.references import HermitePath, LinePath, PathClock, placement
from daemon.state.robot_state import RobotState
from daemon.wbc import moving
from daemon.wbc.composition import CompoundTask
from daemon.wbc.handle import Handle
from daemon.wbc.hierarchy import WholeBody
from daemon.wbc.impedance import Easing, ImpedanceOutput
from daemon.wbc.model import WholeBodyModel
from daemon.wbc.references import (
    FrameTrajectory,
    JointTrajectory,
    Leashes,
    Over,
    PointTrajectory,
    Reference,
    StreamedPose,
)
from daemon.wbc.standing import standing_on, upright
from daemon.wbc.tasks import COM, SE3, CartPos, QuaternionOrientation
from hal.joint import JointCommand, Mode
from handrail import messages as m
from handrail.robot.kinematics import Kinematics

PATIENCE = 0.05
"""s for which constraints may exclude each other before the action ends"""
REACH, TURN = 0.10, 0.5
"""m, rad: a task pulls no harder than at this distance from its reference"""
DAMPING = 0.15
"""of the solver's levels, where they are singular or bounds are active: a step of torque may tear more than a task left short"""
_SETTLE, _HARDEST = 0.01, 30.0
"""s, rad/s²: of the accelerations that others' commands say their joints will make"""
_IMPEDANCE = int(Mode.IMPEDANCE)


class WholeBodyControl(MotionController):
    """τ, q, q̇ of a compound task's solution at the state measured now, K and D a share of the robot's own.

    Joints that the motion does not claim go where others command them: their accelerations are known to the solution.

    References that nobody gave are where the joints were commanded to be; one clock moves them all, and slows them down. While
    constraints exclude each other the solution is the one that breaks them least; after `PATIENCE` s of that the action ends.

    A compound task with contacts at the robot's feet stands on them: then its base is free, and where the estimate has it, and
    references that nobody gave are those of the robot upright. Any other compound takes the base for fixed, and for the world.
    """

    name = "whole_body"

    def __init__(
        self,
        motion: m.WholeBody,
        compound: CompoundTask,
        model: WholeBodyModel,
        gains: Gains,
        period: float,
        feet: Sequence[int] = (),
    ):
        """`model`: of the robot as it is about now, on a free base where it stands on `feet` (numbers of the description's).

        Takes long (several ms, and once seconds, since it loads compiled code). Raises daemon.wbc.parameters.WbcError.
        """
        n = len(model.joints)
        claimed = np.isin(model.joints, motion.joints or model.joints)
        super().__init__(np.flatnonzero(claimed), gains)
        self._motion, self._period = motion, period
        self._compound, self._model, self._feet = compound, model, list(feet)
        self._others = np.flatnonzero(~claimed)
        self._seen = np.zeros((2, len(self._others)))
        self.body: WholeBody = compound.on(model, [model.joints[joint] for joint in self._others])
        self.body.damp(DAMPING)
        self.body.warm_up()
        moving.warm_up(n)
        self.clock = PathClock(motion.duration or _longest(motion.references), period)
        self._rows = model.rows[self.joints]
        self._output = ImpedanceOutput(len(self.joints), period, rows=self._rows)
        drives = np.array((motion.stiffness * gains.stiffness, motion.damping * gains.damping))
        self._drives = np.ascontiguousarray(drives[:, self.joints])
        self._streams: dict[str, StreamedPose] = {}
        self._lines: list[tuple[CartPos | QuaternionOrientation | SE3, LinePath]] = []
        self._points: list[tuple[CartPos | QuaternionOrientation | SE3, HermitePath]] = []
        self._knots: list[HermitePath] = []
        """trajectories among the references, of frames and of postures"""
        tasks = [task for level in compound.levels for task in level]
        framed = [task for task in tasks if isinstance(task, CartPos | QuaternionOrientation | SE3)]
        self._handles = [self.body[task.title] for task in framed]
        self._framed = {task.title: task for task in framed}
        self._leashes = Leashes(self.body, [], [], self.clock, REACH, TURN)
        self._by_frame = {
            task.frame: (place, task) for place, task in enumerate(framed) if isinstance(task, CartPos | SE3)
        }
        self._solution = self.body.memory["out"]
        torques = np.ascontiguousarray(model.model.effortLimit[self._rows])
        self._easing = Easing(torques, self.body.memory, period)
        self._unsolved = 0

    @property
    def failure(self) -> str:
        """Which constraint blocks the others, once they have excluded each other for too long."""
        return self.body.result.why if self._unsolved * self._period > PATIENCE else ""

    def renew(self) -> None:
        self.clock = PathClock(self.clock.length, self._period)
        self._streams, self._unsolved = {}, 0

    def activate(self, robot: RobotState, last: JointCommand) -> None:
        # From what is commanded, not measured: what the robot leans on now, it goes on leaning on.
        base, still = robot.base, np.zeros(len(last.position))
        if self._model.free:
            if missing := [foot for foot in self._feet if not base.contact[foot]]:
                raise NotStandingError(missing[0], robot.kinematics.description.feet[missing[0]].name)
            self._model.place(last.position, still, upright(base.pose), np.zeros(6))
        else:
            self._model.place(last.position, still)
        self.body.start_here()
        self._lines, self._points, self._knots = [], [], []
        references = [self._reference(reference, robot, last) for reference in self._motion.references]
        self.clock.room = lambda: self._room(robot)
        references += [
            Over(self.body[task.title], self._model, task.over, self._period)
            for level in self._compound.levels
            for task in level
            if isinstance(task, COM) and task.over
        ]
        self._leashes = Leashes(self.body, self._handles, references, self.clock, REACH, TURN)
        self._output.start(last.position[self.joints], last.velocity[self.joints])
        self._easing.start()
        self._seen[0], self._seen[1] = last.velocity[self._others], 0.0

    def update(self, robot: RobotState, out: JointCommand) -> None:
        self._leashes.advance()
        joints, output = robot.joints, self._output
        self._model.place(joints.position, joints.velocity, robot.base.pose, robot.base.twist)
        if len(self._others):
            moving.follow_others(out.velocity, self._others, self._seen, self._period, _SETTLE, _HARDEST)
            self.body.lead(self._seen[1])
        self._unsolved = 0 if self.body.solve().solved else self._unsolved + 1
        told = (joints.table, self._drives, self.joints, _IMPEDANCE, out.table, out.mode)
        solved = (self._solution, self._rows, *self._easing.arguments)
        moving.tell(output.desired, *output.settings, *solved, *told)

    def _room(self, robot: RobotState) -> tuple[float, float]:
        """Of the joints' limits, what the trajectories leave for a change of the clock's rate, each as if followed exactly."""
        description, rows = robot.kinematics.description, self.joints
        limits = np.array((description.acceleration_limit, description.jerk_limit))
        place = (rows, robot.joints.position, limits[:, rows])
        # Kinematics are seen from the base; lines are in the world, or in the frame that their task is relative to.
        base = pin.XYZQUATToSE3(robot.base.pose).rotation if self._model.free else np.eye(3)
        turned = [(task, path, base.T @ self._model.frame(task.relative_to).rotation) for task, path in self._points]
        points = [
            point_room(path, self.clock.s, robot.kinematics, task.frame, *place, axes=axes)
            for task, path, axes in turned
        ]
        lines = [
            frame_room(
                path, self.clock.s, robot.kinematics, task.frame, *place,
                axes=base.T @ self._model.frame(task.relative_to).rotation,
            )
            for task, path in self._lines
        ]  # fmt: skip
        return least([*lines, *points, *(path.room(limits) for path in self._knots)])

    def receive(self, task: str, position: Array | None, orientation: Array | None, velocity: Array) -> bool:
        stream = self._streams.get(task)
        return stream is not None and stream.receive(position, orientation, velocity)

    def lag(self, robot: RobotState, frame: str) -> Array:
        """Of a frame that a task brings somewhere, that task's reference minus where it is measured."""
        if frame not in self._by_frame:
            return super().lag(robot, frame)
        place, task = self._by_frame[frame]
        return self._model.frame(task.relative_to).rotation @ self._leashes.off(place)

    def _reference(self, reference: m.Reference, robot: RobotState, last: JointCommand) -> Reference:
        handle = self.body[reference.task]
        match reference:
            case m.FrameLine():
                position, rotation = (part.copy() for part in handle.reference)
                goal = _goal(reference.goal, handle, reference.shift)
                path = LinePath(rotation, position, goal, reference.duration)
                self._lines.append((self._framed[reference.task], path))
                return FrameTrajectory(handle, path, self._period, self.clock)
            case m.FrameKnots():
                point = _through(reference, handle.reference[0])
                self._points.append((self._framed[reference.task], point))
                return PointTrajectory(handle, point, self._period, self.clock)
            case m.PostureKnots():
                joints = robot.kinematics.description.index(tuple(reference.joints))
                knots = np.tile(last.position, (len(reference.times), 1))
                speeds = np.zeros_like(knots)
                knots[:, joints], speeds[:, joints] = reference.positions, reference.velocities
                through = HermitePath(np.array(reference.times), knots, speeds)
                self._knots.append(through)
                return JointTrajectory(handle, through, len(last.position), self._period, self.clock)
            case m.PoseStream():
                stream = StreamedPose(
                    handle,
                    self._period,
                    stale=reference.stale,
                    speed=reference.speed,
                    turn=reference.turn,
                    clock=self.clock,
                )
                self._streams[reference.task] = stream
                return stream
        fixed = StreamedPose(handle, self._period, speed=reference.speed, turn=reference.turn, clock=self.clock)
        goal = _goal(reference.pose, handle, reference.shift)
        fixed.receive(goal.translation, goal.rotation)
        return fixed


def made_from(text: bytes, kinematics: Kinematics, gains: Gains, period: float, position: Array) -> WholeBodyControl:
    """A controller from what the server has checked and sent: a WholeBody in MessagePack whose compound is one JSON object.

    `position` (n,) rad: about where the robot is.
    """
    motion = msgspec.msgpack.decode(text, type=m.WholeBody)
    compound = msgspec.json.decode(motion.compound, type=CompoundTask)
    feet = standing_on(compound, kinematics.description)
    model = WholeBodyModel.of(kinematics, free=bool(feet))
    model.place(position, np.zeros(len(position)))
    return WholeBodyControl(motion, compound, model, gains, period, feet)


def _longest(references: Sequence[m.Reference]) -> float:
    """s that the longest trajectory among them takes, infinite where there is none."""
    lengths = [reference.duration for reference in references if isinstance(reference, m.FrameLine)]
    lengths += [each.times[-1] for each in references if isinstance(each, m.PostureKnots | m.FrameKnots)]
    return max(lengths, default=float("inf"))


def _through(reference: m.FrameKnots, here: Array) -> HermitePath:
    """Through the knots from `here` (3,) m: what the first one is off is taken up minimum-jerk on the way."""
    times, positions = np.array(reference.times), np.array(reference.positions)
    u = times / times[-1]
    left = 1.0 - u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
    slope = -30.0 * u * u * (1.0 - u) ** 2 / times[-1]
    off = here - positions[0]
    return HermitePath(times, positions + np.outer(left, off), np.array(reference.velocities) + np.outer(slope, off))


def _goal(pose: m.Pose | None, handle: Handle, shift: m.Vector) -> pin.SE3:
    """`pose`, or by `shift` m from where the task's reference is."""
    if pose is None:
        position, rotation = handle.reference
        return pin.SE3(rotation.copy(), position + np.array(shift))
    return placement(pose)
