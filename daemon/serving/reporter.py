"""Snapshots in, messages out: what the loop did, as robot states, action events and the daemon's status."""

from __future__ import annotations

import functools
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Literal

import numpy as np

from daemon.exchange import (
    MAX_HOLDS,
    ActionState,
    Flag,
    action_event,
    active_controllers,
    isolated_limbs,
    robot_state,
    snapshot_dtype,
)
from daemon.serving.device_reports import device_problems, device_states, device_statuses
from daemon.serving.drive_reports import drive_marks, drive_problems, drive_statuses
from daemon.serving.journal import Journal, Started
from handrail.messages import (
    ActionEvent,
    BusStatistics,
    DaemonStatus,
    DeviceStates,
    LoopStatistics,
    RobotState,
)
from handrail.robot.description import RobotDescription

STATE_PERIOD_NS = 10_000_000
"""of RobotState, in the robot's time"""
DEVICE_PERIOD_NS = 40_000_000
"""of DeviceStates, likewise"""
_MARK = ("serial", "state", "steps_taken", "speed")
"""of an action's slot: there is news when one of these changes"""
_LOAD_WINDOW_NS = 1_000_000_000
_TICKS_A_DEVICE_STATE = DEVICE_PERIOD_NS // STATE_PERIOD_NS
_TIMING_WINDOW = 2500
"""cycles over which the percentiles are taken"""


class Reporter:
    """Follows the loop through its snapshots."""

    def __init__(
        self,
        description: RobotDescription,
        clock: Literal["wall", "lockstep"],
        journal: Journal,
        columns: Mapping[str, Sequence[str]] | None = None,
    ):
        """`journal`: the actions that were given to the loop; `columns`: see daemon.serving.device_reports.other_columns."""
        self._description, self._clock, self._journal = description, clock, journal
        self.snapshot: np.ndarray | None = None
        """the newest, shape (); None while no loop has published one"""
        self.alive = False
        """whether a loop is running"""
        self._slot_states: dict[int, tuple[Any, ...]] = {}
        self._times: deque[np.ndarray] = deque()
        self._timed = 0
        self._loads: deque[tuple[int, np.ndarray]] = deque(maxlen=1024)
        self._signature: object = None
        record = snapshot_dtype(description)
        self._of_actions = _bytes_of(record, *(("actions", field) for field in _MARK))
        self._of_status = _bytes_of(
            record,
            *(("flags",), ("stop_reason",), ("claims",), ("error",), ("holds",), ("speed",)),
            *(("actions", "serial"), ("actions", "state")),
        )
        self._marks = np.zeros(len(self._of_actions), np.uint8)
        self._columns = columns or {}
        self._feet = [foot.name for foot in description.feet]

    def follow(self, snapshots: np.ndarray) -> Iterator[RobotState | DeviceStates | ActionEvent]:
        """What new snapshots (k,), oldest first, have to tell. Each is told once; call with what a ring's `read` gives."""
        if not len(snapshots):
            return
        before = int(self.snapshot["time_ns"]) if self.snapshot is not None else -1
        self.alive = True
        self._time(snapshots)
        tick = before // STATE_PERIOD_NS
        # Only snapshots in which some action changed are looked at one by one.
        marks, told = (
            snapshots.view(np.uint8).reshape(len(snapshots), -1)[:, self._of_actions],
            np.zeros(len(snapshots), bool),
        )
        if (marks != self._marks).any():
            told[0] = True
            told[1:] = (marks[1:] != marks[:-1]).any(axis=1)
            self._marks = marks[-1].copy()
        for row, (time_ns, news) in enumerate(zip(snapshots["time_ns"].tolist(), told.tolist(), strict=True)):
            if news:
                yield from self._action_events(snapshots[row])
            if tick != (tick := time_ns // STATE_PERIOD_NS):
                yield robot_state(snapshots[row], self._feet)
                if self._description.devices and tick % _TICKS_A_DEVICE_STATE == 0:
                    yield device_states(snapshots[row], self._description, self._columns)
        self.snapshot = snapshots[-1].reshape(())
        newest = snapshots[-1]
        if not self._loads or int(newest["time_ns"]) - self._loads[-1][0] >= _LOAD_WINDOW_NS // 20:
            self._loads.append((int(newest["time_ns"]), newest["busy_ns"].copy()))

    def _action_events(self, snapshot: np.void) -> Iterator[ActionEvent]:
        slots = snapshot["actions"]
        for number, mark in enumerate(zip(*(slots[field].tolist() for field in _MARK), strict=True)):
            if mark[0] == 0 or mark[1] == ActionState.EMPTY or self._slot_states.get(number) == mark:
                continue
            slot = slots[number]
            previous = self._slot_states.get(number, (0,))[0]
            self._slot_states[number] = mark
            if previous not in (0, mark[0]) and (unseen := self._journal.find(previous)) is not None:
                self._journal.ended(previous)
                why = "its end was not seen: the server fell behind the loop"
                yield _ended(unseen, why, int(snapshot["time_ns"]), int(snapshot["cycle"]))
            if (started := self._journal.find(mark[0])) is None:
                continue  # told already by the server that ran before this one
            problems = drive_problems(snapshot, self._description) if mark[1] == ActionState.ENDED else {}
            yield action_event(slot, started.id, started.ends, self._description.joints, problems, started.steps)
            if mark[1] == ActionState.ENDED:
                self._journal.ended(mark[0])

    def lose_loop(self, why: str) -> Iterator[ActionEvent]:
        """The loop has died, or has started anew: every action that it ran has ended. Told once."""
        self.alive = False
        self._slot_states.clear()
        self._marks[:] = 0
        self._loads.clear()
        time_ns, cycle = (
            (0, 0) if self.snapshot is None else (int(self.snapshot["time_ns"]), int(self.snapshot["cycle"]))
        )
        for started in self._journal.running():
            self._journal.ended(started.serial)
            yield _ended(started, why, time_ns, cycle)

    def latched(self) -> str | None:
        """Why the operator stop is latched, as the loop told last, even if it has died since; None: it is not."""
        if self.snapshot is None or Flag.STOPPED not in Flag(int(self.snapshot["flags"])):
            return None
        return _text(self.snapshot["stop_reason"])

    def running_owners(self) -> set[int]:
        """Numbers of the owners of actions that run or are paused."""
        if self.snapshot is None or not self.alive:
            return set()
        slots = self.snapshot["actions"]
        active = (slots["state"] == ActionState.RUNNING) | (slots["state"] == ActionState.PAUSED)
        return {int(owner) for owner in slots["owner"][active]}

    def drive_problem(self, joint: str) -> str:
        """What is wrong with a joint's drive, in words; empty: nothing."""
        return "" if self.snapshot is None else drive_problems(self.snapshot, self._description).get(joint, "")

    def changed(self) -> bool:
        """True when the status differs in more than numbers from what it was at the last call."""
        signature: object = self.alive
        if self.snapshot is not None:
            newest = self.snapshot
            signature = (
                self.alive,
                newest.reshape(1).view(np.uint8)[self._of_status].tobytes(),
                drive_marks(newest),
                *device_problems(newest, self._description),
            )
        if signature == self._signature:
            return False
        self._signature = signature
        return True

    def status(
        self,
        owner_name: Callable[[int], str],
        processes: dict[str, str],
        bus_states: Mapping[str, str],
        loaded: Mapping[int, str],
    ) -> DaemonStatus:
        """The daemon's status now.

        `processes`: health of the service's processes, as its supervisor tells it; `bus_states`: channel → the error state of
        the daemon's node there, where it is known; `loaded`: code → name of the controllers that were loaded by name.
        """
        if self.snapshot is None or not self.alive:
            latched = self.latched()
            return DaemonStatus(
                time_ns=0 if self.snapshot is None else int(self.snapshot["time_ns"]),
                clock=self._clock,
                enabled=False,
                stopped=latched is not None,
                stop_reason=latched or "",
                drives=drive_statuses(None, self._description),
                controllers={},
                loop=LoopStatistics(),
                buses=[BusStatistics(channel=channel.name) for channel in self._description.channels],
                devices=device_statuses(None, self._description),
                processes=processes,
            )
        newest = self.snapshot
        flags, running = Flag(int(newest["flags"])), self._running_actions(newest)
        return DaemonStatus(
            time_ns=int(newest["time_ns"]),
            clock=self._clock,
            enabled=Flag.ENABLED in flags,
            stopped=Flag.STOPPED in flags,
            stop_reason=_text(newest["stop_reason"]),
            drives=drive_statuses(newest, self._description),
            controllers=active_controllers(newest, self._description.joints, loaded),
            action=running[0] if running else "",
            actions=running,
            loop=self._loop_statistics(newest),
            buses=self._bus_statistics(newest, bus_states),
            devices=device_statuses(newest, self._description),
            isolated=isolated_limbs(newest, self._description),
            speed=float(newest["speed"]),
            holds=[owner_name(int(owner)) for owner in newest["holds"][:MAX_HOLDS] if owner],
            processes=processes,
        )

    def _running_actions(self, newest: np.ndarray) -> list[str]:
        alive = [slot for slot in newest["actions"] if slot["state"] in (ActionState.RUNNING, ActionState.PAUSED)]
        known = [(self._journal.find(int(slot["serial"])), int(slot["serial"])) for slot in alive]
        return [started.id if started else f"serial {serial}" for started, serial in known]

    def _time(self, snapshots: np.ndarray) -> None:
        """Keep the last cycles' times: work, lateness (ns), two rows for each call. Whoever wants the percentiles joins them."""
        self._times.append(np.array((snapshots["work_ns"], snapshots["late_ns"])))
        self._timed += len(snapshots)
        while self._timed - (oldest := self._times[0].shape[1]) >= _TIMING_WINDOW:
            self._times.popleft()
            self._timed -= oldest

    def _loop_statistics(self, newest: np.ndarray) -> LoopStatistics:
        known = np.concatenate(self._times, axis=1)[:, -_TIMING_WINDOW:] / 1e3
        (work_p50, late_p50), (work_p99, late_p99) = np.percentile(known, (50, 99), axis=1)
        return LoopStatistics(
            cycles=int(newest["cycle"]),
            misses=int(newest["misses"]),
            stale_replies=int(newest["stale_replies"]),
            crc_errors=int(newest["crc_errors"]),
            work_p50_us=float(work_p50),
            work_p99_us=float(work_p99),
            late_p50_us=float(late_p50),
            late_p99_us=float(late_p99),
            limited=int(newest["limited"]),
        )

    def _bus_statistics(self, newest: np.ndarray, states: Mapping[str, str]) -> list[BusStatistics]:
        now = int(newest["time_ns"])
        # The one before the window stays: a server that reads seldom has none inside it.
        while len(self._loads) > 1 and now - self._loads[1][0] >= _LOAD_WINDOW_NS:
            self._loads.popleft()
        then, busy_then = self._loads[0] if self._loads else (now, newest["busy_ns"])
        share = (newest["busy_ns"] - busy_then) / max(now - then, 1)
        return [
            BusStatistics(
                channel=channel.name,
                frames_sent=int(newest["frames_sent"][row]),
                frames_received=int(newest["frames_received"][row]),
                load=float(share[row]),
                state=states.get(channel.name, ""),
            )
            for row, channel in enumerate(self._description.channels)
        ]


def _bytes_of(record: np.dtype, *fields: tuple[str, ...]) -> np.ndarray:
    """Where in a record's bytes some fields lie, each named by its path: looked at as bytes, all of them take one operation."""
    whole = np.zeros(1, record)
    for path in fields:
        part = functools.reduce(lambda part, name: part[name], path, whole)
        part[...] = np.frombuffer(b"\xff" * part.dtype.itemsize, part.dtype)[0]
    return np.flatnonzero(whole.view(np.uint8))


def _ended(started: Started, why: str, time_ns: int, cycle: int) -> ActionEvent:
    return ActionEvent(id=started.id, state="ended", outcome="stopped", detail=why, time_ns=time_ns, cycle=cycle)


def _text(raw: np.ndarray) -> str:
    return bytes(raw).rstrip(b"\0").decode(errors="replace")
