"""One process of a node, from its start until it is known why it ended."""

from __future__ import annotations

import contextlib
import os
import queue
import signal
import socket
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from engines.nodes.failure import NodeFailed
from engines.nodes.launcher import LAUNCHER
from engines.nodes.log import NodeLog
from engines.nodes.ports import KINDS
from engines.nodes.reactor import REACTOR
from engines.nodes.wire import Beat, Declined, End, Failed, FromNode, Hello, Noted, Put, Ready, Stepped, Wire
from handrail.usage import Watch

_LOAD_S = 60.0
"""of wall time to import what a node imports: an empty cache, a busy machine"""
_LOOK_S = 0.1
_SAMPLE_S = 1.0
_OVER_SHARE = 1.5
"""times its share that a node may use over the window before it is ended: until there it is asked to rest"""


class Life:
    """A node's process. What comes from it is dealt with in the reactor's thread; what it was asked is answered from any."""

    def __init__(
        self, file: Path, *, said: Callable[[str], None], closing: threading.Event, silent_s: float, window_s: float
    ):
        """Starts it; `load` follows. Raises NodeFailed.

        :param closing: set while it is being loaded: nobody wants it any more
        :param silent_s: wall time without a sign of life, after which it is killed
        :param window_s: over which its share of a core is counted
        """
        self.name, self._closing, self._silent_s, self._window_s = file.stem, closing, silent_s, window_s
        self.log = NodeLog(said)
        ours, theirs = socket.socketpair()
        try:
            self.process = LAUNCHER.start(file.absolute(), theirs, self.log.write_fd)
        except OSError as problem:
            ours.close()
            raise NodeFailed(f"node {self.name} could not be started: {problem}") from problem
        finally:
            theirs.close()
            os.close(self.log.write_fd)
        self._wire = Wire(ours, FromNode)
        self.hello: Hello
        self.watch: Watch | None = None
        self._cause = ""
        self._last: Failed | None = None
        self._heard_at = self._sampled_at = 0.0
        self._answers: dict[int, queue.SimpleQueue[dict[str, Any] | NodeFailed]] = {}
        self._number = 0
        self._lock = threading.Lock()
        self._failure: NodeFailed | None = None
        self.told: Callable[[dict[str, Any]], None] = lambda outputs: None
        self.noted: Callable[[str], None] = lambda text: None
        self.over: Callable[[NodeFailed], None] = lambda failure: None

    def load(self, inputs: Mapping[str, Any], params: Mapping[str, Any], *, fitting: bool = False) -> None:
        """Wait until it has started with these. Raises NodeFailed; then it has ended.

        :param fitting: leave out inputs and parameters that it has not, or not of that kind any more
        """
        hello = self._next()
        if not isinstance(hello, Hello):
            raise self._given_up(hello, f"was not loaded within {_LOAD_S:g} s")
        self.hello = hello
        if fitting:
            inputs, params = self.fitting("inputs", inputs), self.fitting("params", params)
        try:
            first = Put(inputs=self.packed("inputs", inputs), params=dict(params))
        except NodeFailed:
            self._given_up(None, "ended")
            raise
        with contextlib.suppress(OSError):  # it has just ended: why comes next
            self._wire.send(first)
        ready = self._next()
        if isinstance(ready, Declined):
            self._given_up(None, "ended")
            raise NodeFailed(ready.why)
        if not isinstance(ready, Ready):
            raise self._given_up(ready, f"did not start within {_LOAD_S:g} s")
        with contextlib.suppress(OSError):  # it has just ended
            self.watch = Watch(self.process.pid, self._window_s)

    def _next(self) -> Any | None:
        """The next message that is no sign of life; None when it is gone, none came in time, or nobody wants it any more."""
        end = time.monotonic() + _LOAD_S
        try:
            while not self._closing.is_set() and (left := end - time.monotonic()) > 0.0:
                message = self._wire.receive(min(_LOOK_S, left))
                if message is not None and not isinstance(message, Beat | Noted):
                    return message
        except EOFError:
            pass
        return None

    def _given_up(self, last: Any, otherwise: str) -> NodeFailed:
        """Why it did not come up; it is ended now."""
        self._last = last if isinstance(last, Failed) else None
        if self._closing.is_set():
            otherwise = "was not wanted any more"
        if self._last is None:
            try:
                self.process.wait(0.5)
            except TimeoutError:
                self.kill(otherwise)
        return self._buried()

    # ---------------------------------------------------------------------------------------------------------------- doing

    def listen(self) -> None:
        """From now on `told`, `noted` and `over` are called."""
        self._heard_at = self._sampled_at = time.monotonic()
        REACTOR.add(self._wire.socket, self._heard)
        REACTOR.look(self, self._look)
        REACTOR.call(self._deal)  # with what came along with the last that was read

    def ask(self, inputs: Mapping[str, Any], params: Mapping[str, Any], *, step: bool) -> dict[str, Any]:
        """What it wrote in the step, if that was asked for. Raises NodeFailed."""
        packed = self.packed("inputs", inputs)
        answer: queue.SimpleQueue[dict[str, Any] | NodeFailed] = queue.SimpleQueue()
        with self._lock:
            if self._failure is not None:
                raise self._failure
            self._number += 1
            number = self._number
            self._answers[number] = answer
        with contextlib.suppress(OSError):  # it has ended: who hears of that answers
            self._wire.send(Put(packed, dict(params), number, step))
        found = answer.get()
        with self._lock:
            self._answers.pop(number, None)
        if isinstance(found, NodeFailed):
            raise found
        return found

    def end(self) -> None:
        """Ask it to end, and kill it a second later."""
        with contextlib.suppress(OSError):
            self._wire.send(End())
        try:
            self.process.wait(1.0)
        except TimeoutError:
            self.process.kill()
            self.process.wait()

    def kill(self, cause: str) -> None:
        """:param cause: what it did, in words that go after its name"""
        self._cause = self._cause or cause
        self.process.kill()

    def packed(self, ports: str, values: Mapping[str, Any]) -> dict[str, Any]:
        """`inputs` as they travel. Raises NodeFailed naming port, value and expectation."""
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

    def fitting(self, ports: str, values: Mapping[str, Any]) -> dict[str, Any]:
        """Those of the values that its `inputs` or `params` can take by name and kind."""
        kinds = {port.name: KINDS[port.kind] for port in getattr(self.hello, ports)}
        fit = {}
        for name, value in values.items():
            with contextlib.suppress(KeyError, ValueError, TypeError):
                fit[name] = kinds[name].take(value)
        return fit

    def _read(self, stepped: Stepped) -> dict[str, Any]:
        kinds = {port.name: KINDS[port.kind] for port in self.hello.outputs}
        return {name: kinds[name].take(value) for name, value in stepped.outputs.items()}

    # ------------------------------------------------------------------------------------------------------------- watching

    def _heard(self) -> None:
        self._heard_at = time.monotonic()
        try:
            self._wire.read()
        except EOFError:
            REACTOR.remove(self._wire.socket)
            REACTOR.look(self, None)
            # Its status is yet to come, to this very thread.
            threading.Thread(target=self._bury, name=f"end of {self.name}", daemon=True).start()
            return
        self._deal()

    def _deal(self) -> None:
        while (message := self._wire.arrived()) is not None:
            match message:
                case Stepped():
                    outputs = self._read(message)
                    try:
                        if outputs:
                            self.told(outputs)
                    finally:
                        self._answer(message.number, outputs)
                case Declined():
                    self._answer(message.number, NodeFailed(message.why))
                case Failed():
                    self._last = message
                case Noted():
                    self.noted(message.text)
                case Beat() if message.busy_s > self.hello.limits.step_s:
                    self.kill(
                        f"has been in one step for {message.busy_s:.1f} s, allowed {self.hello.limits.step_s:g} s"
                    )

    def _look(self) -> None:
        now = time.monotonic()
        if now - self._heard_at > self._silent_s:
            self.kill(f"gave no sign of life for {self._silent_s:g} s")
        if self.watch is None or now - self._sampled_at < min(_SAMPLE_S, self._window_s / 4):
            return
        self._sampled_at = now
        limits, watch = self.hello.limits, self.watch
        with contextlib.suppress(OSError):  # it has just ended
            watch.sample()
        if watch.own_mb > limits.memory_mb:
            self.kill(f"has {watch.own_mb:.0f} MB of memory of its own, allowed {limits.memory_mb} MB")
        elif watch.whole and watch.share > _OVER_SHARE * limits.cpu_share + 0.02:
            self.kill(
                f"used {100 * watch.share:.0f} % of a core over {self._window_s:g} s, allowed {100 * limits.cpu_share:.0f} %"
            )

    def _answer(self, number: int, answer: dict[str, Any] | NodeFailed) -> None:
        with self._lock:
            waiting = self._answers.get(number)
        if waiting is not None:
            waiting.put(answer)

    def _bury(self) -> None:
        try:
            self.process.wait(0.5)
        except TimeoutError:
            self.kill("let go of its host")
        failure = self._buried()
        with self._lock:
            self._failure = failure
            waiting, self._answers = list(self._answers.values()), {}
        for answer in waiting:
            answer.put(failure)
        self.over(failure)

    def _buried(self) -> NodeFailed:
        """Why it has ended."""
        status = self.process.wait()
        self.log.ended.wait(1.0)
        self._wire.close()
        if self._cause:
            return NodeFailed(f"node {self.name} {self._cause}, and was killed")
        if self._last is not None:
            return NodeFailed(f"node {self.name}: {self._last.why}", self._last.traceback)
        how = f"was ended by {signal.Signals(-status).name}" if status < 0 else f"ended with status {status}"
        return NodeFailed(f"node {self.name} {how}")
