"""The instances as an engine has them that does not own them: what the first engine tells, and what it is asked to change."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from affordance_templates import catalogue
from affordance_templates.instance import Instance
from affordance_templates.server import AffordanceServer
from handrail import messages as m
from handrail.engines import FIRST
from handrail.runtime import Runtime
from handrail.topics import Caller, RefusedError, Subscriber, Unreachable, refuse

_CALL_S = 5.0
_LOOK_S = 1.0


class SharedInstances(AffordanceServer):
    """Reads like an AffordanceServer. Edits are the first engine's: they return when it has told of them."""

    def __init__(
        self, runtime: Runtime, *, changed: Callable[[m.InstanceState], None], log: Callable[[str, str], None]
    ):
        """`changed` is told every instance's new state, from a thread of its own."""
        super().__init__(runtime.folder / "no instances of its own", changed=changed)
        self._runtime, self._log = runtime, log
        self._own = threading.local()
        self._closing = threading.Event()
        self._current = False
        self._thread = threading.Thread(target=self._listen, name="instances", daemon=True)
        self._thread.start()

    def place(self, request: m.PlaceInstance) -> Instance:
        return self._answered(self._call(request))

    def move(self, request: m.MoveInstance) -> Instance:
        return self._answered(self._call(request))

    def set_parameters(self, request: m.SetParameters) -> Instance:
        return self._answered(self._call(request))

    def edit(self, request: m.EditInstance) -> m.InstanceEdit:
        return self._call(request)

    def attach(self, request: m.AttachInstance) -> m.InstanceEdit:
        return self._call(request)

    def undo(self, request: m.UndoEdit) -> m.InstanceEdit:
        return self._call(request)

    def redo(self, request: m.RedoEdit) -> m.InstanceEdit:
        return self._call(request)

    def hold(self, request: m.HoldInstance) -> Instance:
        return self._answered(self._call(request))

    def release(self, request: m.ReleaseInstance) -> Instance:
        return self._answered(self._call(request))

    def remove(self, request: m.RemoveInstance) -> None:
        self._call(request)

    def set_joint(self, name: str, joint: str, position: float) -> Instance:
        return self._answered(self._call(m.SetJoint(name=name, joint=joint, position=position)))

    def close(self) -> None:
        """End the thread."""
        self._closing.set()
        self._thread.join(2 * _LOOK_S)

    def _call(self, message: Any) -> Any:
        if not hasattr(self._own, "caller"):
            self._own.caller = Caller(self._runtime.endpoint(f"{FIRST}.call"))
        try:
            return self._own.caller.call(message, _CALL_S)
        except Unreachable as silent:
            raise refuse(f"the engine that owns the instances does not answer: {silent}") from silent

    def _answered(self, state: m.InstanceState) -> Instance:
        self._take(state)
        return self.get(state.name)

    def _listen(self) -> None:
        subscriber = Subscriber(self._runtime.endpoint(f"{FIRST}.events"), m.InstanceState | m.EngineInfo)
        try:
            while not self._closing.is_set():
                event = subscriber.receive(_LOOK_S)
                match event:
                    case m.InstanceState():
                        self._take(event)
                    case m.EngineInfo():
                        self._current = False  # it may have started anew, and have others
                if not self._current:
                    self._fetch()
        finally:
            subscriber.close()

    def _fetch(self) -> None:
        try:
            found = self._call(m.GetInstances())
        except RefusedError:
            return  # asked again, soon
        self._current = True
        with self._lock:
            there = {state.name for state in found.instances}
            for gone in [each for each in self.instances() if each.name not in there]:
                self._now = self._now.without(gone.name)
                self._changed(gone.state(removed=True))
        for state in found.instances:
            self._take(state)

    def _take(self, state: m.InstanceState) -> None:
        with self._lock:
            old = self._now.instances.get(state.name)
            if state.removed:
                self._now = self._now.without(state.name)
            elif old is not None and old.state() == state:
                return
            elif old is not None and old.version > state.version:
                return  # told late of what is older than what an edit was answered with
            else:
                try:
                    instance = Instance.of(state, catalogue.load(state.template))
                except ValueError as problem:
                    self._now = self._now.without(state.name)
                    self._log("error", f"instance {state.name}: {problem}; not in this engine's world")
                    return
                self._now = self._now.with_instance(instance, {})
        self._changed(state)
