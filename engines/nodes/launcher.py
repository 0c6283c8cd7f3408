"""Nodes' processes as their host has them: forked from one warm process that is started with the first (`engines.nodes.warm`)."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import msgspec

from engines.nodes.reactor import REACTOR
from engines.nodes.warm import Ended, Fork, Forked, environment
from handrail import workspace

_START_S = 120.0
"""of wall time until the warm process has imported what nodes share: an empty cache, a busy machine"""


class NodesProcess:
    """A forked process: what `subprocess.Popen` tells of its own."""

    def __init__(self, pid: int):
        self.pid = pid
        self._status: int | None = None
        self._ended = threading.Event()
        self._lock = threading.Lock()
        self._pidfd: int | None = None
        with contextlib.suppress(ProcessLookupError):  # it has ended already
            self._pidfd = os.pidfd_open(pid)

    def poll(self) -> int | None:
        """Its exit status, negative after a signal; None while it runs."""
        return self._status

    def wait(self, timeout_s: float | None = None) -> int:
        """Its exit status. Raises TimeoutError. Not for the reactor's thread, which is the one that hears of it."""
        if not self._ended.wait(timeout_s):
            raise TimeoutError(f"process {self.pid} runs on after {timeout_s:g} s")
        assert self._status is not None
        return self._status

    def kill(self) -> None:
        """It; the warm process then ends what it has started."""
        with self._lock, contextlib.suppress(ProcessLookupError):
            if self._pidfd is not None:
                signal.pidfd_send_signal(self._pidfd, signal.SIGKILL)

    def ended(self, status: int) -> None:
        """Told by the launcher."""
        self._status = status
        with self._lock:
            if self._pidfd is not None:
                os.close(self._pidfd)
            self._pidfd = None
        self._ended.set()


class _Warm:
    """The warm process. It ends when nobody has its other end any more."""

    def __init__(self, gone: Callable[[_Warm], None]):
        self._calls, calls = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._ends, ends = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._gone = gone
        self._running: dict[int, NodesProcess] = {}
        self._dead = False
        self._early: dict[int, int] = {}
        """statuses of those that ended before their start was known here"""
        self._lock = threading.Lock()
        self._calling = threading.Lock()
        numbers = (calls.fileno(), ends.fileno())
        self.process = subprocess.Popen(
            [sys.executable, "-m", "engines.nodes.warm", *map(str, numbers)],
            pass_fds=numbers,
            stdin=subprocess.DEVNULL,
            env=environment(os.environ),
            start_new_session=True,
        )
        calls.close()
        ends.close()
        self._calls.settimeout(_START_S)
        REACTOR.add(self._ends, self._heard)

    def fork(self, file: Path, wire: socket.socket, log: int) -> NodesProcess:
        """Raises OSError when the warm process has ended."""
        deployed = workspace.deployed()
        order = Fork(str(file), os.getcwd(), environment(os.environ), str(deployed) if deployed else "")
        with self._calling:
            socket.send_fds(self._calls, [msgspec.msgpack.encode(order)], [wire.fileno(), log])
            answer = self._calls.recv(4096)
        if not answer:
            raise ConnectionResetError("the warm process has ended")
        process = NodesProcess(msgspec.msgpack.decode(answer, type=Forked).process)
        with self._lock:
            status = self._early.pop(process.pid, -signal.SIGKILL if self._dead else None)
            if status is None:
                self._running[process.pid] = process
        if status is not None:
            process.ended(status)
        return process

    def _heard(self) -> None:
        message = self._ends.recv(4096)
        if not message:
            self._lost()
            return
        told = msgspec.msgpack.decode(message, type=Ended)
        with self._lock:
            process = self._running.pop(told.process, None)
            if process is None:
                self._early[told.process] = told.status
        if process is not None:
            process.ended(told.status)

    def _lost(self) -> None:
        """It has ended, and the kernel has ended all that it forked."""
        REACTOR.remove(self._ends)
        self._ends.close()
        self._calls.close()
        self._gone(self)
        self.process.wait()
        with self._lock:
            running, self._running, self._dead = self._running, {}, True
        for process in running.values():
            process.ended(-signal.SIGKILL)


class Launcher:
    """Starts nodes, and the warm process when there is none. From any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._warm: _Warm | None = None

    @property
    def warm_process(self) -> int | None:
        """Its number; None: no node has been started, or it has ended."""
        with self._lock:
            return None if self._warm is None else self._warm.process.pid

    def start(self, file: Path, wire: socket.socket, log: int) -> NodesProcess:
        """A new process that runs the node of `file`; it has copies of `wire` and `log`. Raises OSError."""
        for again in (True, False):
            with self._lock:
                warm = self._warm = self._warm or _Warm(self._forget)
            try:
                return warm.fork(file, wire, log)
            except OSError:
                self._forget(warm)
                warm.process.kill()
                if not again:
                    raise
        raise AssertionError

    def _forget(self, warm: _Warm) -> None:
        with self._lock:
            if self._warm is warm:
                self._warm = None


LAUNCHER = Launcher()
"""of this process"""
