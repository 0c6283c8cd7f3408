"""The control daemon as two processes that a test may call, kill, freeze and start anew."""

from __future__ import annotations

import contextlib
import signal
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from typing import Any

from hal.hil.nursery import Nursery, Process
from handrail import messages as m
from handrail.runtime import Runtime
from handrail.topics import Caller, RefusedError, Subscriber, Unreachable

OWNER = "test"
_ANSWER_S, _MAKING_S = 20.0, 300.0
"""s of wall time: for an answer, on a busy machine; until a motion's controller is made, where nothing was compiled yet"""
_CHECK_IN_S = 0.3
_EVENTS_KEPT = 50_000


class Daemon:
    """The loop and its server, supervised by the test alone: what dies stays dead until it is started."""

    def __init__(self, nursery: Nursery, runtime: Runtime, arguments: list[str]):
        self._nursery, self._runtime, self._arguments = nursery, runtime, arguments
        self.loop: Process
        self.server: Process
        self.events: list[m.DaemonEvent] = []
        """everything that the server published, the newest last"""
        self.status: m.DaemonStatus | None = None
        self.checks_in = True
        """set it to False, and the daemon soon takes whoever runs the actions for dead"""
        self._ended: dict[str, m.ActionEvent] = {}
        self._changed = threading.Condition()
        self._closing = threading.Event()
        self._caller = Caller(runtime.endpoint("daemon.call"))
        self.start_loop()
        self.start_server()
        self._threads = [
            threading.Thread(target=work, name=f"hil-{work.__name__}", daemon=True)
            for work in (self._listen, self._check_in)
        ]
        for thread in self._threads:
            thread.start()

    def _listen(self) -> None:
        subscriber = Subscriber(self._runtime.endpoint("daemon.events"), m.DaemonEvent)
        while not self._closing.is_set():
            event = subscriber.receive(0.1)
            if event is None:
                continue
            with self._changed:
                self.events.append(event)
                if len(self.events) > _EVENTS_KEPT:
                    del self.events[: _EVENTS_KEPT // 10]
                if isinstance(event, m.DaemonStatus):
                    self.status = event
                elif isinstance(event, m.ActionEvent) and event.state == "ended":
                    self._ended[event.id] = event
                self._changed.notify_all()
        subscriber.close()

    def _check_in(self) -> None:
        caller = Caller(self._runtime.endpoint("daemon.call"), timeout_s=1.0)
        while not self._closing.is_set():
            if self.checks_in:
                with contextlib.suppress(Unreachable):
                    caller.call(m.CheckIn(owner=OWNER))
            self._closing.wait(_CHECK_IN_S)
        caller.close()

    # ------------------------------------------------------------------------------------------------------------ processes

    def start_loop(self) -> None:
        """Start the loop, and wait until it runs."""
        self.loop = self._nursery.start("loop", "daemon.loop", self._arguments)
        self.loop.wait_for("loop ready")

    def start_server(self) -> None:
        """Start the server, and wait until it serves."""
        self.server = self._nursery.start("server", "daemon.server", self._arguments)
        self.server.wait_for("server ready")

    @contextlib.contextmanager
    def frozen(self) -> Iterator[None]:
        """The loop hangs while the block runs (SIGSTOP), as if its machine were out of memory or its code in an endless loop."""
        self.loop.send(signal.SIGSTOP)
        try:
            yield
        finally:
            self.loop.send(signal.SIGCONT)

    def processes(self) -> list[Process]:
        """Those that there are."""
        return [self.loop, self.server]

    def close(self) -> None:
        self._closing.set()
        for process in (self.server, self.loop):
            process.end()
        for thread in self._threads:
            thread.join(5.0)
        self._caller.close()

    # ---------------------------------------------------------------------------------------------------------------- calls

    def call(self, message: m.Message, timeout_s: float | None = None) -> Any:
        """A call of handrail.messages.DaemonCall. Raises RefusedError, Unreachable."""
        return self._caller.call(message, timeout_s)

    def wait_status(
        self, wanted: Callable[[m.DaemonStatus], bool], what: str, timeout_s: float = 20.0
    ) -> m.DaemonStatus:
        """The first status from now on that satisfies `wanted`. Raises AssertionError with the last one."""
        deadline = time.monotonic() + timeout_s
        with self._changed:
            self.status = None
            while not ((status := self.status) and wanted(status)):
                assert self._changed.wait(max(0.0, deadline - time.monotonic())), (
                    f"{what}: the last status was {status}"
                )
        return status

    def enable(self) -> m.DaemonStatus:
        """Take the robot to operation enabled, and wait until it holds."""
        self.call(m.Enable())
        return self.wait_status(lambda status: status.enabled and not status.isolated, "enabled")

    def start(self, motion: m.Motion, *ends: m.EndCondition) -> str:
        """Start an action of the test's; its id. The first whole-body motion may take a while to be made."""
        action = f"{OWNER}-{uuid.uuid4().hex[:8]}"
        gives_up = time.monotonic() + _MAKING_S
        while True:
            try:
                self.call(m.StartAction(id=action, owner=OWNER, motion=motion, ends=list(ends)), _ANSWER_S)
            except RefusedError as error:
                if error.refusal.value != m.NOT_READY or time.monotonic() > gives_up:
                    raise
            else:
                return action

    def ended(self, action: str, wait_s: float = 0.0) -> m.ActionEvent | None:
        """How an action ended, if it has."""
        with self._changed:
            self._changed.wait_for(lambda: action in self._ended, wait_s)
            return self._ended.get(action)

    def wait_end(self, action: str, timeout_s: float = 60.0) -> m.ActionEvent:
        """How an action ended. Raises AssertionError when it does not."""
        with self._changed:
            ended = self._changed.wait_for(lambda: action in self._ended, timeout_s)
        assert ended, f"action {action} did not end in {timeout_s:g} s; {self.status}"
        return self._ended[action]
