"""What moves a task's reference from cycle to cycle: a trajectory, or somebody who streams it. A constant one needs nothing.

Trajectories are daemon.controllers.references' paths over a path parameter s, with its rate ṡ from the clock that may be slowed
down: ẋ_d = x' ṡ, ẍ_d = (ẋ_d − the last cycle's) / T. One clock may move several references: then whoever made it moves it on.

Each is one kernel a cycle (moving.py): small arrays cost numpy more than the work on them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from daemon.controllers.references import HermitePath, LinePath, PathClock
from daemon.wbc import layout as at
from daemon.wbc import moving
from daemon.wbc.handle import Handle
from daemon.wbc.hierarchy import WholeBody
from daemon.wbc.memory import Array
from daemon.wbc.model import WholeBodyModel
from daemon.wbc.tasks import rotation as rotation_of

_SHORTER = 0.9
"""share of a leash that is taken in where levels are damped"""


class Reference(Protocol):
    """Writes a task's reference; to be called once a cycle, before `solve`."""

    def advance(self) -> None:
        """One period on."""


class FrameTrajectory:
    """A straight line of a frame's pose, minimum-jerk in time; for CartPos, QuaternionOrientation and SE3."""

    def __init__(self, handle: Handle, path: LinePath, period: float, clock: PathClock | None = None):
        """`period`: of the loop, s; `clock`: shared with others; none: one of its own."""
        self._own = clock is None
        self.clock = PathClock(path.length, period) if clock is None else clock
        self._parameters = handle.parameters
        start = (path.rotation.ravel(), path.translation, path.shift, path.turn)
        self._state = np.concatenate((*start, np.zeros(6), (path.length, period)))

    def advance(self) -> None:
        clock = self.clock
        if self._own:
            clock.advance()
        moving.follow_line(self._state, clock.s, clock.rate, self._parameters)


class JointTrajectory:
    """Cubic polynomials through knots of all joints; for JPos."""

    def __init__(self, handle: Handle, path: HermitePath, joints: int, period: float, clock: PathClock | None = None):
        """`joints`: how many, in the order of the model's; `period`: of the loop, s; `clock`: as of a FrameTrajectory."""
        self._own = clock is None
        self.clock = PathClock(path.length, period) if clock is None else clock
        self._path, self._period, self._posture, self._rows = path, period, handle.posture, handle.joint_rows
        self._followed = np.zeros((3, joints))
        self._position, self._velocity = self._followed[:2]

    def advance(self) -> None:
        clock, path = self.clock, self._path
        if self._own:
            clock.advance()
        path.evaluate(clock.s, self._position, self._velocity)
        rate = clock.rate if clock.s < path.length else 0.0
        moving.follow_knots(self._followed, rate, self._period, self._rows, self._posture)


class Over:
    """A centre of mass over the middle of frames, wherever those are, from where it is to begin with; for COM.

    The reference comes nearer to that middle by at most `speed` m/s, and then stays with it.
    """

    def __init__(
        self, handle: Handle, model: WholeBodyModel, frames: Sequence[str], period: float, speed: float = 0.05
    ):
        """`period`: of the loop, s; `model`: placed where the robot is."""
        self._parameters, self._step = handle.parameters, speed * period
        self._data, self._frames = model.data, [model.frame_on_joint(name) for name in frames]
        self._off: Array = handle.parameters[at.REF_P : at.REF_P + 2] - self._middle()

    def _middle(self) -> Array:
        there = sum((self._data.oMi[joint].act(on.translation) for joint, on in self._frames), np.zeros(3))
        return np.asarray(there[:2] / len(self._frames))

    def advance(self) -> None:
        far = math.hypot(*self._off)
        self._off *= 1.0 - min(self._step / far, 1.0) if far > 0.0 else 0.0
        self._parameters[at.REF_P : at.REF_P + 2] = self._middle() + self._off


class StreamedPose:
    """A frame's pose as somebody sends it, when it comes; between two, it goes on at the velocity that was sent with it.

    After `stale` s without a new one what was sent stands, and `silent` says so. The reference follows what was sent without lag
    where the velocity fits the poses, works off any gap g at g / `settle`, and never moves faster than `speed` and `turn`: a pose
    that is far off is gone to, not jumped to. A `clock` that slows down slows it down, too.
    """

    def __init__(
        self,
        handle: Handle,
        period: float,
        *,
        stale: float = 0.1,
        settle: float = 0.05,
        speed: float = 0.5,
        turn: float = 1.5,
        clock: PathClock | None = None,
    ):
        """`period` s of the loop; `stale`, `settle` s; `speed` m/s; `turn` rad/s."""
        self._parameters, self._clock = handle.parameters, clock
        position, rotation = handle.reference
        settings = (period, stale, 1.0 / max(settle, period), speed, turn)
        pose = (position, rotation.ravel())
        self._state = np.concatenate((*pose, *pose, np.zeros(7), settings))

    @property
    def silent(self) -> bool:
        """Nothing has come for longer than `stale` s."""
        return bool(self._state[moving.AGE] > self._state[moving.STALE])

    def receive(
        self, position: Array | None = None, rotation: Array | None = None, velocity: Array | None = None
    ) -> bool:
        """A new pose: (3,) m, (3, 3) or quaternion x y z w, (6,) m/s and rad/s; none: as it was, velocity 0. False, and nothing
        changed, where something is not finite."""
        parts = [part for part in (position, rotation, velocity) if part is not None]
        if not all(np.isfinite(part).all() for part in parts):
            return False
        state = self._state
        if position is not None:
            state[moving.SENT_P : moving.SENT_P + 3] = position
        if rotation is not None:
            turned = np.asarray(rotation, float)
            if turned.size == 4:
                turned = rotation_of((turned[0], turned[1], turned[2], turned[3]))
            state[moving.SENT_R : moving.SENT_R + 9] = turned.ravel()
        state[moving.SENT_V : moving.SENT_V + 6] = 0.0 if velocity is None else velocity
        state[moving.AGE] = 0.0
        return True

    def advance(self) -> None:
        moving.follow_stream(self._state, 1.0 if self._clock is None else self._clock.rate, self._parameters)


class Leashes:
    """Keep the references of frames within reach of where each frame was measured in the cycle before, whoever moves them.

    A task that can't be met (something is in the way, the arm is stretched) otherwise asks for K times a distance that grows
    without end, drives go from bound to bound, and the frame shoots off when it comes free. `give` before the references
    advance, `take` after.
    """

    def __init__(self, body: WholeBody, handles: Sequence[Handle], reach: float, turn: float):
        """`handles`: of these tasks of `body`; `reach` m, `turn` rad."""
        self._parameters = body.memory["parameters"]
        self._tasks = np.array([handle.number for handle in handles], np.int64)
        self._kept = np.zeros((len(handles), moving.LEASH))
        self._reach, self._turn, self._body = reach, turn, body

    def give(self) -> None:
        """Put back the references as they were wanted."""
        moving.give(self._parameters, self._tasks, self._kept)

    def take(self) -> None:
        """Shorten them."""
        share = 1.0 - _SHORTER * self._body.damping
        moving.take(self._parameters, self._tasks, self._kept, share * self._reach, share * self._turn)

    def off(self, place: int) -> Array:
        """(3,) m, of the frame at this place of the list: what is wanted minus what was measured, on the task's axes."""
        return self._kept[place, moving.OFF : moving.OFF + 3]
