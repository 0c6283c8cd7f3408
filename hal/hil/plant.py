"""A test's view of what is really the case, and its hands in the plant."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterable, Iterator

import numpy as np

from hal.drives.lifecycle import State
from hal.hil.door import Await, Done, Door, Fail, Look, Place, Push, Recall, Seen, Transition, Was
from hal.hil.names import joints_of
from handrail.messages import GroundTruth
from handrail.robot.description import RobotDescription
from handrail.runtime import Runtime

_STATES = [state.name.lower() for state in State]
POSITION_SLACK = 0.02
"""rad beyond a position limit that is still called within it: the bus's and the spring's give"""
SPEEDING_NS = 5_000_000
"""a joint may be faster than its limit for so long: a blow is not a motion"""


class Window:
    """What happened while a block ran: `seen` is filled when it ends."""

    seen: Seen


class Plant:
    """The ground truth, by the plant's door."""

    def __init__(self, runtime: Runtime, description: RobotDescription):
        self._description = description
        self._door = Door(runtime)

    def look(self, *, anew: bool = False) -> Seen:
        """Everything since the window began (the start, or the last `anew`), and the present."""
        answer = self._door.ask(Look(anew=anew))
        assert isinstance(answer, Seen)
        return answer

    def truth(self) -> GroundTruth:
        """Joints, hinges, contact forces, now."""
        return self.look().truth

    @property
    def time_ns(self) -> int:
        """The plant's clock."""
        return self.truth().time_ns

    def wait(self, seconds: float, timeout_s: float = 60.0) -> GroundTruth:
        """Let so much of the plant's time go by. Raises AssertionError when it does not."""
        until = self.time_ns + round(seconds * 1e9)
        deadline = time.monotonic() + timeout_s
        while (truth := self._await(Await(until_ns=until)).truth).time_ns < until:
            assert time.monotonic() < deadline, f"the plant's time stands at {truth.time_ns * 1e-9:.3f} s"
        return truth

    def _await(self, request: Await) -> Seen:
        answer = self._door.ask(request)
        assert isinstance(answer, Seen)
        return answer

    def joints_at(self, time_ns: int, timeout_s: float = 60.0) -> dict[str, float]:
        """Where the joints are (rad) at a moment of the plant's clock, waited for; or were, within the last minute; to 10 ms.

        A robot in lock-step does not wait for a test: what is looked at soon after may be long after. Raises AssertionError
        when time does not come so far, hal.hil.door.DoorShut for a moment that is forgotten.
        """
        self.wait((time_ns - self.time_ns) * 1e-9, timeout_s)
        was = self._door.ask(Recall(time_ns=time_ns))
        assert isinstance(was, Was)
        return was.joints

    def wait_state(self, joints: str | Iterable[str], state: str, timeout_s: float = 20.0) -> int:
        """Wait until drives are all in a CiA 402 state; ns of the plant's clock. Raises AssertionError naming the others."""
        if state not in _STATES:
            raise ValueError(f"state: {state!r}; expected one of {', '.join(_STATES)}")
        deadline = time.monotonic() + timeout_s
        wanted = joints_of(self._description, joints)
        while True:
            seen = self._await(Await(joints=wanted, state=state))
            states = dict(zip(seen.joints, seen.states, strict=True))
            if all(states[joint] == state for joint in wanted):
                return seen.truth.time_ns
            others = {joint: states[joint] for joint in wanted if states[joint] != state}
            assert time.monotonic() < deadline, f"not {state} after {timeout_s:g} s: {others}"

    @contextlib.contextmanager
    def window(self) -> Iterator[Window]:
        """Judge a stretch by itself: `with plant.window() as w: ...`, then `w.seen`."""
        self.look(anew=True)
        window = Window()
        try:
            yield window
        finally:
            window.seen = self.look()

    def drive_error(self, joints: str | Iterable[str], error: str, *, after: float = 0.0) -> None:
        """Let drives fault, `after` s of the plant's time from now; error by name: encoder, overcurrent, overtemperature, ..."""
        self._done(Fail(joints=joints_of(self._description, joints), error=error, after=after))

    def push(self, link: str, force: tuple[float, float, float], duration: float) -> int:
        """Push a link with N (world frame) for s of the plant's time, from now on: ns of the plant's clock."""
        return self._done(Push(link=link, force=force, duration=duration))

    def place(self, **positions: float) -> None:
        """Put joints at positions (rad), at rest, brakes closed and drives off."""
        self._done(Place(positions=positions))

    def _done(self, request: Fail | Push | Place) -> int:
        done = self._door.ask(request)
        assert isinstance(done, Done)
        return done.time_ns

    # -------------------------------------------------------------------------------------------------------- assertions

    def transitions(self, joints: str | Iterable[str]) -> list[Transition]:
        """When drives changed their state, of the present window."""
        wanted = set(joints_of(self._description, joints))
        return [one for one in self.look().transitions if one.joint in wanted]

    def assert_quick_stops(self, joints: str | Iterable[str], *, since_ns: int, within_cycles: int) -> None:
        """Every drive came to quick stop (or to a fault) after `since_ns`, and within so many host cycles of it.

        The plant goes in whole steps and the drives' clock is a step behind the bus's: one cycle is given on top.
        """
        period = self._description.period_ns
        allowed = since_ns + (within_cycles + 1) * period
        first: dict[str, Transition] = {}
        for one in self.transitions(joints):
            if one.time_ns >= since_ns and one.state in ("quick_stop_active", "fault"):
                first.setdefault(one.joint, one)
        for joint in joints_of(self._description, joints):
            assert joint in first, f"{joint} did not quick-stop after {since_ns * 1e-9:.4f} s"
            cycles = (first[joint].time_ns - since_ns) / period
            assert first[joint].time_ns <= allowed, (
                f"{joint} quick-stopped {cycles:.1f} cycles after {since_ns * 1e-9:.4f} s; allowed {within_cycles}"
            )

    def assert_still(self, *, tolerance: float = 2e-3, seconds: float = 0.5) -> None:
        """No joint moves by more than `tolerance` rad in the next `seconds` of the plant's time."""
        with self.window() as window:
            self.wait(seconds)
        span = np.array(window.seen.highest) - np.array(window.seen.lowest)
        worst = int(span.argmax())
        assert span[worst] <= tolerance, (
            f"{window.seen.joints[worst]} moved by {span[worst]:.4f} rad in {seconds:g} s; allowed {tolerance:g}"
        )

    def assert_within_limits(self, seen: Seen | None = None, *, contact_force: float | None = None) -> None:
        """No joint left its position limits, or was faster than its velocity limit for more than a moment; no object was
        touched harder than `contact_force` N."""
        seen = self.look() if seen is None else seen
        problems = beyond_limits(self._description, seen, contact_force)
        assert not problems, "; ".join(problems)

    def close(self) -> None:
        self._door.close()


def beyond_limits(description: RobotDescription, seen: Seen, contact_force: float | None = None) -> list[str]:
    """What was beyond the robot's limits in a window, in words; empty: nothing."""
    problems = []
    for row, joint in enumerate(seen.joints):
        low, high = description.lower[row], description.upper[row]
        if seen.lowest[row] < low - POSITION_SLACK or seen.highest[row] > high + POSITION_SLACK:
            problems.append(
                f"{joint} went from {seen.lowest[row]:.3f} to {seen.highest[row]:.3f} rad; limits {low:.3f} to {high:.3f}"
            )
        if seen.speeding_ns[row] > SPEEDING_NS:
            problems.append(
                f"{joint} reached {seen.fastest[row]:.2f} rad/s, and was over its limit of "
                f"{description.velocity_limit[row]:.2f} for {seen.speeding_ns[row] * 1e-6:.0f} ms"
            )
    if contact_force is not None:
        problems += [
            f"{name} was touched with {force:.0f} N; allowed {contact_force:g}"
            for name, force in seen.peak_contact_force.items()
            if force > contact_force
        ]
    return problems
