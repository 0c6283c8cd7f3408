"""Calls about instances, and what all are told of them: of each at most 30 times a second, always the latest."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from affordance_templates import template_saving, travelling
from affordance_templates.placement import Array
from affordance_templates.server import AffordanceServer
from handrail import messages as m

RATE = 30.0
"""Hz at which one instance is told at most"""


class LatestAtMost:
    """Of each instance the newest state, no sooner than 1/RATE s after the one before. Not safe to share between threads."""

    def __init__(self) -> None:
        self._told_at: dict[str, float] = {}
        self._waiting: dict[str, m.InstanceState] = {}

    def now(self, state: m.InstanceState, now_s: float) -> bool:
        """Whether it is to be told at once; else it waits, in the place of an older one. That it is gone is told at once."""
        early = now_s - self._told_at.get(state.name, float("-inf")) < 1 / RATE
        if early and not state.removed:
            self._waiting[state.name] = state
            return False
        self._waiting.pop(state.name, None)
        self._told_at[state.name] = now_s
        if state.removed:
            del self._told_at[state.name]
        return True

    def due(self, now_s: float) -> list[m.InstanceState]:
        """Those that have waited long enough."""
        ready = [state for name, state in self._waiting.items() if now_s - self._told_at[name] >= 1 / RATE]
        for state in ready:
            del self._waiting[state.name]
            self._told_at[state.name] = now_s
        return ready

    def next_s(self, now_s: float) -> float | None:
        """s until the next one may be told; None: none waits."""
        return min((self._told_at[name] + 1 / RATE - now_s for name in self._waiting), default=None)


class InstanceDesk:
    """Answers calls about the instances of a server, tells of them, ends holds, has what the robot carries go along with it."""

    def __init__(self, tell: Callable[[m.InstanceState], None]):
        """`tell`: everybody, from any thread."""
        self._tell = tell
        self._latest = LatestAtMost()
        self._lock = threading.Lock()
        self._something, self._closing = threading.Event(), threading.Event()
        self._server: AffordanceServer | None = None
        self._follows = False
        """whether it looks where the robot's links are"""
        self._thread = threading.Thread(target=self._work, name="instances' desk", daemon=True)

    def open(
        self, server: AffordanceServer, link_in_world: Callable[[str], Array | None]
    ) -> dict[type, Callable[[Any], Any]]:
        """The calls that it answers, by their types; from now on holds end, and what the robot carries goes along with it.

        `link_in_world`: a link of the robot → (4, 4) where it is; None: there is none, or it is not known.
        """
        self._server = server
        server.link_in_world = link_in_world
        self._thread.start()
        return {
            m.PlaceInstance: lambda call: server.place(call).state(),
            m.MoveInstance: lambda call: server.move(call).state(),
            m.SetParameters: lambda call: server.set_parameters(call).state(),
            m.EditInstance: server.edit,
            m.AttachInstance: lambda call: self._woken(server.attach(call)),
            m.SaveTemplate: lambda call: template_saving.save(call, server),
            m.GetTemplate: travelling.told,
            m.UndoEdit: lambda call: self._woken(server.undo(call)),
            m.RedoEdit: lambda call: self._woken(server.redo(call)),
            m.HoldInstance: self._hold,
            m.ReleaseInstance: lambda call: server.release(call).state(),
            m.RemoveInstance: server.remove,
            m.SetJoint: lambda call: server.set_joint(call.name, call.joint, call.position).state(),
            m.GetInstances: lambda call: m.Instances(instances=[each.state() for each in server.instances()]),
        }

    def told(self, state: m.InstanceState) -> None:
        """Tell of an instance that has changed: at once, or as soon as it may be."""
        if state.attachment is not None and not self._follows:
            self._something.set()
        with self._lock:
            if self._latest.now(state, time.monotonic()):
                self._tell(state)
            else:
                self._something.set()

    def close(self) -> None:
        """End the thread; what waits is told."""
        self._closing.set()
        self._something.set()
        if self._thread.is_alive():
            self._thread.join()
        with self._lock:
            for state in self._latest.due(float("inf")):
                self._tell(state)

    def _hold(self, call: m.HoldInstance) -> m.InstanceState:
        assert self._server is not None
        state = self._server.hold(call).state()
        self._something.set()
        return state

    def _woken(self, edit: m.InstanceEdit) -> m.InstanceEdit:
        self._something.set()
        return edit

    def _work(self) -> None:
        assert self._server is not None
        while not self._closing.is_set():
            self._something.clear()
            self._follows = self._server.follow()
            waits = [self._server.end_holds(), 1 / RATE if self._follows else None]
            with self._lock:
                now_s = time.monotonic()
                for state in self._latest.due(now_s):
                    self._tell(state)
                waits.append(self._latest.next_s(now_s))
            self._something.wait(min((max(each, 0.0) for each in waits if each is not None), default=None))
