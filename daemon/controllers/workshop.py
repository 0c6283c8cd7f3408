"""Where controllers that are loaded by name are made: a thread beside the loop, which the loop never waits for.

Importing a user's file, making a controller, compiling its kernels and writing the roster take milliseconds to seconds; none of
it happens in a cycle. The loop puts jobs here and asks once a cycle what has been `finished`; then switching it on is a matter of a
cycle.

A thread shares the interpreter with the loop. On the wall clock it runs on the loop's core at the lowest real-time priority: only
while the loop sleeps, and nobody else keeps it from finishing what it does; it gives the interpreter back within
SWITCH_INTERVAL_S of the loop's waking, which is less than the loop wakes ahead of its deadline
(hal.realtime.sleep_then_spin_until). What can still hold the loop up is a single call of a library that keeps the interpreter for
longer, as opening a shared object does. `handrail bench switching` measures it.
"""

from __future__ import annotations

import _thread
import contextlib
import os
import queue
import sys
import traceback
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from daemon.controllers.base import ChainableController, Controller, Gains, Setup, rows_of
from daemon.controllers.registry import KINDS, find_kind
from daemon.controllers.roster import NEWS_KEPT, Loaded, News, Roster, write_roster
from daemon.exchange import LOADED_CODE, ControllerState
from daemon.exchange.doorbell import Bell, server_doorbell
from daemon.state.robot_state import RobotState
from hal.joint import COMMANDED, JointCommand, JointState
from handrail.messages import ConfigureController, LoadController
from handrail.robot.kinematics import Kinematics

SWITCH_INTERVAL_S = 50e-6
"""after which a thread that works in the interpreter lets another one that waits for it have a turn (sys.setswitchinterval)"""
_REHEARSED = 20
"""cycles that a new controller is tried for"""
_UNTOUCHED = 7.25e77
"""what a rehearsed controller finds in the rows of its command"""


@dataclass(frozen=True)
class When:
    """The cycle in which the loop gave a job, and the number of the roster that tells of it."""

    roster: int
    time_ns: int
    cycle: int


@dataclass(frozen=True)
class Job:
    """What the loop wants done about one slot (−1: about a controller that has none)."""

    when: When
    slot: int = -1
    text: bytes = b""
    """JSON of a LoadController or ConfigureController"""
    forget: bool = False
    failed: tuple[str, Exception] | None = None
    """name of a controller that raised this in a cycle"""


@dataclass(frozen=True)
class Done:
    """What became of a LoadController or ConfigureController."""

    slot: int
    state: ControllerState
    """EMPTY where it could not be loaded, UNCONFIGURED where it could not be made (or was not to be), else INACTIVE"""
    name: str = ""
    controller: Controller | None = None
    onto: str = ""
    fallback: tuple[str, ...] = ()


class Workshop:
    """Makes controllers, and keeps the roster's file."""

    def __init__(self, kinematics: Kinematics, gains: Gains, joints: JointState, period: float, file: Path):
        """`joints`: as the loop measures them; `file`: of the roster."""
        self._kinematics, self._gains, self._joints, self._period = kinematics, gains, joints, period
        self._file, self._roster = file, Roster(kinds=sorted(KINDS))
        self._entries: dict[int, Loaded] = {}
        self._kinds: dict[int, type[Controller]] = {}
        self._jobs: queue.SimpleQueue[Job | None] = queue.SimpleQueue()
        self._open, self._ended = False, _thread.allocate_lock()
        self._done: queue.SimpleQueue[Done] = queue.SimpleQueue()
        self._server = Bell(server_doorbell(file.parent))
        write_roster(file, self._roster)

    def put(self, job: Job) -> None:
        """Have something done. Returns at once."""
        if not self._open:
            # threading.Thread.start would wait until the thread runs, in the middle of a cycle.
            self._open = True
            self._ended.acquire()
            _thread.start_new_thread(self._work, ())
        self._jobs.put(job)

    def finished(self) -> Done | None:
        """What became of one job; None: nothing more has been finished. Returns at once."""
        return None if self._done.empty() else self._done.get()

    def wait(self, patience_s: float) -> Done | None:
        """The same, as soon as something is; None: nothing was in so many s of wall time."""
        with contextlib.suppress(queue.Empty):
            return self._done.get(timeout=patience_s)
        return None

    def error(self, name: str) -> str:
        """Why a controller of this name failed last, or could not be made: the exception's own line; "": it never did."""
        told = [news.detail for news in list(self._roster.news) if news.name == name and news.detail]
        return told[-1].splitlines()[-1] if told else ""

    def close(self) -> None:
        """Have the thread end, when it has done what it was given; not waited for longer than a second."""
        if self._open:
            self._open = False
            self._jobs.put(None)
            self._ended.acquire(timeout=1.0)

    # ------------------------------------------------------------------------------------------------- beside the loop

    def _work(self) -> None:
        if os.sched_getscheduler(os.getpid()) & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO:
            # Below the loop, above all others: nobody keeps the thread from giving the interpreter back.
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        while (job := self._jobs.get()) is not None:
            try:
                done = self._do(job)
            except BaseException as error:  # noqa: BLE001 - a user's file may raise anything, SystemExit included
                done = self._give_up(job, error)
            self._write(job.when)
            if done is not None:
                self._done.put(done)
        self._ended.release()

    def _do(self, job: Job) -> Done | None:
        if job.failed is not None:
            name, error = job.failed
            self._tell(job, name, ControllerState.UNCONFIGURED, _text(error))
            return None
        if job.forget:
            self._entries.pop(job.slot, None)
            self._kinds.pop(job.slot, None)
            return None
        if not job.text:
            return None
        call = msgspec.json.decode(job.text, type=LoadController | ConfigureController)
        if isinstance(call, LoadController):
            return self._load(job, call)
        entry = self._entries[job.slot]
        if call.parameters is not None:
            entry.parameters = call.parameters
        entry.error = ""
        self._write(job.when)
        return self._configure(job, entry)

    def _load(self, job: Job, call: LoadController) -> Done:
        entry = Loaded(
            slot=job.slot,
            name=call.name,
            kind=call.kind,
            joints=list(call.joints),
            onto=call.onto,
            fallback=list(call.fallback),
            parameters=call.parameters,
        )
        self._entries[job.slot] = entry
        self._write(job.when)
        kind = self._kinds[job.slot] = find_kind(call.kind)
        entry.interfaces = list(kind.interfaces)
        entry.references = list(kind.references) if issubclass(kind, ChainableController) else []
        if call.configure:
            return self._configure(job, entry)
        self._tell(job, entry.name, ControllerState.UNCONFIGURED)
        return Done(job.slot, ControllerState.UNCONFIGURED, entry.name)

    def _configure(self, job: Job, entry: Loaded) -> Done:
        kind = self._kinds[job.slot]
        rows = np.array(self._kinematics.description.index(tuple(entry.joints)), np.int64)
        setup = Setup(rows, self._gains, self._kinematics, self._period, dict(entry.parameters))
        self._rehearse(kind.make(setup), setup)
        controller = kind.make(setup)
        controller.code = LOADED_CODE + job.slot
        self._tell(job, entry.name, ControllerState.INACTIVE)
        return Done(job.slot, ControllerState.INACTIVE, entry.name, controller, entry.onto, tuple(entry.fallback))

    def _rehearse(self, twin: Controller, setup: Setup) -> None:
        """Run a twin for a few cycles where the robot is now: its kernels are compiled by that, and what it does wrong is found.

        Raises ValueError where it does not command what it claims, or more; and what it raises itself.
        """
        joints, last, out = (
            JointState(len(self._joints)),
            JointCommand(len(self._joints)),
            JointCommand(len(self._joints)),
        )
        joints.memory[...] = self._joints.memory
        robot = RobotState(self._kinematics, joints, self._period)
        last.follow(joints)
        robot.update(last)
        twin.activate(robot, last)
        claimed = np.zeros(out.table.shape, bool)
        claimed[np.ix_(rows_of(twin.interfaces), setup.joints)] = True
        for cycle in range(_REHEARSED):
            robot.update(last)
            out.table[...] = _UNTOUCHED
            twin.update(robot, out)
            for wrong, what in (
                (~claimed & (out.table != _UNTOUCHED), "it commands what it does not claim"),
                (claimed & (out.table == _UNTOUCHED), "it does not command what it claims"),
                (claimed & ~np.isfinite(out.table), "what it commands is no finite number"),
            ):
                if wrong.any():
                    row, joint = (int(place[0]) for place in np.nonzero(wrong))
                    name = self._kinematics.description.joints[joint]
                    raise ValueError(f"rehearsed, cycle {cycle}: {what}: {COMMANDED[row]} of {name}")

    def _give_up(self, job: Job, error: BaseException) -> Done | None:
        entry = self._entries.get(job.slot)
        if entry is None:
            self._tell(job, f"slot {job.slot}", ControllerState.EMPTY, _text(error))
            return Done(job.slot, ControllerState.EMPTY)
        known = job.slot in self._kinds
        state = ControllerState.UNCONFIGURED if known else ControllerState.EMPTY
        self._tell(job, entry.name, state, _text(error))
        if not known:
            del self._entries[job.slot]
        return Done(job.slot, state, entry.name)

    def _tell(self, job: Job, name: str, state: ControllerState, error: str = "") -> None:
        if error and job.slot in self._entries:
            self._entries[job.slot].error = error
        number = self._roster.news[-1].number + 1 if self._roster.news else 1
        word = "finalized" if state is ControllerState.EMPTY else state.name.lower()
        when = job.when
        self._roster.news.append(
            News(number=number, name=name, state=word, detail=error, time_ns=when.time_ns, cycle=when.cycle)
        )
        del self._roster.news[:-NEWS_KEPT]

    def _write(self, when: When) -> None:
        self._roster.number, self._roster.loaded = when.roster, list(self._entries.values())
        try:
            write_roster(self._file, self._roster)
            self._server.ring()
        except OSError as error:
            print(
                f"daemon loop: {self._file}: {error}; which controllers are loaded is not told",
                file=sys.stderr,
                flush=True,
            )


def _text(error: BaseException) -> str:
    """An exception as people read it: where it came from, without this file's part."""
    trace = error.__traceback__
    while trace is not None and trace.tb_frame.f_code.co_filename == __file__:
        trace = trace.tb_next
    return "".join(traceback.format_exception(type(error), error, trace)).strip()
