"""A recording that is seen again: fetched some seconds at a time, as little as the link allows, and never the file.

While it is shown nothing is commanded from this window; what the robot really does goes on coming in, and is shown again after it.
"""

from __future__ import annotations

from bisect import bisect_right
from typing import Any

import numpy as np

from handrail.messages import GetSamples, InstanceState, MarkedAt, Message, RecordingInfo, RobotState, Samples

WINDOW_S = 10.0
"""that one call asks for"""
_RATE, _SLOW_RATE = 10.0, 3.0
"""samples/s, on a good link and on another"""
_MOST_WINDOWS = 60
"""that are kept: ten minutes"""
_AGAIN_S = 2.0
"""before what was not answered is asked again"""
_UNIT = 1e-4  # rad


class Replay:
    """What is replayed, if anything, and where in it one looks."""

    def __init__(self) -> None:
        self.recording = ""
        """empty: nothing is replayed"""
        self.duration_s = 0.0
        self.marks: list[MarkedAt] = []
        self.time_s = 0.0
        self.playing = False
        self.problem = ""
        """why what is to be shown can't be fetched"""
        self._windows: dict[int, Samples] = {}
        self._asked: dict[int, float] = {}

    @property
    def active(self) -> bool:
        return bool(self.recording)

    @property
    def waiting(self) -> bool:
        """What stands at this time is not here yet."""
        return self.active and self._window is None

    def begin(self, info: RecordingInfo) -> None:
        """Show a recording from its beginning, and play it."""
        self.end()
        self.recording, self.duration_s, self.marks = info.name, info.duration_s, info.marks
        self.playing = True

    def end(self) -> None:
        """Back to what is."""
        self.recording, self.duration_s, self.marks = "", 0.0, []
        self.time_s, self.playing, self.problem = 0.0, False, ""
        self._windows.clear()
        self._asked.clear()

    def scrub(self, seconds: float) -> None:
        """Look at a moment, s since the beginning."""
        self.time_s, self.playing = min(max(seconds, 0.0), self.duration_s), False

    def play(self, on: bool) -> None:
        """Go on, from the beginning where it is at its end; or stand still."""
        if on and self.time_s >= self.duration_s:
            self.time_s = 0.0
        self.playing = on and self.active

    def advance(self, seconds: float) -> None:
        """Time has passed. It waits for what is not here."""
        if self.playing and not self.waiting:
            self.time_s = min(self.time_s + seconds, self.duration_s)
            self.playing = self.time_s < self.duration_s

    def want(self, now: float, *, slow: bool = False) -> list[Message]:
        """The call that is due at `now`, s: what is looked at, then what comes after it. One at a time."""
        if not self.active or any(now < again for again in self._asked.values()):
            return []
        at = int(self.time_s // WINDOW_S)
        for window in (at, at + 1):
            if window not in self._windows and window * WINDOW_S <= self.duration_s:
                self._asked = {window: now + _AGAIN_S * (10 if not self.problem else 1)}
                return [
                    GetSamples(
                        recording=self.recording,
                        begin_s=window * WINDOW_S,
                        duration_s=WINDOW_S,
                        rate_hz=_SLOW_RATE if slow else _RATE,
                    )
                ]
        return []

    def take(self, call: Message, answer: Any) -> None:
        if isinstance(call, GetSamples) and isinstance(answer, Samples) and call.recording == self.recording:
            self._asked.clear()
            self.problem = ""
            self._windows[int(call.begin_s // WINDOW_S)] = answer
            if len(self._windows) > _MOST_WINDOWS:
                farthest = max(self._windows, key=lambda window: abs(window - self.time_s / WINDOW_S))
                del self._windows[farthest]

    def failed(self, call: Message, why: str, now: float) -> None:
        if isinstance(call, GetSamples) and call.recording == self.recording:
            self.problem = why
            self._asked = {window: now + _AGAIN_S for window in self._asked}

    def anew(self) -> None:
        """The link is gone: what was asked is not answered any more. What is here can be looked at."""
        self._asked.clear()

    # ---------------------------------------------------------------------------------------------------------- shown

    @property
    def _window(self) -> Samples | None:
        return self._windows.get(int(self.time_s // WINDOW_S))

    def state(self, joints: list[str]) -> RobotState | None:
        """The robot at this time, in the order of `joints`; None where it is not here, or the recording has nothing of it."""
        window = self._window
        if window is None or not window.times_s:
            return None
        rows = [window.joints.index(joint) if joint in window.joints else -1 for joint in joints]
        times, table = np.array(window.times_s), np.array(window.positions, dtype=float) * _UNIT
        position = [float(np.interp(self.time_s, times, table[:, row])) if row >= 0 else 0.0 for row in rows]
        base = None
        if window.bases:
            base = window.bases[max(0, bisect_right([each.at_s for each in window.bases], self.time_s) - 1)].base
        nothing = [0.0] * len(joints)
        return RobotState(
            time_ns=round(self.time_s * 1e9), cycle=0, position=position, velocity=nothing, torque=nothing,
            command=position, base=base,
        )  # fmt: skip

    def instances(self) -> dict[str, InstanceState]:
        """What was placed at this time, by name."""
        window = self._window
        placed: dict[str, InstanceState] = {}
        for told in window.instances if window is not None else ():
            if told.at_s > self.time_s and told.at_s > (window.begin_s if window else 0.0):
                break
            if told.instance.removed:
                placed.pop(told.instance.name, None)
            else:
                placed[told.instance.name] = told.instance
        return placed
