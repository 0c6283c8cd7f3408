"""Engines that run on other machines, as the robot's side has them: a call service and a topic in the runtime folder, as of any.

Who looks for engines there, the gate itself and the recorder among them, finds them and need not know. An engine whose link is cut
goes as one that was killed does, and comes back when it asks again.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import secrets
from pathlib import Path

import msgspec
import zmq
import zmq.asyncio

from handrail.engines import FIRST, checked, lock
from handrail.link import codec
from handrail.messages import (
    CallForEngine,
    CallsForEngine,
    EngineInfo,
    EngineSays,
    FetchCalls,
    Message,
    Refused,
    Said,
)
from handrail.runtime import Runtime
from handrail.sole_holder import HeldElsewhere, sole_holder
from handrail.topics import refuse

_log = logging.getLogger("handrail.link")

_WAIT_S = 0.5
"""how long a call to fetch waits for something"""
_SILENT_S = 3.0
"""an engine that has not asked for so long has gone"""
_OPEN_CALLS = 1000
_encoder = msgspec.msgpack.Encoder()


class _Guest:
    """One engine's place."""

    def __init__(self, runtime: Runtime, context: zmq.asyncio.Context, name: str, process: str):
        """Raises HeldElsewhere where an engine of that name runs on the robot."""
        self.name, self.process = name, process
        self._file = Path(lock(runtime, name))
        self._held = contextlib.ExitStack()
        self._held.enter_context(sole_holder(self._file))
        self._service, self._topic = context.socket(zmq.ROUTER), context.socket(zmq.XPUB)
        for socket, endpoint in ((self._service, "call"), (self._topic, "events")):
            socket.setsockopt(zmq.LINGER, 0)
            socket.bind(runtime.endpoint(f"{name}.{endpoint}"))
        self._count = secrets.randbits(40)  # an answer to a call from before the link was cut answers nothing
        self._callers: dict[int, bytes] = {}
        self._waiting: list[CallForEngine] = []
        self._something = asyncio.Event()
        self.heard_s = asyncio.get_running_loop().time()
        self._closed, self._listened = False, asyncio.Event()
        """the gate hears its events: what came back with the line must not leave before"""
        self._work = [asyncio.create_task(self._take()), asyncio.create_task(self._take_subscriptions())]

    async def _take(self) -> None:
        while True:
            identity, *frames = await self._service.recv_multipart()
            self._count += 1
            self._callers[self._count] = identity
            if len(self._callers) > _OPEN_CALLS:
                del self._callers[next(iter(self._callers))]  # whoever asked has long given up
            self._waiting.append(CallForEngine(self._count, b"".join(frames)))
            self._something.set()

    async def _take_subscriptions(self) -> None:
        wanted: set[bytes] = set()
        while True:
            message = await self._topic.recv()
            wanted.add(message[1:])
            if wanted >= {name.encode() for name in codec.REMOTE_EVENTS}:
                self._listened.set()

    async def fetch(self) -> list[CallForEngine]:
        """What it is called for, as soon as there is something."""
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self._something.wait(), _WAIT_S)
        calls, self._waiting = self._waiting, []
        self._something.clear()
        return calls

    async def answered(self, number: int, payload: bytes) -> None:
        """Pass on what it answers to a call; nobody asked: it is nobody's."""
        if (identity := self._callers.pop(number, None)) is not None and not self._closed:
            await self._service.send_multipart((identity, payload))

    async def tell(self, event: str, payload: bytes) -> None:
        """Pass on an event; what is none is logged. Raises RefusedError where nobody hears it yet, or any more."""
        if problem := self._no_event(event, payload):
            _log.warning("the engine %s told what is not passed on: %s", self.name, problem)
            return
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self._listened.wait(), _SILENT_S)
        if self._closed or not self._listened.is_set():
            raise refuse(f"nobody hears the engine {self.name} now: it has to say so again")
        await self._topic.send_multipart((event.encode(), payload))

    def _no_event(self, name: str, payload: bytes) -> str:
        """Why it is no event that this engine may tell."""
        kind = codec.GUEST_EVENTS.get(name)
        if kind is None:
            return f"{name[:80]!r}; expected one of {', '.join(codec.GUEST_EVENTS)}"
        try:
            event: object = msgspec.msgpack.decode(payload, type=kind)
        except (msgspec.DecodeError, RecursionError) as problem:
            return f"{name}: {problem}"
        if isinstance(event, EngineInfo) and event.name != self.name:
            return f"EngineInfo of {event.name!r}; expected {self.name}"
        return ""

    def close(self) -> None:
        """It has gone."""
        self._closed = True
        self._listened.set()  # for who waits to tell something
        for task in self._work:
            task.cancel()
        self._service.close(0)
        self._topic.close(0)
        os.truncate(self._file, 0)  # it names this process, which lives on
        self._held.close()


class _Saying:
    """How far what an engine's process says has come. It outlasts the engine's place, so that nothing is lost or said twice where
    the place is given up in the middle of a batch.
    """

    def __init__(self, process: str):
        self.process = process
        self.lock = asyncio.Lock()
        """what is said stays in order, whatever it waits for"""
        self._batch, self._passed_on = 0, 0
        """the newest batch, and how much of it was passed on"""
        self._pieces = bytearray()

    async def take(self, call: EngineSays, guest: _Guest) -> None:
        """Pass on what has not been, in order. Raises RefusedError: what is left has to be said again."""
        if call.batch > self._batch:
            self._batch, self._passed_on = call.batch, 0
        elif call.batch < self._batch:
            return
        for said in call.said[self._passed_on :]:
            await self._take(said, guest)
            self._passed_on += 1

    async def _take(self, said: Said, guest: _Guest) -> None:
        if not said.piece:
            self._pieces.clear()  # the line may have been cut between two
        if said.more:
            if len(self._pieces) <= codec.LARGEST_ANSWER:  # the piece that goes beyond it tells that it was too long
                self._pieces += said.payload
            return
        whole = bytes(self._pieces) + said.payload
        if too_long := len(whole) > codec.LARGEST_ANSWER:
            problem = f"the engine {guest.name} said more than the link carries at once: {codec.LARGEST_ANSWER} bytes"
            _log.warning(problem)
            whole = _encoder.encode(Refused(message=problem))
        if said.number:
            await guest.answered(said.number, whole)
        elif not too_long:
            await guest.tell(said.event, whole)
        self._pieces.clear()


class Guests:
    """All that are there. Used by the gate's loop alone."""

    def __init__(self, runtime: Runtime, context: zmq.asyncio.Context):
        self._runtime, self._context = runtime, context
        self._guests: dict[str, _Guest] = {}
        self._saying: dict[str, _Saying] = {}

    async def answer(self, call: FetchCalls | EngineSays, name: str) -> Message | None:
        """Of the engine whose key has this name. Raises RefusedError; None: it was carried out."""
        if isinstance(call, FetchCalls) and not call.process:
            return CallsForEngine(engine=_name(name))
        guest = self._guests.get(name)
        if guest is not None and guest.process != call.process:
            raise refuse(f"another process is the engine {name}", "process", call.process, "one at a time")
        if isinstance(call, EngineSays):
            if guest is None:
                raise refuse(f"the engine {name} is not there: it has to fetch its calls first")
            saying = self._saying.get(name)
            if saying is None or saying.process != call.process:
                saying = self._saying[name] = _Saying(call.process)
            guest.heard_s = asyncio.get_running_loop().time()
            async with saying.lock:
                await saying.take(call, guest)
            return None
        if guest is None:
            try:
                guest = self._guests[name] = _Guest(self._runtime, self._context, _name(name), call.process)
            except HeldElsewhere as held:
                raise refuse(f"the robot has an engine {name} of its own (process {held.process})") from held
            _log.info("the engine %s is there, on another machine", name)
        guest.heard_s = asyncio.get_running_loop().time()
        return CallsForEngine(engine=name, calls=await guest.fetch())

    async def watch(self) -> None:
        """Let go of those that have gone silent."""
        while True:
            await asyncio.sleep(_WAIT_S)
            now = asyncio.get_running_loop().time()
            for name, guest in list(self._guests.items()):
                if now - guest.heard_s > _SILENT_S:
                    _log.warning("the engine %s, on another machine, has gone silent", name)
                    self._guests.pop(name).close()

    def close(self) -> None:
        """All have gone."""
        for guest in self._guests.values():
            guest.close()
        self._guests.clear()


def check_owner(call: Message, name: str) -> None:
    """Raise RefusedError where an engine whose key has this name commands as somebody else.

    Whose action a call is about that names it by its id (CancelAction, StreamPose, ...) the daemon knows (`codec.SIGNED`).
    """
    owner = getattr(call, "owner", name)
    if owner != name:
        raise refuse(f"the link knows this engine as {name}", "owner", owner[:80], name)


def _name(key: str) -> str:
    """The engine of a key. Raises RefusedError where no engine can be called so."""
    try:
        if key == FIRST:
            raise ValueError(f"{key} is the robot's own first engine")
        return checked(key)
    except ValueError as problem:
        raise refuse(
            f"rename allowed/engines/{key}.key on the robot: {problem}", "name", key, "an engine's name"
        ) from problem
