"""A local call service whose handlers may answer later, so that a long plan does not keep a stop waiting."""

from __future__ import annotations

import functools
import queue
import socket
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

import msgspec

from handrail.messages import Ok, Refused
from handrail.topics import RefusedError, Service


class DeferringService(Service):
    """Answers calls like `handrail.topics.Service`; a handler may return a Future of its answer instead.

    Callers make one call at a time on a connection, so answers to different connections may leave in any order.
    """

    def __init__(self, endpoint: str, kinds: Any, handle: Callable[[Any], Any], wake: Wake):
        """`wake` is set when a late answer is ready: then call `poll`."""
        super().__init__(endpoint, kinds, handle)
        self._wake = wake
        self._ready: queue.SimpleQueue[tuple[bytes, msgspec.Struct]] = queue.SimpleQueue()

    def poll(self, timeout_s: float = 0.0) -> int:
        """Handle what has arrived and send what is ready. Returns how many calls were taken."""
        while not self._ready.empty():
            identity, answer = self._ready.get()
            self.socket.send_multipart((identity, msgspec.msgpack.encode(answer)))
        handled = 0
        while self.socket.poll(round(timeout_s * 1000)):
            timeout_s = 0.0
            identity, *frames = self.socket.recv_multipart()
            answer = self._answer(frames)
            if isinstance(answer, Future):
                answer.add_done_callback(functools.partial(self._late, identity))
            else:
                self.socket.send_multipart((identity, msgspec.msgpack.encode(answer)))
            handled += 1
        return handled

    def _late(self, identity: bytes, future: Future[Any]) -> None:
        problem = future.exception()
        if isinstance(problem, RefusedError):
            answer: msgspec.Struct = problem.refusal
        elif problem is not None:
            answer = Refused(message=f"the engine could not carry it out: {type(problem).__name__}: {problem}")
        else:
            answer = future.result() or Ok()
        self._ready.put((identity, answer))
        self._wake.set()


class Wake:
    """Wakes a thread that polls on sockets, from any other thread or a signal handler."""

    def __init__(self) -> None:
        self._reader, self._writer = socket.socketpair()
        self._reader.setblocking(False)
        self._writer.setblocking(False)

    def fileno(self) -> int:
        """To be polled for reading."""
        return self._reader.fileno()

    @property
    def write_fd(self) -> int:
        """For `signal.set_wakeup_fd`: non-blocking."""
        return self._writer.fileno()

    def set(self) -> None:
        """Wake the other side."""
        try:
            self._writer.send(b"\0")
        except OSError:
            # Full of wake-ups that were not read yet, or closed: one more says nothing new.
            return

    def clear(self) -> None:
        """Take the wake-ups so far; call it before looking at what they announce."""
        try:
            while self._reader.recv(4096):
                continue
        except BlockingIOError:
            return

    def close(self) -> None:
        self._reader.close()
        self._writer.close()
