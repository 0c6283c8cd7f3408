"""The gate's side of a local service: calls passed on to the daemon or the engine, whatever becomes of it meanwhile."""

from __future__ import annotations

import asyncio
import contextlib

import zmq
import zmq.asyncio
from zmq.utils.monitor import parse_monitor_message

_CONNECT_S = 0.5


class Gone(Exception):
    """Nobody answered; the text says whether the call may have been carried out."""


class _Connection:
    """One DEALER that carries one call at a time, so that an answer can't be taken for another call's."""

    def __init__(self, context: zmq.asyncio.Context, endpoint: str):
        self.socket = context.socket(zmq.DEALER)
        self.socket.setsockopt(zmq.LINGER, 0)
        # Nothing is queued for a service that is down: it must not act on an old command when it comes up again.
        self.socket.setsockopt(zmq.IMMEDIATE, 1)
        self.socket.setsockopt(zmq.RECONNECT_IVL, 50)
        self.monitor = self.socket.get_monitor_socket(zmq.EVENT_DISCONNECTED)
        self.socket.connect(endpoint)

    def close(self) -> None:
        with contextlib.suppress(zmq.ZMQError):
            self.socket.disable_monitor()
        self.monitor.close(0)
        self.socket.close(0)


class Backend:
    """A local service (`handrail.topics.Service`) that may die and come back at any time."""

    def __init__(self, context: zmq.asyncio.Context, endpoint: str, name: str):
        """`name`: what people call the process that answers, e.g. ``daemon``."""
        self._context, self._endpoint, self._name = context, endpoint, name
        self._idle: list[_Connection] = []

    async def call(self, encoded: bytes, timeout_s: float) -> bytes:
        """The service's answer, as it came. Raises Gone."""
        connection = self._idle.pop() if self._idle else _Connection(self._context, self._endpoint)
        try:
            answer = await self._exchange(connection, encoded, timeout_s)
        except BaseException:
            connection.close()
            raise
        self._idle.append(connection)
        return answer

    async def _exchange(self, connection: _Connection, encoded: bytes, timeout_s: float) -> bytes:
        if not await connection.socket.poll(round(_CONNECT_S * 1000), zmq.POLLOUT):  # type: ignore[call-arg]
            raise Gone(f"the {self._name} is not running; nothing was done")
        await self._forget_old_disconnects(connection)
        await connection.socket.send(encoded)
        answer = asyncio.ensure_future(connection.socket.recv_multipart())
        died = asyncio.ensure_future(connection.monitor.recv_multipart())
        try:
            done, _ = await asyncio.wait({answer, died}, timeout=timeout_s, return_when=asyncio.FIRST_COMPLETED)
            if answer in done:
                frames = answer.result()
                if len(frames) == 1:
                    return frames[0]
                raise Gone(f"the {self._name} answered with {len(frames)} frames, expected 1")
            if died in done:
                raise Gone(f"the {self._name} died before it answered; the call may or may not have been carried out")
            raise Gone(f"the {self._name} did not answer in {timeout_s:g} s; the call may still be carried out")
        finally:
            for future in (answer, died):
                future.cancel()

    async def _forget_old_disconnects(self, connection: _Connection) -> None:
        while await connection.monitor.poll(0):
            parse_monitor_message(await connection.monitor.recv_multipart())

    def close(self) -> None:
        """Close idle connections (those in use close with their call)."""
        for connection in self._idle:
            connection.close()
        self._idle.clear()
