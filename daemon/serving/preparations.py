"""Whole-body controllers that the loop makes beside its cycles, before the motion that needs them begins."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import msgspec
import numpy as np

from daemon import exchange
from daemon.exchange import Answer, Kind
from daemon.serving.loop_door import LoopDoor
from daemon.serving.validation import within
from daemon.serving.whole_body_door import WholeBodyDoor
from handrail import messages as m
from handrail.robot.description import RobotDescription
from handrail.topics import refuse

PATIENCE_S = 1.5
"""for how long whoever calls waits for a controller that takes long to make; asked again, he may have it then"""
_LOOK_S = 0.01
_MAKING_AT_ONCE = 16


class Preparations:
    """What the loop was asked to make, and has not been fetched yet."""

    def __init__(self, description: RobotDescription, door: LoopDoor, look: Callable[[], object]):
        """`look`: deals with what the loop has published meanwhile."""
        self._door, self._look = door, look
        self._whole_body = WholeBodyDoor(description)
        self._making: dict[tuple[bytes, int], int] = {}
        """(motion, encoded, life of the loop) → the serial under which it was asked for"""

    def made(self, asked: Sequence[m.StartAction | m.Step], snapshot: np.ndarray, life: int) -> dict[int, int]:
        """Have the loop make the controllers of all whole-body motions among these: row → the serial under which its lies ready.

        `life`: of the loop, by the ring's generation. RefusedError: what is wrong with one, or that they are not ready yet.
        """
        gives_up = time.monotonic() + PATIENCE_S
        checked = {}
        for row, one in enumerate(asked):
            if not isinstance(one.motion, m.WholeBody):
                continue
            while not self._whole_body.open(_LOOK_S):
                self._look()
                if time.monotonic() > gives_up:
                    raise refuse(*exchange.explain(Answer.NOT_READY, "", 0.0))
            with within(f"steps[{row}]" if isinstance(one, m.Step) else ""):
                position = snapshot["position"]
                checked[row] = self._whole_body.checked(one.motion, one.ends, position, self._door.floats)
        keys = {row: (msgspec.msgpack.encode(motion), life) for row, motion in checked.items()}
        for row, key in keys.items():  # all of them, before any is waited for
            if key in self._making:  # moved to the newest: what else is begun must not push it out
                self._making[key] = self._making.pop(key)
            else:
                self._begin(key, checked[row])
        for key in keys.values():
            self._await(key, gives_up)
        made = {row: self._making[key] for row, key in keys.items()}
        for key in set(keys.values()):
            del self._making[key]
        return made

    def _begin(self, key: tuple[bytes, int], motion: m.WholeBody) -> None:
        waiting = [(known, serial) for known, serial in self._making.items() if known[1] == key[1]]
        self._making = dict(waiting[-_MAKING_AT_ONCE:])  # the loop forgets what nobody came for, too
        self._making[key] = serial = self._door.count()
        answer = self._door.post(*exchange.encode_prepare(motion, serial))
        if answer is None or answer[0] != Answer.NOT_READY:
            del self._making[key]
            self._door.require(answer)

    def _await(self, key: tuple[bytes, int], gives_up: float) -> None:
        """RefusedError: it has not been made before then (asked for again, it may be), or can't be."""
        if key not in self._making:  # so many others were begun after it
            raise refuse(*exchange.explain(Answer.NOT_READY, "", 0.0))
        serial = self._making[key]
        answer = self._door.post_while(
            Answer.NOT_READY,
            lambda: (exchange.encode_command(Kind.PREPARE, self._door.count(), action=serial), None),
            gives_up,
        )
        if answer is None or answer[0] not in (Answer.NOT_READY, Answer.ACCEPTED):
            del self._making[key]
        self._door.require(answer)
