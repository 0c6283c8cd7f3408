"""What a node's process does: load its file, step, tell. Forked by `engines.nodes.warm`, listened to by `engines.nodes.host`."""

from __future__ import annotations

import contextlib
import math
import os
import resource
import socket
import sys
import threading
import time
import traceback
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from engines.nodes import composite
from engines.nodes.node import Node, load
from engines.nodes.pace import TELL_S, Rates, Share
from engines.nodes.ports import MissingError, Output, Param, PortError, _Port
from engines.nodes.shared import BLOCKS
from engines.nodes.wire import (
    Beat,
    Declined,
    End,
    Failed,
    Hello,
    Limits,
    Noted,
    PortTold,
    Put,
    Ready,
    Stepped,
    ToNode,
    Wire,
)
from handrail import workspace
from handrail.config import ConfigError

BEAT_S = 0.4
_PAGE = resource.getpagesize()


class Child:
    """One node and the wire to its host. It gives signs of life from the start, before the node is loaded."""

    def __init__(self, wire: Wire):
        self._wire = wire
        self._node: Node
        self._began = 0.0
        self._started = False
        self._left_out_at: dict[str, float] = {}
        threading.Thread(target=self._beats, name="beats", daemon=True).start()

    def run(self, node: Node) -> None:
        """Until the host ends it or is gone. Raises what the node's code raises."""
        self._node = node
        self._rates = Rates({port.name: port.rate for port in node.outputs.values()}, self._note)
        share = Share(node.cpu_share, self._note)
        due = time.monotonic()
        while True:
            every = type(self._node).every if self._started else None
            wait = None if every is None else max(0.0, due - time.monotonic())
            try:
                message = self._wire.receive(wait)
            except EOFError:
                return
            if isinstance(message, End):
                return
            if isinstance(message, Put):
                self._put(message)
                continue
            began, used = time.monotonic(), time.process_time()
            self._step(0)
            # Whole periods are skipped after a step that took longer, and the phase is kept.
            assert every is not None
            now = time.monotonic()
            due = now if every == 0.0 else due + every * max(1, int((now - due) // every) + 1)
            due = share.rest_until(began, time.process_time() - used, due)

    def _put(self, put: Put) -> None:
        before = dict(self._node.values)
        try:
            self._node.put("params", put.params)
            self._node.put("inputs", put.inputs)
        except PortError as problem:
            self._node.values = before
            self._wire.send(Declined(put.number, str(problem)))
            return
        if not self._started:
            self._node.start()
            self._started = True
            self._wire.send(Ready())
        elif put.step:
            self._step(put.number)
        else:
            self._wire.send(Stepped(put.number, {}, 0.0))

    def _step(self, number: int) -> None:
        self._began = time.monotonic()
        try:
            self._node.step()
        except MissingError as problem:
            if number:  # a node that steps by itself waits for its inputs
                self._wire.send(Declined(number, str(problem)))
            return
        finally:
            took, self._began = time.monotonic() - self._began, 0.0
        if number:
            self._wire.send(Stepped(number, self._node.take_written(), took))
            return
        due = self._rates.due(self._node.written, time.monotonic())
        self._node.written.clear()
        if not due:
            return
        now = time.monotonic()
        for name in self._wire.send(Stepped(0, self._node.packed(due), took), leave_out=True):
            if now - self._left_out_at.get(name, -TELL_S) >= TELL_S:
                self._left_out_at[name] = now
                self._note(
                    f"output {name}: whoever got it still looks at {BLOCKS} of its arrays: newer ones are left out"
                )

    def _note(self, text: str) -> None:
        self._wire.send(Noted(text))

    def _beats(self) -> None:
        while True:
            began = self._began
            now = time.monotonic()
            if began or now - self._wire.sent_at >= BEAT_S:
                try:
                    self._wire.send(Beat(busy_s=now - began if began else 0.0))
                except OSError:
                    os._exit(1)  # the host is gone; the main thread may be in an endless import or step
            time.sleep(BEAT_S)


def _told(ports: Mapping[str, _Port]) -> list[PortTold]:
    return [
        PortTold(
            port.name,
            port.kind.name,
            port.doc,
            port.unit,
            port.default if isinstance(port, Param) else None,
            port.rate if isinstance(port, Output) else None,
            **(_bounds(port) if isinstance(port, Param) else {}),
        )
        for port in ports.values()
    ]


def _bounds(port: Param) -> dict[str, Any]:
    low, high = (bound if math.isfinite(bound) else None for bound in (port.low, port.high))
    return {"low": low, "high": high, "choices": port.choices}


def _limit(kind: type[Node]) -> None:
    """What the kernel holds: memory beyond what was there after its imports is refused to the node when it asks for it."""
    data = int(Path("/proc/self/statm").read_text().split()[5]) * _PAGE
    resource.setrlimit(resource.RLIMIT_DATA, (data + kind.memory_mb * 1_000_000,) * 2)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    os.nice(kind.nice)


def main(file: Path, connection: socket.socket) -> int:
    """Returns the exit status: 1 after the node's code raised."""
    sys.stdout = sys.stderr  # what a node prints is its log
    wire = Wire(connection, ToNode)
    child = Child(wire)
    sys.path.append(str(file.parent))  # for the modules beside it
    if (release := workspace.release_of(file)) is not None:
        workspace.use(release)  # a composite's parts are of the release that it is of
    try:
        kind = composite.read(file) if file.suffix == ".yaml" else load(file)
        _limit(kind)
        node = kind()
        doc = (kind.__doc__ or "").strip()
        ports = _told(kind.inputs), _told(kind.outputs), _told(kind.params)
        limits = Limits(kind.step_limit_s, kind.memory_mb, kind.cpu_share, kind.restarts)
        wire.send(Hello(file.stem, doc, kind.every, limits, *ports, process=os.getpid()))
        child.run(node)
    except ConfigError as problem:  # a composite's file: it says where
        with contextlib.suppress(OSError):
            wire.send(Failed(why=str(problem), traceback=""))
        return 1
    except Exception as problem:  # noqa: BLE001 (whatever it is, the host tells it)
        notes = "".join(f" ({note})" for note in getattr(problem, "__notes__", ()))
        why = f"{type(problem).__name__}: {problem}".rstrip(": ") + notes
        with contextlib.suppress(OSError):
            wire.send(Failed(why=why, traceback=traceback.format_exc()))
        return 1
    return 0
