"""The warm process that nodes are forked from: `python -m engines.nodes.warm CALLS ENDS`, started by `engines.nodes.launcher`.

It has imported what every node imports, has one thread, and runs no node's code itself: what it forks shares its memory until it
writes to it. When its host is gone it ends, and the kernel ends its nodes with it.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import select
import signal
import socket
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from engines.nodes import child
from handrail import workspace

_PR_SET_PDEATHSIG, _PR_SET_NAME = 1, 15
_LONGEST = 1 << 20


class Fork(msgspec.Struct):
    """To the warm process, with two descriptors: the node's end of the wire, and where its log goes."""

    file: str
    folder: str
    """in which the node works"""
    environment: dict[str, str]
    deployed: str = ""
    """folder in which nodes are looked for first"""


class Forked(msgspec.Struct):
    """From it, on the same socket."""

    process: int


class Ended(msgspec.Struct):
    """From it, on the socket of ends."""

    process: int
    status: int
    """as `os.waitstatus_to_exitcode` has it"""


def serve(calls: socket.socket, ends: socket.socket) -> None:
    """Fork what is asked for until the host closes its end."""
    wake_read, wake_write = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
    watched: list[Any] = [calls, wake_read]
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.set_wakeup_fd(wake_write, warn_on_full_buffer=False)
    decoder = msgspec.msgpack.Decoder(Fork)
    libc = ctypes.CDLL(None)
    libc.prctl(_PR_SET_NAME, b"warm nodes")
    # What is there now is every node's: a collection that walked it would copy its pages into each of them.
    gc.collect()
    gc.freeze()
    while True:
        ready = select.select(watched, [], [])[0]
        if wake_read in ready:
            with contextlib.suppress(BlockingIOError):
                os.read(wake_read, 4096)
            _reap(ends)
        if calls not in ready:
            continue
        request, descriptors, _flags, _address = socket.recv_fds(calls, _LONGEST, 2)
        if not request:
            return
        me = os.getpid()
        process = os.fork()
        if process == 0:
            libc.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
            if os.getppid() != me:
                os._exit(1)
            signal.set_wakeup_fd(-1)
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            for each in (calls.fileno(), ends.fileno(), wake_read, wake_write):
                os.close(each)
            _become(decoder.decode(request), *descriptors)
        for each in descriptors:
            os.close(each)
        calls.send(msgspec.msgpack.encode(Forked(process)))


def _reap(ends: socket.socket) -> None:
    while True:
        try:
            dead = os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG | os.WNOWAIT)
        except ChildProcessError:
            return
        if dead is None:
            return
        process = dead.si_pid
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process, signal.SIGKILL)  # what it has left behind: the number is its own until it is waited for
        status = os.waitpid(process, 0)[1]
        with contextlib.suppress(OSError):  # the host has just gone
            ends.send(msgspec.msgpack.encode(Ended(process, os.waitstatus_to_exitcode(status))))


def _become(order: Fork, wire: int, log: int) -> None:
    """Never returns."""
    status = 1
    try:
        name = Path(order.file).stem.encode()
        ctypes.CDLL(None).prctl(_PR_SET_NAME, name)  # what `handrail top`, ps and top call it
        os.setsid()  # a group of its own: what it starts is ended with it, and Ctrl-C is its host's
        for stream in (1, 2):
            os.dup2(log, stream)
        os.close(log)
        os.environ.clear()
        os.environ.update(order.environment)
        with contextlib.suppress(OSError):
            os.chdir(order.folder)
        workspace.use(Path(order.deployed) if order.deployed else None)
        status = child.main(Path(order.file), socket.socket(fileno=wire))
        sys.stderr.flush()
    finally:
        os._exit(status)  # threads that a node left behind don't keep its process


def environment(given: Mapping[str, str]) -> dict[str, str]:
    """A node has a core at most: threads of linear algebra would only steal from the others."""
    return {**given, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    serve(socket.socket(fileno=int(sys.argv[1])), socket.socket(fileno=int(sys.argv[2])))
