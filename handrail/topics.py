"""Local ZeroMQ: topics (publish, subscribe) and calls, one MessagePack message a frame.

``bus`` always means CAN in this project; what is here carries `handrail.messages` between processes of one machine. A topic is
``[type name, payload]``; a call is ``[payload]`` from a DEALER to a ROUTER and answered by exactly one ``[payload]``, in order.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Any

import msgspec
import zmq

from handrail.messages import Answer, Ok, Refused, spec

_encoder = msgspec.msgpack.Encoder()
_answers = msgspec.msgpack.Decoder(Answer)


class RefusedError(Exception):
    """A call was refused; nothing has changed. `refusal` names field, value and expectation."""

    def __init__(self, refusal: Refused):
        self.refusal = refusal
        parts = [refusal.message]
        if refusal.field:
            told = f"field {refusal.field}, value {refusal.value or 'none'}"
            said = not refusal.expected or f"expected {refusal.expected}" in refusal.message
            parts.append(told if said else f"{told}, expected {refusal.expected}")
        super().__init__("; ".join(parts))


class Unreachable(ConnectionError):
    """No answer in time: the process that should answer is not running, or hangs."""


def refuse(message: str, field: str = "", value: object = "", expected: str = "") -> RefusedError:
    """The error that a call's handler raises to refuse it."""
    return RefusedError(Refused(message=message, field=field, value=str(value) if field else "", expected=expected))


class Publisher:
    """Sends messages on one local topic endpoint. Not safe to share between threads."""

    def __init__(self, endpoint: str, *, context: zmq.Context | None = None, queue: int = 2000):
        self._socket = (context or zmq.Context.instance()).socket(zmq.PUB)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.setsockopt(zmq.SNDHWM, queue)
        self._socket.bind(endpoint)

    def send(self, message: msgspec.Struct) -> None:
        # In two calls: send_multipart looks at every part before, for as long as it then takes to send it.
        self._socket.send(type(message).__name__.encode(), zmq.SNDMORE)
        self._socket.send(_encoder.encode(message))

    def close(self) -> None:
        self._socket.close()


class Subscriber:
    """Receives messages of the given types from one or more endpoints."""

    def __init__(
        self,
        endpoints: str | list[str],
        kinds: Any,
        *,
        context: zmq.Context | None = None,
        queue: int = 5000,
    ):
        """`kinds`: a message type or a union of message types; only these are received."""
        self._decoder = msgspec.msgpack.Decoder(kinds)
        self.socket = (context or zmq.Context.instance()).socket(zmq.SUB)
        self.socket.setsockopt(zmq.LINGER, 0)
        self.socket.setsockopt(zmq.RCVHWM, queue)
        wanted = getattr(kinds, "__args__", (kinds,))
        for kind in wanted:
            # "RobotState" is no prefix of another type's name by chance only: compare whole names in `_arrived`.
            self.socket.subscribe(kind.__name__)
        self._names = {kind.__name__.encode() for kind in wanted}
        self._streams = {kind.__name__.encode() for kind in wanted if spec(kind).superseded_by == ("type",)}
        for endpoint in [endpoints] if isinstance(endpoints, str) else endpoints:
            self.socket.connect(endpoint)

    def receive(self, timeout_s: float | None = None) -> Any | None:
        """The next message, or None when none came in time (None waits for ever, 0 does not wait)."""
        arrived = self._wait(timeout_s)
        return None if arrived is None else self._decoder.decode(arrived[1])

    def drain(self) -> Iterator[Any]:
        """Everything that has arrived."""
        while (arrived := self._arrived()) is not None:
            yield self._decoder.decode(arrived[1])

    def newest(self, timeout_s: float | None = None) -> list[Any]:
        """Waits for a message, then gives all that have arrived; of a stream that is one per type only its latest value."""
        arrived: list[tuple[bytes, bytes]] = []
        message = self._wait(timeout_s)
        while message is not None:
            arrived.append(message)
            message = self._arrived()
        last = {name: place for place, (name, _) in enumerate(arrived)}
        return [
            self._decoder.decode(payload)
            for place, (name, payload) in enumerate(arrived)
            if name not in self._streams or place == last[name]
        ]

    def _wait(self, timeout_s: float | None) -> tuple[bytes, bytes] | None:
        # A read that finds a message leaves ZeroMQ's own work undone, such as subscribing anew at a publisher that came back.
        self.socket.getsockopt(zmq.EVENTS)
        while (arrived := self._arrived()) is None:
            if not self.socket.poll(None if timeout_s is None else max(0, round(timeout_s * 1000))):
                return None
        return arrived

    def _arrived(self) -> tuple[bytes, bytes] | None:
        """(type name, payload) of a message that has arrived. Reads before it asks: a poll costs more than a read."""
        with contextlib.suppress(zmq.Again):
            while True:
                name, payload = self.socket.recv_multipart(zmq.NOBLOCK)
                if name in self._names:
                    return name, payload
        return None

    def close(self) -> None:
        self.socket.close()


class Caller:
    """Calls one local service, one call at a time. Not safe to share between threads: make one a thread."""

    def __init__(self, endpoint: str, *, timeout_s: float = 5.0, context: zmq.Context | None = None):
        self._endpoint, self._timeout_s = endpoint, timeout_s
        self._context = context or zmq.Context.instance()
        self._connect()

    def _connect(self) -> None:
        self._socket = self._context.socket(zmq.DEALER)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.connect(self._endpoint)

    def call(self, message: msgspec.Struct, timeout_s: float | None = None) -> Any:
        """The answer. Raises RefusedError when refused, Unreachable when no answer came in time."""
        self._socket.send(_encoder.encode(message))
        timeout = self._timeout_s if timeout_s is None else timeout_s
        if not self._socket.poll(round(timeout * 1000)):
            # A late answer must not be taken for the next call's: start on a new connection.
            self._socket.close()
            self._connect()
            raise Unreachable(f"{type(message).__name__}: no answer from {self._endpoint} in {timeout:g} s")
        answer = _answers.decode(self._socket.recv())
        if isinstance(answer, Refused):
            raise RefusedError(answer)
        return answer

    def close(self) -> None:
        self._socket.close()


class Service:
    """Answers calls. `poll` handles what has arrived; a handler's RefusedError becomes a refusal, and so does bad input."""

    def __init__(self, endpoint: str, kinds: Any, handle: Callable[[Any], Any], *, context: zmq.Context | None = None):
        """`kinds`: union of the calls taken; `handle(message)` returns the answer, or None for Ok."""
        self._decoder = msgspec.msgpack.Decoder(kinds)
        self._handle = handle
        self.socket = (context or zmq.Context.instance()).socket(zmq.ROUTER)
        self.socket.setsockopt(zmq.LINGER, 0)
        self.socket.bind(endpoint)

    def poll(self, timeout_s: float = 0.0) -> int:
        """Handle all calls that have arrived, waiting at most `timeout_s` for the first. Returns how many."""
        if timeout_s > 0.0:
            self.socket.poll(round(timeout_s * 1000))
        handled = 0
        while True:
            try:
                identity, *frames = self.socket.recv_multipart(zmq.NOBLOCK)
            except zmq.Again:
                return handled
            self.socket.send_multipart((identity, _encoder.encode(self._answer(frames))))
            handled += 1

    def _answer(self, frames: list[bytes]) -> msgspec.Struct:
        if len(frames) != 1:
            return Refused(message="a call is one frame", field="frames", value=str(len(frames)), expected="1")
        try:
            message = self._decoder.decode(frames[0])
        except (msgspec.DecodeError, RecursionError) as error:  # the latter for nesting without end
            return Refused(message=f"not a call that is known here: {error}")
        try:
            return self._handle(message) or Ok()
        except RefusedError as error:
            return error.refusal

    def close(self) -> None:
        with contextlib.suppress(zmq.ZMQError):
            self.socket.close()
