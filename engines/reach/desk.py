"""The engine's side of reachability: who wants to know what, when it is asked anew, and the process that finds out.

The engine never waits for it. While somebody watches, the instances are asked about as they stand whenever the answer before is
there, at most at the rate that was wished for, and once what carries the arm has moved. The process is started by the first
question, and ended a minute after the last.
"""

from __future__ import annotations

import os
import select
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field

import msgspec
import numpy as np

from affordance_templates.attachments import carried
from affordance_templates.server import AffordanceServer
from engines.daemon_client import DaemonClient
from engines.nodes.warm import environment
from engines.nodes.wire import Wire
from engines.plans.freshness import World, moved_by
from engines.reach.wire import Ask, Told
from engines.service import Wake
from handrail import workspace
from handrail.messages import GetReach, Reach
from handrail.robot.description import RobotDescription
from handrail.topics import refuse

_IDLE_S = 60.0
"""of wall time for which the process is kept though nobody asks"""
_LOOK_S = 0.5
"""how often it is looked whether the robot has moved"""
_PATIENCE_S = 1.0
"""for which a call waits for an answer that is settled; then any will do"""
_ROOM = 4 << 20
"""bytes on the way to the process: who asks must not wait for it"""
_MOVED, _SHIFTED = 0.02, (0.005, 0.005)
"""rad (m) of a joint, m and rad of the base, from which on what carries the arm has moved"""

Start = Callable[[], tuple[socket.socket, Callable[[], None]]]
"""starts the process: its end of a stream socket, and what ends it"""


def start_process(description: RobotDescription) -> tuple[socket.socket, Callable[[], None]]:
    """See `engines.reach.worker`."""
    ours, theirs = socket.socketpair()
    ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _ROOM)
    with theirs:
        words = [sys.executable, "-m", "engines.reach.worker", str(description.folder), str(theirs.fileno())]
        process = subprocess.Popen(
            words,
            pass_fds=[theirs.fileno()],
            stdin=subprocess.DEVNULL,
            env=environment(os.environ),
            start_new_session=True,
        )

    def end() -> None:
        process.kill()
        process.wait()

    return ours, end


@dataclass
class _Watch:
    """One trajectory, instance and arm that somebody wants to know about."""

    call: GetReach
    arm: str
    period_s: float
    until: float
    due: bool = True
    """something has changed since it was asked"""
    asked_at: float = -float("inf")
    number: int = 0
    """of the newest question"""
    open: bool = False
    """it has no answer yet"""
    world: World | None = None
    """that was asked about"""
    last: Reach | None = None
    """that was told"""
    answers: list[tuple[float, int, Future[Reach]]] = field(default_factory=list)
    """calls that wait: since when, for which question or a later one"""


class ReachDesk:
    """Of one engine; its methods may be called from any thread."""

    def __init__(
        self,
        description: RobotDescription,
        affordances: AffordanceServer,
        daemon: DaemonClient,
        tell: Callable[[msgspec.Struct], None],
        start: Start | None = None,
    ):
        self._description, self._affordances, self._daemon, self._tell = description, affordances, daemon, tell
        self._start = start or (lambda: start_process(description))
        self._lock = threading.Lock()
        self._watches: dict[tuple[str, str, str], _Watch] = {}
        self._thread: threading.Thread | None = None
        self._wake = Wake()
        self._closing = False
        self._number = 0
        self._wire: Wire | None = None
        self._end: Callable[[], None] = lambda: None
        self._asked: dict[int, tuple[str, str, str]] = {}
        """number of a question → what it is about"""

    def ask(self, call: GetReach) -> Future[Reach]:
        """The answer to a call. Refused where instance, trajectory or arm are not there."""
        arm = self._arm(call)
        answer: Future[Reach] = Future()
        now = time.monotonic()
        key = (call.instance, call.trajectory, arm)
        with self._lock:
            watch = self._watches.get(key)
            if watch is None:
                watch = self._watches[key] = _Watch(call, arm, 1.0 / call.rate, now)
            elif call.lasts:  # as often as the more curious one wants
                watch.period_s = min(watch.period_s, 1.0 / call.rate)
            if call.clearance != watch.call.clearance:
                watch.call, watch.due = call, True
            watch.until = max(watch.until, now + call.lasts)
            if watch.last is not None and watch.last.settled and not watch.due and not watch.open:
                answer.set_result(watch.last)
                return answer
            watch.due = True
            watch.answers.append((now, self._number + 1, answer))
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="reachability", daemon=True)
                self._thread.start()
        self._wake.set()
        return answer

    def instance_changed(self) -> None:
        """Some instance has: all that stands around counts."""
        with self._lock:
            for watch in self._watches.values():
                watch.due = True
            watched = bool(self._watches)
        if watched:
            self._wake.set()

    def close(self) -> None:
        """End the process and the thread; calls that wait are refused."""
        with self._lock:
            self._closing, thread = True, self._thread
        self._wake.set()
        if thread is not None:
            thread.join(5.0)
        self._wake.close()

    def _arm(self, call: GetReach) -> str:
        arms = self._description.arms
        arm = call.arm or (next(iter(arms)) if len(arms) == 1 else "")
        if arm not in arms:
            raise refuse(
                "no such arm", "arm", call.arm or "none", f"one of: {', '.join(arms) or 'none, it has no arm'}"
            )
        known = self._affordances.get(call.instance).resolve().trajectories
        if call.trajectory not in known:
            raise refuse("no such trajectory", "trajectory", call.trajectory, f"one of: {', '.join(known) or 'none'}")
        return arm

    # --------------------------------------------------------------------------------------------------------- the thread

    def _run(self) -> None:
        idle_since = time.monotonic()
        while True:
            with self._lock:
                self._expire()
                if self._watches:
                    idle_since = time.monotonic()
                elif self._closing or time.monotonic() - idle_since > _IDLE_S:
                    self._drop()
                    self._thread = None
                    return
                if self._closing:
                    self._fail("the engine ends")
                    continue
                timeout = self._ask_what_is_due()
            sockets: list[Wake | socket.socket] = [self._wake]
            if self._wire is not None:
                sockets.append(self._wire.socket)
            ready = select.select(sockets, [], [], timeout)[0]
            self._wake.clear()
            if self._wire is not None and self._wire.socket in ready:
                self._hear(self._wire)

    def _expire(self) -> None:
        now = time.monotonic()
        self._watches = {key: watch for key, watch in self._watches.items() if watch.until > now or watch.answers}

    def _ask_what_is_due(self) -> float:
        """Ask; s until something may be due again."""
        world, now = self._daemon.world(), time.monotonic()
        next_s = _LOOK_S if self._watches else _IDLE_S
        for key, watch in list(self._watches.items()):
            if watch.open:
                continue
            due = watch.due or (world is not None and self._carried(watch, world))
            wait = watch.asked_at + watch.period_s - now
            if due and wait <= 0.0:
                watch.due, watch.asked_at = False, now
                self._send(key, watch, world)
            elif due:
                next_s = min(next_s, wait)
        return next_s

    def _carried(self, watch: _Watch, world: World) -> bool:
        """Whether joints that are not the arm's, or the base, are elsewhere than was asked about, or the base was lost or found."""
        before = watch.world
        if before is None:
            return True
        own = self._description.index(self._description.arms[watch.arm].joints)
        off = np.abs(world.command - before.command)
        off[own] = 0.0
        if off.max(initial=0.0) > _MOVED or (world.base is None) != (before.base is None):
            return True
        if world.base is None or before.base is None:
            return False
        if (world.base.source == "none") != (before.base.source == "none"):
            return True
        return bool(moved_by(before.base.pose_in_world, world.base.pose_in_world, *_SHIFTED))

    def _send(self, key: tuple[str, str, str], watch: _Watch, world: World | None) -> None:
        self._number += 1
        watch.number, watch.world, watch.open = self._number, world, True
        self._asked[self._number] = key
        if world is None:
            self._told(Told(self._number, 0, [], True, "the daemon has not told where the robot is: is it running?"))
            return
        deployed = workspace.deployed()
        instance, trajectory, arm = key
        there = self._affordances.instances()
        left_out = set(carried(there)) - {instance}  # it is where the hand is: no obstacle to that
        ask = Ask(
            number=self._number,
            instance=instance,
            trajectory=trajectory,
            arm=arm,
            clearance=watch.call.clearance,
            instances=[each.state() for each in there if each.name not in left_out],
            position=world.command.tolist(),
            base=world.base,
            deployed=str(deployed) if deployed else "",
        )
        try:
            if self._wire is None:
                connection, self._end = self._start()
                self._wire = Wire(connection, Told)
            self._wire.send(ask)
        except OSError as problem:
            self._lost(str(problem))

    def _hear(self, wire: Wire) -> None:
        try:
            wire.read()
        except EOFError:
            with self._lock:
                self._lost("it has ended")
            return
        while (told := wire.arrived()) is not None:
            with self._lock:
                self._told(told)

    def _told(self, told: Told) -> None:
        key = self._asked.get(told.number)
        watch = self._watches.get(key) if key is not None else None
        if told.settled:
            self._asked.pop(told.number, None)
        if watch is None or key is None:
            return
        for number in [number for number, about in self._asked.items() if about == key and number < told.number]:
            del self._asked[number]
        watch.open = watch.open and told.number != watch.number
        instance, trajectory, arm = key
        reach = Reach(
            instance=instance,
            version=told.version,
            trajectory=trajectory,
            arm=arm,
            waypoints=told.waypoints,
            settled=told.settled,
            problem=told.problem,
        )
        now, watch.last = time.monotonic(), reach
        if watch.until > now:
            self._tell(reach)
        left = []
        for since, number, answer in watch.answers:
            if told.number >= number and (told.settled or now - since > _PATIENCE_S):
                answer.set_result(reach)
            else:
                left.append((since, number, answer))
        watch.answers = left

    def _lost(self, why: str) -> None:
        """The process: what waits for it is refused, and it is started anew by the next question."""
        self._drop()
        self._fail(f"reachability can't be found out: {why}")

    def _drop(self) -> None:
        if self._wire is not None:
            self._wire.close()
            self._end()
            self._wire = None
        self._asked.clear()

    def _fail(self, why: str) -> None:
        for watch in self._watches.values():
            for _, _, answer in watch.answers:
                answer.set_exception(refuse(why))
        self._watches.clear()
