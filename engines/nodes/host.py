"""A node's process as its host sees it: started, watched, fed, ended. Whatever its code does, only the node ends, and says why."""

from __future__ import annotations

import contextlib
import queue
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from engines.nodes.ports import KINDS
from engines.nodes.wire import Beat, Declined, End, Failed, FromNode, Hello, Put, Ready, Stepped, Wire

_LOAD_S = 60.0
"""of wall time to import what a node imports: an empty cache, a busy machine"""
_LOOK_S = 0.1


class NodeFailed(Exception):
    """A node has ended, or does not take what it was given; `traceback` is its own, where its code raised."""

    def __init__(self, why: str, traceback: str = ""):
        self.why, self.traceback = why, traceback
        super().__init__(why)


class NodeProcess:
    """One node. Methods may be called from any thread; `told` is called from the one that listens."""

    def __init__(
        self, file: Path, params: Mapping[str, Any] | None = None, *, told: Callable[[dict[str, Any]], None] = lambda outputs: None,
        ended: Callable[[NodeFailed], None] = lambda failure: None, restarts: int = 0, silent_s: float = 5.0,
        closing: threading.Event | None = None,
    ):  # fmt: skip
        """Starts it and waits until it is loaded. Raises NodeFailed.

        :param told: what it wrote in each step
        :param ended: why it ended by itself; after `restarts` of them it stays ended
        :param silent_s: of wall time without a sign of life, after which it is killed
        :param closing: set it and call `close` to end it; set while it is still being loaded, it is killed
        """
        self.file, self._told, self._ended, self._silent_s = file, told, ended, silent_s
        self._restarts = restarts
        self.restarted = 0
        self._params, self._inputs = dict(params or {}), dict[str, Any]()
        self._answers: dict[int, queue.SimpleQueue[Stepped | NodeFailed]] = {}
        self._lock = threading.Lock()
        self._number = 0
        self._closing = closing or threading.Event()
        self._failure: NodeFailed | None = None
        self._start()

    def _start(self) -> None:
        ours, theirs = socket.socketpair()
        command = [sys.executable, "-m", "engines.nodes.child", str(self.file.absolute()), str(theirs.fileno())]
        self.process = subprocess.Popen(command, pass_fds=[theirs.fileno()], stdin=subprocess.DEVNULL)
        theirs.close()
        wire = Wire(ours, FromNode)
        self._cause = ""
        hello = self._next(wire)
        if not isinstance(hello, Hello):
            raise self._buried(wire, hello, f"was not loaded within {_LOAD_S:g} s")
        self.hello = hello
        try:
            first = Put(inputs=self._packed("inputs", self._inputs), params=self._params)
        except NodeFailed:
            self._buried(wire, None, "ended")
            raise
        with contextlib.suppress(OSError):  # it has just ended: why comes next
            wire.send(first)
        ready = self._next(wire)
        if isinstance(ready, Declined):
            self._buried(wire, ready, "ended")
            raise NodeFailed(ready.why)
        if not isinstance(ready, Ready):
            raise self._buried(wire, ready, f"did not start within {_LOAD_S:g} s")
        self._heard = time.monotonic()
        with self._lock:
            self._wire = wire
        threading.Thread(target=self._listen, args=(wire,), name=f"node {self.file.stem}", daemon=True).start()

    def _next(self, wire: Wire) -> Any | None:
        """The next message that is no sign of life; None when it is gone, none came in time, or nobody wants it any more."""
        end = time.monotonic() + _LOAD_S
        try:
            while not self._closing.is_set() and (left := end - time.monotonic()) > 0.0:
                message = wire.receive(min(_LOOK_S, left))
                if message is not None and not isinstance(message, Beat):
                    return message
        except EOFError:
            pass
        return None

    # ---------------------------------------------------------------------------------------------------------------- doing

    def put(self, inputs: Mapping[str, Any] | None = None, params: Mapping[str, Any] | None = None) -> None:
        """New inputs and parameters, from the next step on. Raises NodeFailed when it declines them, or has ended."""
        self._ask(inputs or {}, params or {}, step=False)

    def step(self, inputs: Mapping[str, Any] | None = None, params: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """One step with these inputs; the outputs that it wrote. Raises NodeFailed: declined, raised, hung, killed."""
        return self._read(self._ask(inputs or {}, params or {}, step=True))

    def close(self) -> None:
        """End it: asked first, killed a second later."""
        self._closing.set()
        with contextlib.suppress(OSError):
            self._wire.send(End())
        try:
            self.process.wait(1.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()

    def __enter__(self) -> NodeProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _ask(self, inputs: Mapping[str, Any], params: Mapping[str, Any], *, step: bool) -> Stepped:
        packed = self._packed("inputs", inputs)
        answer: queue.SimpleQueue[Stepped | NodeFailed] = queue.SimpleQueue()
        with self._lock:
            if self._failure is not None:
                raise self._failure
            self._number += 1
            number = self._number
            self._answers[number] = answer
            wire = self._wire
        try:
            wire.send(Put(packed, dict(params), number, step))
        except OSError:
            # Ended; the listener answers those who asked before it saw that.
            answer.put(NodeFailed(f"node {self.file.stem} has just ended"))
        found = answer.get()
        with self._lock:
            self._answers.pop(number, None)
        if isinstance(found, NodeFailed):
            raise found
        self._inputs.update(inputs)
        self._params.update(params)
        return found

    def _packed(self, ports: str, values: Mapping[str, Any]) -> dict[str, Any]:
        kinds = {port.name: KINDS[port.kind] for port in getattr(self.hello, ports)}
        packed = {}
        for name, value in values.items():
            if name not in kinds:
                raise NodeFailed(f"{ports[:-1]} {name}: there is none; expected one of {', '.join(kinds) or 'none'}")
            try:
                packed[name] = kinds[name].pack(kinds[name].take(value))
            except (ValueError, TypeError, KeyError) as problem:
                raise NodeFailed(
                    f"{ports[:-1]} {name}: got {str(value)[:80]}; expected {kinds[name].expected}"
                ) from problem
        return packed

    def _read(self, stepped: Stepped) -> dict[str, Any]:
        kinds = {port.name: KINDS[port.kind] for port in self.hello.outputs}
        return {name: kinds[name].take(value) for name, value in stepped.outputs.items()}

    # ------------------------------------------------------------------------------------------------------------- watching

    def _listen(self, wire: Wire) -> None:
        last: Any = None
        while True:
            try:
                message = wire.receive(_LOOK_S)
            except EOFError:
                break
            now = time.monotonic()
            if message is not None:
                self._heard = now
            match message:
                case Stepped():
                    self._answer(message.number, message)
                    if message.outputs:
                        self._told(self._read(message))
                case Declined():
                    self._answer(message.number, NodeFailed(message.why))
                case Failed():
                    last = message
                case Beat() if message.busy_s > self.hello.step_limit_s:
                    self._kill(
                        f"has been in one step for {message.busy_s:.1f} s, allowed {self.hello.step_limit_s:g} s"
                    )
                case None if now - self._heard > self._silent_s:
                    self._kill(f"gave no sign of life for {self._silent_s:g} s")
        self._bury(wire, last)

    def _answer(self, number: int, answer: Stepped | NodeFailed) -> None:
        with self._lock:
            waiting = self._answers.get(number)
        if waiting is not None:
            waiting.put(answer)

    def _kill(self, cause: str) -> None:
        self._cause = self._cause or cause
        self.process.kill()

    def _bury(self, wire: Wire, last: Any) -> None:
        failure = self._buried(wire, last, "")
        with self._lock:
            again = self.restarted < self._restarts and not self._closing.is_set()
            if not again:
                self._failure = failure
            waiting, self._answers = list(self._answers.values()), {}
        for answer in waiting:
            answer.put(failure)
        if self._closing.is_set():
            return
        self._ended(failure)
        if again:
            self.restarted += 1
            if self._closing.wait(min(0.1 * 2**self.restarted, 5.0)):
                return
            try:
                self._start()
            except NodeFailed as problem:
                self._failure = problem
                self._ended(problem)

    def _buried(self, wire: Wire, last: Any, otherwise: str) -> NodeFailed:
        """Why its process has ended, or is ended now."""
        if otherwise and self._closing.is_set():
            otherwise = "was not wanted any more"
        if otherwise and self.process.poll() is None and not isinstance(last, Failed):
            with contextlib.suppress(subprocess.TimeoutExpired):
                self.process.wait(0.5)
            if self.process.poll() is None:
                self._cause = otherwise
                self.process.kill()
        status = self.process.wait()
        wire.close()
        name = self.file.stem
        if self._cause:
            return NodeFailed(f"node {name} {self._cause}, and was killed")
        if isinstance(last, Failed):
            return NodeFailed(f"node {name}: {last.why}", last.traceback)
        how = f"was ended by {signal.Signals(-status).name}" if status < 0 else f"ended with status {status}"
        return NodeFailed(f"node {name} {how}")
