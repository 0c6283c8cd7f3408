"""Makes the controllers of motions that take long to make, beside the loop: whole-body control needs a model and compiled code.

A thread does it when somebody asks (as daemon.controllers.workshop's, which says what that means for the loop); until then
nothing of it is even imported. The loop looks in from cycle to cycle whether a controller is there. In lock-step a start waits
for it, so that a replay starts in the same cycle.
"""

from __future__ import annotations

import _thread
import sys
import traceback

import numpy as np
from numpy.typing import NDArray

from daemon.controllers.base import Gains, MotionController
from daemon.exchange import Answer
from handrail.robot.kinematics import Kinematics

_AT_ONCE = 24
"""more than the steps of a behaviour"""
_PATIENCE_S = 300.0
"""s of wall time that a start waits in lock-step: where nothing was compiled yet, it takes minutes"""


class MotionMaker:
    """Controllers by the serial of the command that asked for them; each is used once."""

    def __init__(self, kinematics: Kinematics, gains: Gains, period: float, lockstep: bool):
        self._kinematics, self._gains, self._period, self._lockstep = kinematics, gains, period, lockstep
        self._orders: dict[int, _Order] = {}
        self._at_work = _thread.allocate_lock()

    def begin(self, serial: int, text: bytes, position: NDArray[np.float64]) -> Answer:
        """Begin to make what a checked and encoded motion asks for; `position` (n,) rad: about where the robot is."""
        while len(self._orders) >= _AT_ONCE:  # nobody came for the oldest
            del self._orders[next(iter(self._orders))]
        self._orders[serial] = order = _Order()
        # threading.Thread.start would wait until the thread runs, in the middle of a cycle.
        _thread.start_new_thread(self._fill, (order, text, position.copy()))
        return Answer.NOT_READY

    def look(self, serial: int) -> Answer:
        """ACCEPTED: it is there; NOT_READY: not yet; MALFORMED: it can't be made, or nobody asked for it."""
        order = self._orders.get(serial)
        if order is None:
            return Answer.MALFORMED
        if order.pending.locked():
            return Answer.NOT_READY
        return Answer.ACCEPTED if order.made is not None else Answer.MALFORMED

    def take(self, serial: int) -> MotionController | None:
        """The controller, if it is there."""
        order = self._orders.pop(serial, None)
        if order is not None and self._lockstep and order.pending.acquire(timeout=_PATIENCE_S):
            order.pending.release()
        return order.made if order is not None else None

    def _fill(self, order: _Order, text: bytes, position: NDArray[np.float64]) -> None:
        try:
            # One at a time: msgspec crashes where two threads make the decoder of one type, and numba compiles everything twice.
            with self._at_work:
                from daemon.controllers.whole_body import made_from  # a second, and 20 MB: not before somebody needs it

                order.made = made_from(text, self._kinematics, self._gains, self._period, position)
        except Exception:  # noqa: BLE001 - whatever it is: it is told, and the motion does not start
            traceback.print_exc(file=sys.stderr)
        finally:
            order.pending.release()


class _Order:
    def __init__(self) -> None:
        self.made: MotionController | None = None
        self.pending = _thread.allocate_lock()
        """held until it is clear what became of it"""
        self.pending.acquire()
