"""One run: a fresh plant, loop and server, the stroke carried out as an engine would, the fault in the middle of it."""

from __future__ import annotations

import contextlib
import re
import time

import msgspec

from benchmarks.campaign.cases import Case
from benchmarks.campaign.turn import OBJECT, ROBOT, SCENE, Turn
from benchmarks.campaign.verdict import Verdict, judge
from hal.can.control import HubControl
from hal.hil.daemon import OWNER, Daemon
from hal.hil.door import DoorShut
from hal.hil.nursery import Nursery, ProcessDied
from hal.hil.rig import Options, Rig
from handrail import messages as m
from handrail.topics import RefusedError, Unreachable

HOLD_S = 5.0
"""wall time at most that simulated time waits for this process between two actions"""
RESTART_S = 0.25
"""wall time after which a server that was killed is started anew, as the supervisor does; a loop only when the drives, which
know time from the plant alone, have noticed that it is gone"""
SETTLE_S, REST_S = 0.6, 0.3
"""s of the plant's time: for a quick stop to end and the brakes to close; and in which nothing may move"""
_END_S, _PATIENCE_S = 15.0, 300.0
"""the plant's time that a motion may take, and this machine's"""
_LOOK_S, _GLANCE_S = 0.002, 0.05
"""wall time between two looks at the plant, each of which holds it up: while a process waits to be struck, and otherwise"""


class Row(msgspec.Struct, kw_only=True):
    """One run in the campaign's file."""

    case: Case
    verdict: Verdict
    hits: int = 0
    """frames that the fault hit"""
    wall_s: float = 0.0
    stalls: int = 0
    """how often the plant ran free, since the host did not get to speak: in a run without a dead host, this machine's fault"""
    broken: str = ""
    """the run could not be carried out: why"""


class Line(msgspec.Struct):
    """A line of the campaign's file."""

    seed: int
    row: Row


def carry_out(case: Case, turn: Turn, nursery: Nursery) -> Row:
    """Run one case. Never raises for what the robot does: that is what the verdict is for."""
    began = time.monotonic()
    rig = Rig(Options(robot=ROBOT, scene=SCENE), nursery, listens=False)
    try:
        row = _Run(case, turn, rig).row()
    except (AssertionError, DoorShut, ProcessDied, ConnectionError, RefusedError, ValueError) as problem:
        nothing = Verdict(outcome="unsafe", end="", problems=[], turned_deg=0.0, peak_force_n=0.0, speed_share=0.0)
        row = Row(case=case, verdict=nothing, broken=f"{type(problem).__name__}: {problem}"[:2000])
    finally:
        rig.close()
    said = re.search(r"(\d+) free runs", "\n".join(rig.plant_process.lines)) if rig.started else None
    row.stalls = int(said[1]) if said else 0
    row.wall_s = round(time.monotonic() - began, 2)
    return row


class _Run:
    def __init__(self, case: Case, turn: Turn, rig: Rig):
        self.case, self.turn, self.rig = case, turn, rig
        self.plant = rig.plant
        self.plant.place(**turn.start)
        self.control = HubControl(rig.runtime.bus)
        self.daemon: Daemon = rig.daemon
        self.began_ns = 0
        self.struck = False

    def row(self) -> Row:
        self.daemon.enable()
        self.plant.wait(0.1, _PATIENCE_S)
        hinge = self.plant.look(anew=True).truth.hinges[OBJECT]
        end = self._move()
        self._strike_now()  # a motion that ended before its moment still gets it
        self._supervise()
        self.plant.wait(SETTLE_S, _PATIENCE_S)
        motion = self.plant.look()
        hits = sum(self.control.report().hits.values())
        self.control.clear()
        self.plant.wait(0.1, _PATIENCE_S)
        self.plant.look(anew=True)
        self.plant.wait(REST_S, _PATIENCE_S)
        rest = self.plant.look()
        status = self.daemon.call(m.GetStatus())
        verdict = judge(
            self.rig.description,
            motion,
            rest,
            end=end,
            turned=rest.truth.hinges[OBJECT] - hinge,
            needed=self.turn.angle,
            enabled=status.enabled,
            isolated=status.isolated,
        )
        self.control.close()
        return Row(case=self.case, verdict=verdict, hits=hits)

    # ---------------------------------------------------------------------------------------------------------- the motion

    def _move(self) -> str:
        """Segment by segment; how it ended, in a word."""
        for index, segment in enumerate(self.turn.segments):
            motion = segment.motion(self.turn.joints)
            start = m.StartAction(
                id=f"{OWNER}-{segment.name}",
                owner=OWNER,
                motion=motion,
                ends=list(segment.ends),
                hold_after_s=HOLD_S if index + 1 < len(self.turn.segments) else 0.0,
            )
            if index == 0:
                # Simulated time stands while the fault is laid: it begins at its moment of the motion, not of this machine's.
                self.daemon.call(m.HoldTime(owner=OWNER, limit_s=HOLD_S))
                self._lay()
            try:
                self.daemon.call(start)
            except (RefusedError, Unreachable):
                return "refused" if index else "not_started"
            self.daemon.call(m.ReleaseTime(owner=OWNER))
            outcome = self._wait_end(start.id)
            if not self.daemon.checks_in and index + 1 < len(self.turn.segments):
                # Nobody goes on, nor lets time go on: the hold runs out by itself.
                return outcome if outcome != "done" else self.case.kind
            if outcome != "done":
                with contextlib.suppress(RefusedError, Unreachable):
                    self.daemon.call(m.ReleaseTime(owner=OWNER))
                return outcome
        return "done"

    def _wait_end(self, action: str) -> str:
        """The outcome; strikes on the way, and starts anew what was killed."""
        deadline = time.monotonic() + _PATIENCE_S
        while self.plant.time_ns < self.began_ns + _END_S * 1e9:
            assert time.monotonic() < deadline, f"this machine is too slow: {_PATIENCE_S:g} s"
            if (event := self.daemon.ended(action, _GLANCE_S if self.struck else _LOOK_S)) is not None:
                return event.outcome
            if not self.struck and self.plant.time_ns >= self.began_ns + round(self.case.at * 1e9):
                self._strike_now()
            if self._supervise():
                return "loop_died"
        return "never_ended"

    # ----------------------------------------------------------------------------------------------------------- the fault

    def _lay(self) -> None:
        """Faults of bus and drives begin by the plant's clock."""
        self.began_ns = self.plant.time_ns
        if self.case.fault is not None:
            self.control.add(self.case.fault)
            self.struck = True
        elif self.case.joint:
            self.plant.drive_error(self.case.joint, self.case.error, after=self.case.at)
            self.struck = True

    def _strike_now(self) -> None:
        """What is done to processes."""
        if self.struck:
            return
        self.struck = True
        match self.case.kind:
            case "loop_killed":
                self.daemon.loop.kill()
            case "server_killed":
                self.daemon.server.kill()
            case "engine_silent":
                self.daemon.checks_in = False
            case "loop_frozen":
                with self.daemon.frozen():
                    time.sleep(self.case.frozen_s)

    def _supervise(self) -> bool:
        """Start anew what has died, after a while. True when it was the loop."""
        if not self.daemon.server.alive:
            time.sleep(RESTART_S)
            self.daemon.start_server()
        if self.daemon.loop.alive:
            return False
        self.plant.wait_state("*", "quick_stop_active", _PATIENCE_S)
        self.daemon.start_loop()
        with contextlib.suppress(RefusedError, Unreachable):
            self.daemon.call(m.ReleaseTime(owner=OWNER))
        return True
