"""Plans as ghosts: which plan is shown, where in it the ghost stands, and whether it may still be executed."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from handrail.messages import PlanPreview

Array = NDArray[np.float64]

_KEPT = 20  # plans remembered: a run makes one a stroke, and prompts are only about recent ones
_REST = 0.8  # s that the ghost rests at its goal before it starts over


class Track:
    """A plan's segments as one motion over time."""

    def __init__(self, plan: PlanPreview):
        times, positions, spans, start = [], [], [], 0.0
        for segment in plan.segments:
            own = np.asarray(segment.times, float)
            if not len(own):
                continue
            times.append(own - own[0] + start)
            positions.append(np.asarray(segment.positions, float).reshape(len(own), len(plan.joints)))
            spans.append((segment.name, start, start := float(times[-1][-1])))
        self.joints = tuple(plan.joints)
        self.times = np.concatenate(times) if times else np.zeros(1)
        self.positions = np.concatenate(positions) if positions else np.zeros((1, len(plan.joints)))
        """rad (k, m)"""
        self.spans: tuple[tuple[str, float, float], ...] = tuple(spans)
        """segment, s at which it starts, s at which it ends; none before a plan's segments have come"""

    @property
    def duration(self) -> float:
        """s"""
        return float(self.times[-1])

    def at(self, time: float | Array) -> Array:
        """Positions (m,) at a time, s, or (k, m) at times (k,); beyond the ends the ends."""
        columns = [np.interp(time, self.times, column) for column in self.positions.T]
        return np.stack(columns, axis=-1) if columns else np.zeros((*np.shape(time), 0))

    def segment(self, time: float) -> str:
        """The segment that runs at a time."""
        return next((name for name, start, _ in reversed(self.spans) if time >= start), "")

    def posture(self, joints: Sequence[str], position: Array, time: float) -> Array:
        """The whole robot's position (n,) with the plan's joints where they are at `time`."""
        whole = np.array(position, float)
        rows = {joint: row for row, joint in enumerate(joints)}
        for joint, value in zip(self.joints, self.at(time), strict=True):
            if joint in rows:
                whole[rows[joint]] = value
        return whole


class Plans:
    """The plans that were heard of, and the ghost of one of them."""

    def __init__(self) -> None:
        self._plans: dict[str, PlanPreview] = {}
        self._tracks: dict[str, Track] = {}
        self._used: set[str] = set()
        self._wanted: set[str] = set()
        self._shown = ""
        self._asked = ""
        self.time = 0.0
        """s into the shown plan"""
        self.playing = True
        self._rested = 0.0

    def replace(self, plans: list[PlanPreview], *, waiting: set[str] | None = None) -> None:
        """What a snapshot says there is. `waiting`: when a program makes plans for itself, those not yet executed; None: all."""
        self._plans, self._tracks, self._used, self._wanted = {}, {}, set(), set()
        for plan in plans:
            self.take(plan)
            if not plan.fresh or (waiting is not None and plan.id not in waiting):
                self._used.add(plan.id)
        self._show()

    def take(self, plan: PlanPreview) -> None:
        """News of a plan; without segments where only its freshness is news."""
        known = self._plans.get(plan.id)
        if known is not None and not plan.segments:
            plan = msgspec.structs.replace(plan, segments=known.segments)
        if known is None or known.segments != plan.segments:
            self._tracks.pop(plan.id, None)
        if known is None:
            self._plans.pop(plan.id, None)
        self._plans[plan.id] = plan
        while len(self._plans) > _KEPT:
            gone = next(iter(self._plans))
            del self._plans[gone]
            self._tracks.pop(gone, None)
            self._used.discard(gone)
        self._show()

    def motion_began(self) -> None:
        """The robot moves: what was planned until now is being executed, or will not start where it was to start."""
        self._used.update(self._plans)
        self._show()

    def get(self, plan: str) -> PlanPreview | None:
        return self._plans.get(plan)

    def attend(self, plan: str) -> None:
        """A prompt is about this plan (empty: none is): it is shown whatever else there is."""
        self._asked = plan
        self._show()

    @property
    def shown(self) -> PlanPreview | None:
        return self._plans.get(self._shown)

    @property
    def track(self) -> Track | None:
        if self._shown not in self._plans:
            return None
        if self._shown not in self._tracks:
            self._tracks[self._shown] = Track(self._plans[self._shown])
        return self._tracks[self._shown]

    def why_not_execute(self, plan: str) -> str:
        """Code of the reason why a plan may not be approved; empty when it may.

        `stale`, or `stale_` and the first cause's code, where the robot tells one: `stale_because` has all of them in words.
        """
        known = self._plans.get(plan)
        if known is None:
            return "plan_missing"
        if known.fresh:
            return ""
        return f"stale_{known.stale_causes[0]}" if known.stale_causes else "stale"

    def want(self) -> str:
        """Id of the shown plan if its ghost has yet to be asked for, once; else empty."""
        if self.shown is None or self.shown.segments or self._shown in self._wanted:
            return ""
        self._wanted.add(self._shown)
        return self._shown

    def scrub(self, time: float) -> None:
        """Put the ghost somewhere and leave it there."""
        self.playing = False
        self.time = float(np.clip(time, 0.0, self.track.duration if self.track else 0.0))

    def play(self, on: bool) -> None:
        self.playing = on

    def advance(self, elapsed: float) -> bool:
        """Let time pass for a playing ghost, s; True when it moved."""
        track = self.track
        if track is None or not self.playing or track.duration <= 0.0:
            return False
        if self.time >= track.duration:
            self._rested += elapsed
            if self._rested < _REST:
                return False
            self._rested, self.time = 0.0, 0.0
            return True
        self.time = min(self.time + elapsed, track.duration)
        return True

    def _show(self) -> None:
        unused = [plan for plan in self._plans if plan not in self._used]
        chosen = self._asked if self._asked in self._plans else (unused[-1] if unused else "")
        if chosen != self._shown:
            self._shown, self.time, self.playing, self._rested = chosen, 0.0, True, 0.0
