"""A warm process that children are forked from, so that a test's plant and daemon start in a tenth of a second.

    python -m hal.hil.nursery FD

Imports and compiled kernels are paid for once. The children are real processes with a memory of their own: they can be killed,
stopped and started anew. When the one who asks goes away, by whatever death, the nursery ends all of them and then itself.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import importlib
import os
import runpy
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

_MOST = 1 << 16
_PR_SET_PDEATHSIG = 1
_TAIL = 30
_PATIENCE_S = 5.0
_DEATH_S = 60.0
"""after SIGKILL, which nothing refuses; but the kernel takes a process apart only when it gets to it"""


class Warm(msgspec.Struct, tag=True):
    """Import these modules, and call the functions (`module:function`) with their arguments."""

    modules: list[str]
    calls: list[tuple[str, list[str]]] = []


class Start(msgspec.Struct, tag=True):
    """Run a module as `python -m` would; its stdout and stderr go to the file descriptor sent along."""

    module: str
    arguments: list[str]


class Reap(msgspec.Struct, tag=True):
    """How did this child end? Asked after it has."""

    pid: int


class Told(msgspec.Struct):
    """The nursery's answer: a pid, a status, or why not."""

    number: int = 0
    problem: str = ""


_requests = msgspec.json.Decoder(Warm | Start | Reap)
_answers = msgspec.json.Decoder(Told)


class ProcessDied(Exception):
    """A process that should run has ended, or did not say what it should; the text has its last words."""


class Process:
    """A child of the nursery, and every line that it has said."""

    def __init__(self, name: str, pid: int, output: int, nursery: Nursery):
        self.name, self.pid, self._nursery = name, pid, nursery
        self._pidfd = os.pidfd_open(pid)
        self.lines: list[str] = []
        self._changed = threading.Condition()
        self._closed = False
        self._status: int | None = None
        self._reader = threading.Thread(target=self._read, args=(output,), name=f"hil-{name}", daemon=True)
        self._reader.start()

    def _read(self, output: int) -> None:
        with os.fdopen(output, errors="replace") as stream:
            for line in stream:
                with self._changed:
                    self.lines.append(line.rstrip("\n"))
                    self._changed.notify_all()
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    @property
    def alive(self) -> bool:
        return self._status is None and not select.select([self._pidfd], [], [], 0.0)[0]

    def wait_for(self, beginning: str, timeout_s: float = 60.0) -> None:
        """Wait for a line that begins like this. Raises ProcessDied when it ends first, or the line doesn't come in time."""

        def said() -> bool:
            return any(line.startswith(beginning) for line in self.lines)

        with self._changed:
            self._changed.wait_for(lambda: said() or self._closed, timeout_s)
            if not said():
                what = "ended before it said" if self._closed else f"did not say in {timeout_s:g} s"
                raise ProcessDied(f"{self.name} {what} “{beginning}”\n{self.last_words()}")

    def last_words(self) -> str:
        """The end of what it said."""
        return "\n".join(f"  {self.name} | {line}" for line in self.lines[-_TAIL:])

    def send(self, number: signal.Signals) -> None:
        """A signal, if it still runs."""
        if self.alive:
            with contextlib.suppress(ProcessLookupError):
                signal.pidfd_send_signal(self._pidfd, number)

    def wait(self, timeout_s: float) -> int | None:
        """Its exit status (−signal where one ended it); None while it runs."""
        if self._status is None and select.select([self._pidfd], [], [], timeout_s)[0]:
            self._status = self._nursery.ask(Reap(self.pid))
            os.close(self._pidfd)
            self._reader.join(1.0)
        return self._status

    def kill(self) -> int:
        """SIGKILL, as a crash or the machine's memory running out would; its exit status."""
        self.send(signal.SIGKILL)
        status = self.wait(_DEATH_S)
        assert status is not None, f"{self.name} outlives SIGKILL by {_DEATH_S:g} s: {self._threads()}"
        return status

    def _threads(self) -> str:
        """What keeps its threads, as the kernel tells (proc(5), stat and wchan)."""
        told = []
        for thread in sorted(Path(f"/proc/{self.pid}/task").glob("*")):
            with contextlib.suppress(OSError):  # it has ended meanwhile
                state = (thread / "stat").read_text().rpartition(")")[2].split()[0]
                told.append(f"thread {thread.name} {state} in {(thread / 'wchan').read_text() or '?'}")
        return ", ".join(told) or "it has no threads any more"

    def end(self) -> int:
        """SIGTERM, and SIGKILL after a while; its exit status."""
        self.send(signal.SIGCONT)
        self.send(signal.SIGTERM)
        status = self.wait(_PATIENCE_S)
        return self.kill() if status is None else status


class Nursery:
    """This process's end: asks for children. `close` ends all that are left."""

    def __init__(self) -> None:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        os.set_inheritable(theirs.fileno(), True)
        self._socket = ours
        self._lock = threading.Lock()
        self._warmed: set[tuple[str, ...]] = set()
        # A session of its own: Ctrl-C reaches who asks alone, and it ends everything in order.
        self._process = subprocess.Popen(
            [sys.executable, "-m", "hal.hil.nursery", str(theirs.fileno())],
            close_fds=True,
            pass_fds=[theirs.fileno()],
            stdin=subprocess.DEVNULL,
            start_new_session=True,
        )
        theirs.close()

    def ask(self, request: Warm | Start | Reap, descriptors: Sequence[int] = ()) -> int:
        """The number that is answered. Raises ProcessDied where there is none."""
        with self._lock:
            try:
                socket.send_fds(self._socket, [msgspec.json.encode(request)], list(descriptors))
                answer = self._socket.recv(_MOST)
            except OSError as error:
                raise ProcessDied(f"the nursery of the test's processes is gone: {error}") from error
        if not answer:
            raise ProcessDied(f"the nursery of the test's processes ended with status {self._process.poll()}")
        told = _answers.decode(answer)
        if told.problem:
            raise ProcessDied(told.problem)
        return told.number

    def warm(self, modules: Sequence[str], calls: Sequence[tuple[str, Sequence[str]]] = ()) -> None:
        """Import and compile ahead of the first child: once, however often it is asked for."""
        cold = [
            (function, list(arguments)) for function, arguments in calls if (function, *arguments) not in self._warmed
        ]
        modules = [module for module in modules if (module,) not in self._warmed]
        if cold or modules:
            self.ask(Warm(modules, cold))
            self._warmed.update((module,) for module in modules)
            self._warmed.update((function, *arguments) for function, arguments in cold)

    def start(self, name: str, module: str, arguments: Sequence[str]) -> Process:
        """A new process that runs a module."""
        output, write = os.pipe()
        try:
            pid = self.ask(Start(module, list(arguments)), [write])
        except ProcessDied:
            os.close(output)
            raise
        finally:
            os.close(write)
        return Process(name, pid, output, self)

    def close(self) -> None:
        """End it and whatever it has left."""
        self._socket.close()
        try:
            self._process.wait(_PATIENCE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


# --------------------------------------------------------------------------------------------------------- the warm process


def _child(start: Start, output: int) -> None:
    """Becomes `python -m module`; never returns."""
    code = 1
    try:
        os.setpgid(0, 0)
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, signal.SIG_DFL)
        os.dup2(output, 1)
        os.dup2(output, 2)
        sys.argv = [start.module, *start.arguments]
        sys.modules.pop(start.module, None)  # it runs as __main__; all that it imports is warm
        runpy.run_module(start.module, run_name="__main__", alter_sys=True)
        code = 0
    except SystemExit as ended:
        code = ended.code if isinstance(ended.code, int) else int(ended.code is not None)
        if isinstance(ended.code, str):
            print(ended.code, file=sys.stderr)
    except BaseException:  # noqa: BLE001  this is the process's end, its words are what matters
        import traceback

        traceback.print_exc()
    finally:
        with contextlib.suppress(OSError, ValueError):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


def _warm(request: Warm) -> None:
    for module in request.modules:
        importlib.import_module(module)
    for function, arguments in request.calls:
        module, _, name = function.partition(":")
        getattr(importlib.import_module(module), name)(*arguments)
    gc.collect()
    gc.freeze()


class _Server:
    def __init__(self, connection: socket.socket):
        self._connection = connection
        self._children: set[int] = set()

    def _answer(self, request: Any, descriptors: list[int]) -> Told:
        match request:
            case Warm():
                _warm(request)
                return Told()
            case Start():
                sys.stdout.flush()
                sys.stderr.flush()
                pid = os.fork()
                if pid == 0:
                    self._connection.close()
                    _child(request, descriptors[0])
                self._children.add(pid)
                return Told(pid)
            case Reap(pid):
                _, status = os.waitpid(pid, 0)
                self._children.discard(pid)
                return Told(os.waitstatus_to_exitcode(status))
        raise AssertionError(request)

    def serve(self) -> None:
        """Until the other end is closed."""
        while True:
            data, descriptors, _, _ = socket.recv_fds(self._connection, _MOST, 4)
            if not data:
                return
            try:
                told = self._answer(_requests.decode(data), descriptors)
            except Exception as problem:  # noqa: BLE001  the asker has to hear of it, whatever it is
                told = Told(problem=f"{type(problem).__name__}: {problem}")
            finally:
                for descriptor in descriptors:
                    os.close(descriptor)
            self._connection.send(msgspec.json.encode(told))

    def end(self) -> None:
        """No child outlives its tests."""
        watched = {os.pidfd_open(pid): pid for pid in self._children}
        for number, patience in ((signal.SIGTERM, 1.0), (signal.SIGKILL, _PATIENCE_S)):
            for descriptor in watched:
                with contextlib.suppress(ProcessLookupError):
                    signal.pidfd_send_signal(descriptor, number)
            deadline = time.monotonic() + patience
            while watched and (left := deadline - time.monotonic()) > 0:
                for descriptor in select.select(list(watched), [], [], left)[0]:
                    os.waitpid(pid := watched.pop(descriptor), 0)
                    os.close(descriptor)
                    self._children.discard(pid)


def main() -> None:
    """The warm process itself."""
    connection = socket.socket(fileno=int(sys.argv[1]))
    connection.set_inheritable(False)
    server = _Server(connection)
    try:
        server.serve()
    finally:
        server.end()


if __name__ == "__main__":
    main()
