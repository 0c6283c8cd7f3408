"""A client's connection to a robot's gate: one thread owns the sockets, any number of threads call and listen through it."""

from __future__ import annotations

import contextlib
import logging
import queue
import re
import secrets
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import Any

import msgspec
import zmq
from zmq.utils.monitor import recv_monitor_message

from handrail.link import codec
from handrail.link.events import Events, Live
from handrail.link.keys import ClientKeys
from handrail.link.selections import Part, Selection
from handrail.messages import Refused, spec
from handrail.topics import RefusedError, Unreachable

_log = logging.getLogger("handrail.link")

_MARGIN_S = 1.0
"""the gate gives up on the robot's processes this long before the client gives up on the gate"""
_REJECTED = zmq.EVENT_HANDSHAKE_FAILED_AUTH | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL
_MONITORED = zmq.EVENT_HANDSHAKE_SUCCEEDED | zmq.EVENT_DISCONNECTED | _REJECTED
_RETRY_REJECTED_S = 1.0
_LONG_S = 3600.0
_KIND = re.compile(rb"~?(\w+)")


@dataclass
class _Call:
    number: bytes
    name: str
    priority: int
    payload: bytes
    deadline: float
    timeout_s: float
    answer: Future[Any] = field(default_factory=Future)


class Session:
    """Calls and event streams over one authenticated connection that mends itself.

    A call that could not be sent waits for the connection until its time is up; one that was sent when the connection broke ends
    at once, since nobody can say whether it was carried out.
    """

    def __init__(self, address: str, keys: ClientKeys):
        """`address`: tcp://HOST:PORT of the gate's calls; events come from the next port."""
        self.address, self._keys = address, keys
        host, _, port = address.removeprefix("tcp://").rpartition(":")
        if not address.startswith("tcp://") or not host or not port.isdigit():
            raise ValueError(f"address: {address!r}; expected tcp://HOST:PORT, e.g. tcp://127.0.0.1:47800")
        self._context = zmq.Context()
        self._calls = self._curve_socket(zmq.DEALER)
        self._calls.setsockopt(zmq.IMMEDIATE, 1)
        self._monitor = self._calls.get_monitor_socket(_MONITORED)
        self._events = self._curve_socket(zmq.SUB)
        self._events.setsockopt(zmq.RCVHWM, 0)
        self._wake_in, self._wake_out = self._context.socket(zmq.PAIR), self._context.socket(zmq.PAIR)
        self._wake_in.bind("inproc://wake")
        self._wake_out.connect("inproc://wake")
        self._endpoints = [(self._calls, address), (self._events, f"tcp://{host}:{int(port) + 1}")]
        for socket, endpoint in self._endpoints:
            socket.connect(endpoint)
        self._packer = codec.Packer()
        self._answers = codec.Unpacker(codec.REMOTE_ANSWER, codec.LARGEST_ANSWER)
        self._kinds = {name: codec.Unpacker(kind, codec.LARGEST_ANSWER) for name, kind in codec.REMOTE_EVENTS.items()}
        self._lock = threading.Lock()
        self._next = secrets.randbits(63)
        self._commands: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._unsent: deque[_Call] = deque()
        self._sent: dict[bytes, _Call] = {}
        self._streams: dict[bytes, Events] = {}
        self._choosing: dict[bytes, Events] = {}
        """token → a stream of what was chosen"""
        self._selected: dict[bytes, tuple[codec.Unpacker, list[Events]]] = {}
        """topic → how it is read, and by whom"""
        self._connected = threading.Event()
        self._rejected = False
        self._retry_at = float("inf")
        self._closing = False
        self.sent_bytes = 0
        """of calls, as they crossed the link (without ZeroMQ's own frames: some 40 bytes a call)"""
        self.received_bytes = 0
        """of answers and events"""
        self.received_by_kind: dict[str, int] = {}
        """the same by type of event; answers under the empty name"""
        self._thread = threading.Thread(target=self._run, name="handrail-link", daemon=True)
        self._thread.start()

    def _curve_socket(self, kind: int) -> zmq.Socket:
        socket = self._context.socket(kind)
        for option, value in (
            (zmq.LINGER, 0),
            (zmq.CURVE_SERVERKEY, self._keys.server),
            (zmq.CURVE_PUBLICKEY, self._keys.public),
            (zmq.CURVE_SECRETKEY, self._keys.secret),
            (zmq.HEARTBEAT_IVL, 1000),
            (zmq.HEARTBEAT_TIMEOUT, 5000),
            (zmq.RECONNECT_IVL, 100),
            (zmq.RECONNECT_IVL_MAX, 2000),
        ):
            socket.setsockopt(option, value)
        return socket

    # ------------------------------------------------------------------------------------------------------- any thread

    @property
    def server(self) -> str:
        """The robot's public key (Z85): it tells this robot from others."""
        return self._keys.server.decode("ascii")

    @property
    def connected(self) -> bool:
        """True while the gate is there and knows our key."""
        return self._connected.is_set()

    def wait_connected(self, timeout_s: float) -> None:
        """Raises Unreachable, with what to do, when there is no authenticated connection in time."""
        if not self._connected.wait(timeout_s):
            raise Unreachable(self._why_not(timeout_s))

    def call(self, message: msgspec.Struct, timeout_s: float | None = None) -> Any:
        """The answer to a call. Raises RefusedError, or Unreachable when no answer came."""
        answer = self.ask(message, timeout_s).result()
        if isinstance(answer, Refused):
            raise RefusedError(answer)
        if isinstance(answer, codec.NoAnswer):
            raise Unreachable(answer.message)
        return answer

    def ask(self, message: msgspec.Struct, timeout_s: float | None = None) -> Future[Any]:
        """The answer when it comes, as it comes: it may be Refused or NoAnswer. Unreachable is raised in the future."""
        kind = type(message)
        timeout_s = codec.timeout_s(kind) + _MARGIN_S if timeout_s is None else timeout_s
        with self._lock:
            self._next += 1
            number = self._next.to_bytes(8, "big")
            payload = self._packer.pack(message)
        deadline = time.monotonic() + timeout_s
        call = _Call(number, kind.__name__, spec(kind).priority, payload, deadline, timeout_s)
        call.answer.set_running_or_notify_cancel()  # whoever does not want it any more does not take it back
        self._do(lambda: self._enqueue(call))
        return call.answer

    def listen(self, kinds: tuple[type, ...]) -> Events:
        """A stream of these types of events (`Live` among them, if wanted)."""
        for kind in kinds:
            if kind is not Live and kind.__name__ not in codec.REMOTE_EVENTS:
                raise ValueError(
                    f"events: {kind.__name__} does not travel over the link; it has {', '.join(self._kinds)}"
                )
        token = codec.SYNC + secrets.token_hex(8).encode()
        events = Events(kinds, lambda closed: self._forget(token, closed))
        self._do(lambda: self._subscribe(token, events))
        return events

    def select(self, chosen: Sequence[Selection]) -> Events:
        """A stream of what was chosen: whole events, or `Part`s of them."""
        token = codec.SYNC + secrets.token_hex(8).encode()
        topics = [each.topic() for each in chosen]
        events = Events(
            (*(each.kind for each in chosen), Part), lambda closed: self._deselect_soon(token, topics, closed)
        )
        self._do(lambda: self._select(token, topics, chosen, events))
        return events

    def _deselect_soon(self, token: bytes, topics: list[bytes], events: Events) -> None:
        with contextlib.suppress(Unreachable):
            self._do(lambda: self._deselect(token, topics, events))

    def _forget(self, token: bytes, events: Events) -> None:
        with contextlib.suppress(Unreachable):  # a closed session has forgotten it
            self._do(lambda: self._unsubscribe(token, events))

    def close(self) -> None:
        """Close the connection; open calls end as Unreachable, streams end."""
        if not self._closing:
            self._closing = True
            self._wake()
            self._thread.join()

    def _do(self, command: Callable[[], None]) -> None:
        with self._lock:  # what is put here before `_end` has the lock is still carried out by it
            if self._closing:
                raise Unreachable(f"{self.address}: this client is closed")
            self._commands.put(command)
        self._wake()

    def _wake(self) -> None:
        with (
            self._lock,
            contextlib.suppress(zmq.ZMQError),
        ):  # a full pipe is awake already; a closed one needs no waking
            self._wake_out.send(b"", zmq.NOBLOCK)

    def _why_not(self, waited_s: float) -> str:
        folder = self._keys.folder
        if self._rejected:
            own = f"{folder / 'client.key'}" if folder else "this client's public key"
            return f"{self.address}: the gate does not know this client; copy {own} to the robot as allowed/NAME.key"
        return (
            f"{self.address}: no gate answered in {waited_s:g} s. Is the robot up (`handrail up ROBOT`)? Is the address right? "
            f"Is {folder / 'server.key' if folder else 'the server key'} that robot's?"
        )

    # ------------------------------------------------------------------------------------------------ the session's thread

    def _run(self) -> None:
        try:
            poller = zmq.Poller()
            for socket in (self._wake_in, self._calls, self._monitor, self._events):
                poller.register(socket, zmq.POLLIN)
            while not self._closing:
                poller.poll(self._until_next_deadline())
                self._turn()
        finally:
            self._end()

    def _turn(self) -> None:
        _swallow(self._wake_in)
        # Answers before the news that the connection broke: one may have come just before.
        self._take_answers()
        self._take_connection_news()
        self._take_events()
        while not self._commands.empty():
            self._commands.get()()
        self._send()
        self._give_up_late_calls()
        if time.monotonic() >= self._retry_at:
            self._connect_anew()

    def _until_next_deadline(self) -> int:
        first = min([self._retry_at, *(call.deadline for call in (*self._unsent, *self._sent.values()))])
        return round(max(0.0, min(_LONG_S, first - time.monotonic())) * 1000) + 1

    def _enqueue(self, call: _Call) -> None:
        if call.priority == 0:
            self._unsent.appendleft(call)
        else:
            self._unsent.append(call)

    def _send(self) -> None:
        while self._unsent:
            call = self._unsent[0]
            try:
                self._calls.send_multipart((call.number, call.payload), zmq.NOBLOCK)
            except zmq.Again:
                return
            self._sent[call.number] = self._unsent.popleft()
            self.sent_bytes += len(call.number) + len(call.payload)

    def _take_answers(self) -> None:
        for number, payload in _received(self._calls, 2):
            self._count("", len(number) + len(payload))
            call = self._sent.pop(number, None)
            if call is None:
                continue  # its caller has given up
            try:
                call.answer.set_result(self._answers.unpack(payload))
            except codec.Malformed as problem:
                call.answer.set_exception(
                    Unreachable(f"{call.name}: the gate answered what this version does not understand: {problem}")
                )

    def _count(self, kind: str, size: int) -> None:
        self.received_bytes += size
        self.received_by_kind[kind] = self.received_by_kind.get(kind, 0) + size

    def _take_connection_news(self) -> None:
        while self._monitor.poll(0):
            event = recv_monitor_message(self._monitor)["event"]
            if event == zmq.EVENT_HANDSHAKE_SUCCEEDED:
                self._rejected = False
                self._connected.set()
                self._retry_at = float("inf")
            elif event & _REJECTED:
                self._rejected = event == zmq.EVENT_HANDSHAKE_FAILED_AUTH
                self._retry_at = time.monotonic() + _RETRY_REJECTED_S
            elif event == zmq.EVENT_DISCONNECTED:
                self._connected.clear()
                for call in self._sent.values():
                    call.answer.set_exception(
                        Unreachable(
                            f"{call.name}: the connection to {self.address} broke before the answer; "
                            "it may or may not have been carried out"
                        )
                    )
                self._sent.clear()

    def _connect_anew(self) -> None:
        # ZeroMQ gives up on a peer that turned it away; the key may be let in by now, or another gate listen there.
        self._retry_at = float("inf")
        for socket, endpoint in self._endpoints:
            with contextlib.suppress(zmq.ZMQError):  # it has gone already
                socket.disconnect(endpoint)
            socket.connect(endpoint)

    def _take_events(self) -> None:
        for name, payload in _received(self._events, 2):
            self._count(_kind_in(name), len(name) + len(payload))
            if (events := self._streams.get(name) or self._choosing.get(name)) is not None:
                events._went_live()
                continue
            if name in self._selected:
                self._take_selected(name, payload)
                continue
            unpacker = self._kinds.get(name.decode("ascii", "replace"))
            if unpacker is None:
                continue
            try:
                event = unpacker.unpack(payload)
            except codec.Malformed as problem:
                _log.error("an event that this version does not understand: %s: %s", name.decode(), problem)
                continue
            for events in self._streams.values():
                if type(event) in events.kinds:
                    events._put(event)

    def _take_selected(self, topic: bytes, payload: bytes) -> None:
        unpacker, listeners = self._selected[topic]
        try:
            event = unpacker.unpack(payload)
        except codec.Malformed as problem:
            _log.error("a selection that this version does not understand: %s: %s", topic.decode(), problem)
            return
        for events in listeners:
            events._put(event)

    def _subscribe(self, token: bytes, events: Events) -> None:
        self._streams[token] = events
        for kind in events.kinds:
            if kind is not Live:
                self._events.subscribe(kind.__name__)
        # Subscriptions travel in order: when the gate echoes this one, those before it are in force.
        self._events.subscribe(token)

    def _select(self, token: bytes, topics: list[bytes], chosen: Sequence[Selection], events: Events) -> None:
        self._choosing[token] = events
        for topic, each in zip(topics, chosen, strict=True):
            kind = Part if each.fields else each.kind
            _, listeners = self._selected.setdefault(topic, (codec.Unpacker(kind, codec.LARGEST_ANSWER), []))
            listeners.append(events)
            self._events.subscribe(topic)
        self._events.subscribe(token)

    def _deselect(self, token: bytes, topics: list[bytes], events: Events) -> None:
        self._choosing.pop(token, None)
        self._events.unsubscribe(token)
        for topic in topics:
            self._events.unsubscribe(topic)
            _, listeners = self._selected[topic]
            listeners.remove(events)
            if not listeners:
                del self._selected[topic]

    def _unsubscribe(self, token: bytes, events: Events) -> None:
        self._streams.pop(token, None)
        self._events.unsubscribe(token)
        for kind in events.kinds:
            if kind is not Live:  # ZeroMQ counts subscriptions: those of other streams stay
                self._events.unsubscribe(kind.__name__)

    def _give_up_late_calls(self) -> None:
        now = time.monotonic()
        for call in [call for call in (*self._unsent, *self._sent.values()) if call.deadline <= now]:
            if self._sent.pop(call.number, None):
                problem = f"{self.address} did not answer in {call.timeout_s:g} s; it may still be carried out"
            else:
                self._unsent.remove(call)
                problem = self._why_not(call.timeout_s)
            call.answer.set_exception(Unreachable(f"{call.name}: {problem}"))

    def _end(self) -> None:
        with self._lock:
            self._closing = True
        while not self._commands.empty():
            self._commands.get()()
        for call in (*self._unsent, *self._sent.values()):
            call.answer.set_exception(Unreachable(f"{call.name}: this client was closed"))
        for events in (*self._streams.values(), *self._choosing.values()):
            events._end()
        self._calls.disable_monitor()
        with self._lock:
            self._context.destroy(linger=0)


def _kind_in(topic: bytes) -> str:
    """The type of event that a topic, or a selection, is of; `sync` for what is said of streams themselves."""
    found = _KIND.match(topic)
    return found[1].decode() if found else "sync"


def _received(socket: zmq.Socket, frames: int) -> list[list[bytes]]:
    """All messages of that many frames that have arrived."""
    messages = []
    with contextlib.suppress(zmq.Again):
        while True:
            message = socket.recv_multipart(zmq.NOBLOCK)
            if len(message) == frames:
                messages.append(message)
    return messages


def _swallow(socket: zmq.Socket) -> None:
    with contextlib.suppress(zmq.Again):
        while True:
            socket.recv(zmq.NOBLOCK)
