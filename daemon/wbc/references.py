"""What moves a task's reference from cycle to cycle: a trajectory, or somebody who streams it. A constant one needs nothing.

Trajectories are daemon.controllers.references' paths over a path parameter s, with its rate ṡ from the clock that may be slowed
down: ẋ_d = x' ṡ, ẍ_d = (ẋ_d − the last cycle's) / T. One clock may move several references: then whoever made it moves it on.

Each is one kernel a cycle (moving.py): small arrays cost numpy more than the work on them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from daemon.controllers.references import HermitePath, LinePath, PathClock
from daemon.wbc import layout as at
from daemon.wbc import moving
from daemon.wbc.handle import Handle
from daemon.wbc.hierarchy import WholeBody
from daemon.wbc.memory import Array
from daemon.wbc.model import WholeBodyModel
from daemon.wbc.tasks import rotation as rotation_of


class FrameTrajectory:
    """A straight line of a frame's pose, minimum-jerk in time; for CartPos, QuaternionOrientation and SE3."""

    def __init__(self, handle: Handle, path: LinePath, period: float, clock: PathClock | None = None):
        """`period`: of the loop, s; `clock`: shared with others; none: one of its own."""
        self._own = clock is None
        self.clock = PathClock(path.length, period) if clock is None else clock
        self._parameters, self.task = handle.parameters, handle.number
        start = (path.rotation.ravel(), path.translation, path.shift, path.turn)
        self.state = np.concatenate((*start, np.zeros(6), (path.length, period)))
        """of the kernel (moving.LINE); Leashes lays it beside those of others"""

    def advance(self) -> None:
        clock = self.clock
        if self._own:
            clock.advance()
        moving.follow_line(self.state, clock.s, clock.rate, self._parameters)


class PointTrajectory:
    """Cubic polynomials through knots of where a frame is, which does not turn; for CartPos and SE3.

    It writes `state`, which Leashes puts into the task: that first has to see where the task's reference was.
    """

    def __init__(self, handle: Handle, path: HermitePath, period: float, clock: PathClock):
        """`path`: of three columns, m; `period`: of the loop, s; `clock`: shared with others."""
        self.clock, self.task = clock, handle.number
        self._path, self._period = path, period
        self._followed = np.zeros((3, 3))
        self.state = np.zeros(moving.POINT)
        """of the kernel (moving.POINT), as of a FrameTrajectory"""

    def advance(self) -> None:
        clock, path = self.clock, self._path
        rate = clock.rate if clock.s < path.length else 0.0
        path.at = moving.follow_points(path.knots, path.at, clock.s, rate, self._followed, self._period, self.state)


class JointTrajectory:
    """Cubic polynomials through knots of all joints; for JPos."""

    def __init__(self, handle: Handle, path: HermitePath, joints: int, period: float, clock: PathClock | None = None):
        """`joints`: how many, in the order of the model's; `period`: of the loop, s; `clock`: as of a FrameTrajectory."""
        self._own = clock is None
        self.clock = PathClock(path.length, period) if clock is None else clock
        self._path, self._period, self._posture, self._rows = path, period, handle.posture, handle.joint_rows
        self._followed = np.zeros((3, joints))

    def advance(self) -> None:
        clock, path = self.clock, self._path
        if self._own:
            clock.advance()
        rate = clock.rate if clock.s < path.length else 0.0
        followed = (self._followed, self._period, self._rows, self._posture)
        path.at = moving.follow_knots(path.knots, path.at, clock.s, rate, *followed)


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
        self._parameters, self.task, self._clock = handle.parameters, handle.number, clock
        position, rotation = handle.reference
        settings = (period, stale, 1.0 / max(settle, period), speed, turn)
        pose = (position, rotation.ravel())
        self.state = np.concatenate((*pose, *pose, np.zeros(7), settings))
        """of the kernel (moving.STREAM), as above"""

    @property
    def silent(self) -> bool:
        """Nothing has come for longer than `stale` s."""
        return bool(self.state[moving.AGE] > self.state[moving.STALE])

    def receive(
        self, position: Array | None = None, rotation: Array | None = None, velocity: Array | None = None
    ) -> bool:
        """A new pose: (3,) m, (3, 3) or quaternion x y z w, (6,) m/s and rad/s; none: as it was, velocity 0. False, and nothing
        changed, where something is not finite."""
        parts = [part for part in (position, rotation, velocity) if part is not None]
        if not all(np.isfinite(part).all() for part in parts):
            return False
        state = self.state
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
        moving.follow_stream(self.state, 1.0 if self._clock is None else self._clock.rate, self._parameters)


Reference = FrameTrajectory | PointTrajectory | JointTrajectory | Over | StreamedPose
"""`advance` writes its task's reference: once a cycle, before `solve`"""


class Leashes:
    """Move the references of a compound task on by one clock, and keep those of frames within reach of where each frame was
    measured in the cycle before, whoever moves them.

    A task that can't be met (something is in the way, the arm is stretched) otherwise asks for K times a distance that grows
    without end, drives go from bound to bound, and the frame shoots off when it comes free.
    """

    def __init__(
        self,
        body: WholeBody,
        handles: Sequence[Handle],
        references: Sequence[Reference],
        clock: PathClock,
        reach: float,
        turn: float,
    ):
        """`handles`: of the tasks of `body` that are on leashes; `references`: what the `clock` moves; `reach` m, `turn` rad."""
        lines = [reference for reference in references if isinstance(reference, FrameTrajectory)]
        streams = [reference for reference in references if isinstance(reference, StreamedPose)]
        points = [reference for reference in references if isinstance(reference, PointTrajectory)]
        self._others = [one for one in references if isinstance(one, JointTrajectory | Over | PointTrajectory)]
        self._kept = np.zeros((len(handles), moving.LEASH))
        moved: list[FrameTrajectory | StreamedPose | PointTrajectory] = [*lines, *streams, *points]
        tasks = [handle.number for handle in handles] + [one.task for one in moved]
        settings = body.memory["settings"][0]
        states = (
            _side_by_side(lines, moving.LINE), _side_by_side(streams, moving.STREAM), _side_by_side(points, moving.POINT)
        )  # fmt: skip
        self._moved = (body.memory["parameters"], self._kept, *states, np.array(tasks, np.int64))
        self._limits, self._clock = (settings, reach, turn), clock

    def advance(self) -> None:
        """One period on: the clock, and all references."""
        clock = self._clock
        clock.advance()
        for reference in self._others:
            reference.advance()
        moving.follow(*self._moved, clock.s, clock.rate, *self._limits)

    def off(self, place: int) -> Array:
        """(3,) m, of the frame at this place of the list: what is wanted minus what was measured, on the task's axes."""
        return self._kept[place, moving.OFF : moving.OFF + 3]


def _side_by_side(moved: Sequence[FrameTrajectory | StreamedPose | PointTrajectory], width: int) -> Array:
    """Their states in one table, in which they have them from now on."""
    table = np.array([one.state for one in moved]).reshape(len(moved), width)
    for one, row in zip(moved, table, strict=True):
        one.state = row
    return table
