"""A node's process: `python -m engines.nodes.child FILE SOCKET`, started by `engines.nodes.host`."""

from __future__ import annotations

import contextlib
import os
import resource
import socket
import sys
import threading
import time
import traceback
from collections.abc import Mapping
from pathlib import Path

from engines.nodes.node import Node, load
from engines.nodes.ports import MissingError, Param, PortError, _Port
from engines.nodes.wire import Beat, Declined, End, Failed, Hello, PortTold, Put, Ready, Stepped, ToNode, Wire

BEAT_S = 0.2


class Child:
    """One node and the wire to its host. It gives signs of life from the start, before the node is loaded."""

    def __init__(self, wire: Wire):
        self._wire = wire
        self._node: Node
        self._began = 0.0
        self._started = False
        threading.Thread(target=self._beats, name="beats", daemon=True).start()

    def run(self, node: Node) -> None:
        """Until the host ends it or is gone. Raises what the node's code raises."""
        self._node = node
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
            self._step(0)
            # Whole periods are skipped after a step that took longer, and the phase is kept.
            assert every is not None
            now = time.monotonic()
            due = now if every == 0.0 else due + every * max(1, int((now - due) // every) + 1)

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
        self._wire.send(Stepped(number, self._node.take_written(), took))

    def _beats(self) -> None:
        while True:
            began = self._began
            try:
                self._wire.send(Beat(busy_s=time.monotonic() - began if began else 0.0))
            except OSError:
                os._exit(1)  # the host is gone; the main thread may be in an endless import or step
            time.sleep(BEAT_S)


def _told(ports: Mapping[str, _Port]) -> list[PortTold]:
    return [
        PortTold(port.name, port.kind.name, port.doc, port.unit, port.default if isinstance(port, Param) else None)
        for port in ports.values()
    ]


def _resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1]) if Path("/proc/self/statm").exists() else 0
    return pages * resource.getpagesize() / 1e6


def main(file: Path, connection: socket.socket) -> int:
    """Returns the exit status: 1 after the node's code raised."""
    sys.stdout = sys.stderr  # what a node prints is its log
    wire = Wire(connection, ToNode)
    child = Child(wire)
    try:
        kind = load(file)
        resource.setrlimit(resource.RLIMIT_DATA, (kind.memory_mb * 1_000_000,) * 2)
        node = kind()
        doc = (kind.__doc__ or "").strip()
        ports = _told(kind.inputs), _told(kind.outputs), _told(kind.params)
        wire.send(Hello(file.stem, doc, kind.every, kind.step_limit_s, *ports, memory_mb=_resident_mb()))
        child.run(node)
    except Exception as problem:  # noqa: BLE001 (whatever it is, the host tells it)
        why = f"{type(problem).__name__}: {problem}".rstrip(": ")
        with contextlib.suppress(OSError):
            wire.send(Failed(why=why, traceback=traceback.format_exc()))
        return 1
    return 0


if __name__ == "__main__":
    status = main(Path(sys.argv[1]), socket.socket(fileno=int(sys.argv[2])))
    sys.stderr.flush()
    os._exit(status)  # threads that a node left behind don't keep its process
