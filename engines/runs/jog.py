"""Joints sent somewhere because an operator asked for it: point to point, and on the way elsewhere when he asks anew."""

from __future__ import annotations

import logging
import threading
from collections.abc import Sequence
from concurrent.futures import Future
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.activities.base import Services
from engines.runs.job import Lender, MotionJob
from engines.runs.motion import MotionFailed
from handrail.messages import Jog, Jogged, JointTarget
from handrail.topics import RefusedError, refuse

_ROOM = 1e-6
"""rad by which a target may be beyond a limit, as by rounding"""
_THERE = 1e-3
"""rad"""


class JogExecution(MotionJob):
    """A jog that runs. Nobody has planned it: the daemon's guard is what knows of bodies in the way."""

    def __init__(self, services: Services, call: Jog, answer: Future[Any], lender: Lender | None = None):
        """`answer` is given once the joints are there, or refused with the reason; `lender`: the paused run that it is beside.

        Raises RefusedError for what can't be meant.
        """
        super().__init__(services, "jog", tuple(call.joints), lender)
        self._call, self._speed, self._answer = call, call.speed, answer
        self.joints = tuple(call.joints)
        here = services.daemon.command()
        if here is None:
            raise refuse("the daemon has not told where the robot is: is it running?")
        if unknown := [joint for joint in self.joints if joint not in services.description.joints]:
            raise refuse("no such joint", "joints", unknown[0], f"one of {', '.join(services.description.joints)}")
        self._target = self._wanted(call, here[services.description.index(self.joints)])
        self._lock, self._over = threading.Lock(), False
        self._thread.start()

    def _from_where_it_stands(self) -> None:
        """By so much counts from where the joints are once they were let go: what held them may have been slowing down."""
        here = self._services.daemon.command()
        with self._lock:
            if self._call.by and here is not None:
                self._target = self._wanted(self._call, here[self._services.description.index(self.joints)])

    def _wanted(self, call: Jog, here: Sequence[float] | NDArray[np.float64]) -> list[float]:
        description = self._services.description
        rows = description.index(self.joints)
        found = []
        for joint, start, row in zip(self.joints, here, rows.tolist(), strict=True):
            target = call.joints[joint] + (float(start) if call.by else 0.0)
            low, high = float(description.lower[row]), float(description.upper[row])
            if not low - _ROOM <= target <= high + _ROOM:
                raise refuse(
                    "beyond the joint's limits", f"joints.{joint}", f"{target:.4g}", f"{low:.4g} to {high:.4g}"
                )
            found.append(min(max(target, low), high))
        return found

    @property
    def active(self) -> bool:
        return not self._over

    def turned_to(self, call: Jog, answer: Future[Any]) -> bool:
        """Go there instead, from where the joints are now and as fast as they are; the older call is refused as superseded.

        `by` counts from where they were going. False: it can't be, since other joints or another speed are meant, or it has ended.
        Raises RefusedError for what can't be meant.
        """
        if tuple(call.joints) != self.joints or call.speed != self._speed:
            return False
        target = self._wanted(call, self._target)
        with self._lock:
            if self._over or not self._motion.redirect(target):
                return False
            older, self._answer, self._target = self._answer, answer, target
        older.set_exception(refuse("superseded by a newer jog of the same joints"))
        return True

    def _drive(self) -> None:
        problem: RefusedError | None = None
        try:
            if self._lender is not None:
                self._borrow()
                self._from_where_it_stands()
            self._go()
        except RefusedError as refused:
            problem = refused
        except MotionFailed as failed:
            problem = refuse(str(failed))
        except Exception as crash:
            logging.exception("a jog crashed")
            problem = refuse(f"the engine's own error: {type(crash).__name__}: {crash}")
        self._give_back()
        with self._lock:
            self._over = True
        if problem is None:
            self._answer.set_result(Jogged(joints=dict(zip(self.joints, self._target, strict=True))))
        else:
            self._answer.set_exception(problem)

    def _go(self) -> None:
        """Until it stands where it was last told to: a target that came as the motion ended has not been heard."""
        rows = self._services.description.index(self.joints)
        target: list[float] = []
        while target != self._target:
            target = self._target
            motion = JointTarget(joints=list(self.joints), positions=target, speed=self._speed)
            ended = self._motion.run(motion, [], self._cancelled, what="jog")
            with self._lock:  # `turned_to` sets it once the daemon has taken it
                if np.abs(np.array(ended.command)[rows] - self._target).max() < _THERE:
                    return
