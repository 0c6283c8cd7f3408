"""Follows joint references that a client streams, bridges what is lost or late, and holds where nothing comes."""

from __future__ import annotations

import numpy as np

from daemon.controllers.base import Array, Gains, MotionController
from daemon.controllers.references import PathClock
from daemon.exchange import StreamMotion
from daemon.state.robot_state import RobotState
from hal.joint import JointCommand
from handrail.compiled import compiled

FADE = 0.1
"""s in which it comes to a stand where nothing comes any more, and sets off again"""
SETTLE = 0.05
"""s: a gap g between what was sent and what is commanded is worked off at g / SETTLE"""
# Rows of the state: what was sent (and went on since), what is commanded, and what the joints may do.
_SENT, _SENT_RATE, _POSITION, _VELOCITY, _LOWER, _UPPER, _FASTEST = range(7)


class StreamClock(PathClock):
    """Time itself, that pauses and cancellations slow down; it stands, too, while nothing comes."""

    def __init__(self, period: float):
        super().__init__(np.inf, period)
        self.silent = False

    @property
    def standing(self) -> bool:
        return self.silent or super().standing

    def run_at(self, speed: float) -> None:
        """How fast it is, is whoever streams' business."""

    def begin(self, speed: float, held: bool) -> None:
        super().begin(1.0, held)


class JointStream(MotionController):
    """Joint impedance about the newest sample, which goes on at its velocity for at most `bridge` s after it came.

    What is commanded follows that without lag, works off any gap no faster than the motion's `speed`, and stays within the joints'
    limits of position and velocity. A sample that comes after a newer one is dropped. While it is paused its age stands still.
    """

    name = "joint_stream"
    clock: StreamClock

    def __init__(self, motion: StreamMotion, gains: Gains, period: float):
        super().__init__(motion.joints, gains)
        self._motion, self._period = motion, period
        self.clock = StreamClock(period)
        self._state = np.zeros((7, len(motion.joints)))
        self._newest, self._age, self._share = 0, 0.0, 0.0

    def activate(self, robot: RobotState, last: JointCommand) -> None:
        description, rows, state = robot.kinematics.description, self.joints, self._state
        state[_SENT] = state[_POSITION] = last.position[rows]
        state[_LOWER], state[_UPPER] = description.lower[rows], description.upper[rows]
        state[_FASTEST] = description.velocity_limit[rows]

    def sample(self, sequence: int, position: Array, velocity: Array) -> bool:
        if len(position) != len(self.joints):
            return False
        if sequence > self._newest:
            self._newest, self._age = sequence, 0.0
            self._state[_SENT], self._state[_SENT_RATE] = position, velocity
        return True

    def update(self, robot: RobotState, out: JointCommand) -> None:
        clock, period = self.clock, self._period
        clock.advance()
        bridged = self._age <= self._motion.bridge
        self._share = min(max(self._share + (period if bridged else -period) / FADE, 0.0), 1.0)
        clock.silent = not bridged and self._share == 0.0
        _follow(self._state, 1.0 if bridged else self._share, self._share, clock.rate, period, self._motion.speed)
        self.write_tracking(robot, out, self._state[_POSITION], self._state[_VELOCITY])
        if not clock.held:
            self._age += period

    @property
    def waiting(self) -> str:
        return f"nothing has been streamed for {self._age:.2f} s: it is held" if self.clock.silent else ""

    @property
    def silence(self) -> float:
        return self._age if self._age > self._motion.expiry else 0.0


@compiled
def _follow(state, ahead, share, rate, period, speed):  # type: ignore[no-untyped-def]
    for i in range(state.shape[1]):
        lower, upper, fastest = state[_LOWER, i], state[_UPPER, i], state[_FASTEST, i]
        sent = min(max(state[_SENT, i] + ahead * rate * period * state[_SENT_RATE, i], lower), upper)
        gap = min(max((sent - state[_POSITION, i]) / SETTLE, -speed), speed)
        velocity = rate * min(max(share * state[_SENT_RATE, i] + gap, -fastest), fastest)
        state[_SENT, i], state[_VELOCITY, i] = sent, velocity
        state[_POSITION, i] = min(max(state[_POSITION, i] + period * velocity, lower), upper)
