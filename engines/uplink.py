"""An engine's own machine as its robot's: what the robot's processes answer and tell is there under the names that it has there.

The runtime folder of an engine on another machine gets `daemon.call`, `engine.call` and the topics beside them; what they say comes
from the robot through its link, and what the robot's side asks of this engine is asked here. The engine itself need not know.

Where the link is cut, calls get no answer and events end, as when the daemon is down: the daemon ends what the engine moves, since
it does not check in, and the engine's run pauses. What the engine tells meanwhile leaves when the link is back.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import threading
import uuid
from collections import deque
from collections.abc import Callable, Coroutine
from contextlib import ExitStack
from typing import Any

import msgspec
import zmq
import zmq.asyncio

from handrail.engines import FIRST
from handrail.link import codec
from handrail.link.backend import Backend, Gone
from handrail.link.events import Live
from handrail.link.session import Session
from handrail.messages import (
    ActionEvent,
    CallForEngine,
    CallsForEngine,
    DaemonCall,
    DaemonStatus,
    EngineCall,
    EngineInfo,
    EngineSays,
    FetchCalls,
    InstanceState,
    PointCloud,
    Refused,
    RobotState,
    Said,
)
from handrail.messages.remote_engines import PIECE
from handrail.runtime import Runtime
from handrail.sole_holder import sole_holder
from handrail.topics import Publisher, RefusedError, Unreachable

_log = logging.getLogger(__name__)

_ANSWER_S = 5.0
"""for the robot's side to answer; whoever asks here gives up by himself"""
_AGAIN_S = 0.2
_LONGEST_CALL_S = 700.0
_KEPT = 5000
"""events that wait for the link; then the oldest go"""
_encoder = msgspec.msgpack.Encoder()


class Uplink:
    """Between a runtime folder of this machine and a robot's link. Everything runs in threads of its own."""

    def __init__(self, runtime: Runtime, session: Session, name: str, *, clouds: bool = True):
        """`name`: the engine's, which is that of its key on the robot. `clouds`: whether what cameras see comes, too.

        Raises HeldElsewhere where another engine has this folder.
        """
        self._runtime, self._session, self._name, self._clouds = runtime, session, name, clouds
        self._held = ExitStack()
        self._held.enter_context(sole_holder(runtime.folder / "uplink.lock"))
        self._process, self._batch = uuid.uuid4().hex, 0
        self._to_say: deque[Said] = deque(maxlen=_KEPT)
        self._loop = asyncio.new_event_loop()
        self._something = asyncio.Event()
        self._attending, self._listening = asyncio.Event(), asyncio.Event()
        """the engine answers; what it tells is heard: it is called for nothing before, or nobody would learn what came of it"""
        self._ended = asyncio.Event()
        self._events = session.listen(
            (RobotState, DaemonStatus, ActionEvent, InstanceState, EngineInfo, Live, *((PointCloud,) if clouds else ()))
        )
        ready = threading.Event()
        self._threads = [
            threading.Thread(target=lambda: self._loop.run_until_complete(self._serve(ready)), name="uplink calls"),
            threading.Thread(target=self._hear, name="uplink events", daemon=True),
        ]
        for thread in self._threads:
            thread.start()
        ready.wait()

    def attend(self) -> None:
        """From now on the engine here answers: call it when it does."""
        self._loop.call_soon_threadsafe(self._attending.set)

    def close(self) -> None:
        """End all of it; the session stays open."""
        self._events.close()
        self._loop.call_soon_threadsafe(self._ended.set)
        for thread in self._threads:
            thread.join()
        self._loop.close()
        self._held.close()

    # --------------------------------------------------------------------------------------------------------- from the robot

    def _hear(self) -> None:
        daemon, first, sensors = (
            Publisher(self._runtime.endpoint(topic)) for topic in ("daemon.events", f"{FIRST}.events", "sensors.events")
        )
        try:
            for event in self._events:
                match event:
                    case Live():
                        # The instances may be others by now: who follows them looks when their engine tells of itself.
                        first.send(EngineInfo(name=FIRST))
                    case RobotState() | DaemonStatus() | ActionEvent():
                        daemon.send(event)
                    case PointCloud():
                        sensors.send(event)
                    case EngineInfo(name=name) if name != FIRST:
                        pass
                    case _:
                        first.send(event)
        finally:
            for publisher in (daemon, first, sensors):
                publisher.close()

    # ----------------------------------------------------------------------------------------------------------- to the robot

    async def _serve(self, ready: threading.Event) -> None:
        context = zmq.asyncio.Context()
        engine = Backend(context, self._runtime.endpoint(f"{self._name}.call"), self._name)
        tasks: set[asyncio.Task[None]] = set()

        def begin(work: Coroutine[Any, Any, None]) -> None:
            task = asyncio.create_task(work)
            tasks.add(task)
            task.add_done_callback(tasks.discard)

        for endpoint, kinds in (("daemon.call", DaemonCall), (f"{FIRST}.call", EngineCall)):
            socket = context.socket(zmq.ROUTER)
            socket.setsockopt(zmq.LINGER, 0)
            socket.bind(self._runtime.endpoint(endpoint))
            begin(self._pass_on(socket, msgspec.msgpack.Decoder(kinds), begin))
        begin(self._attend(engine, begin))
        begin(self._listen(context))
        begin(self._say())
        ready.set()
        await self._ended.wait()
        for task in tasks:
            task.cancel()
        engine.close()
        context.destroy(linger=0)

    async def _pass_on(
        self,
        socket: zmq.asyncio.Socket,
        decoder: msgspec.msgpack.Decoder[Any],
        begin: Callable[[Coroutine[Any, Any, None]], None],
    ) -> None:
        """What the engine asks the robot's processes."""

        async def ask(identity: bytes, message: Any) -> None:
            # What can't leave now is not asked: it must not come to the robot late, when nobody waits for it any more.
            if not self._session.connected:
                return
            with contextlib.suppress(Unreachable):
                answer = await asyncio.wrap_future(self._session.ask(message, _ANSWER_S))
                if not isinstance(answer, codec.NoAnswer):
                    await socket.send_multipart((identity, _encoder.encode(answer)))

        while True:
            identity, payload = await socket.recv_multipart()
            begin(ask(identity, decoder.decode(payload)))

    async def _attend(self, engine: Backend, begin: Callable[[Coroutine[Any, Any, None]], None]) -> None:
        """What the robot's side asks the engine."""

        async def carry_out(call: CallForEngine) -> None:
            try:
                answer = await engine.call(call.payload, _LONGEST_CALL_S)
            except Gone as gone:
                answer = _encoder.encode(Refused(message=str(gone)))
            self._put(Said(answer, number=call.number))

        await self._attending.wait()
        await self._listening.wait()
        refusal = ""
        while True:
            try:
                answer = await asyncio.wrap_future(self._session.ask(FetchCalls(process=self._process)))
            except Unreachable:
                answer = None
            if isinstance(answer, Refused):
                if answer.message != refusal:
                    _log.error("the robot does not take this engine: %s", RefusedError(answer))
                refusal = answer.message
            elif isinstance(answer, CallsForEngine):
                refusal = ""
                for call in answer.calls:
                    begin(carry_out(call))
                continue
            await asyncio.sleep(_AGAIN_S)

    async def _listen(self, context: zmq.asyncio.Context) -> None:
        """What the engine tells."""
        socket = context.socket(zmq.SUB)
        socket.setsockopt(zmq.LINGER, 0)
        socket.setsockopt(zmq.RECONNECT_IVL, 20)  # the engine is being made
        socket.subscribe(b"")
        with socket.get_monitor_socket(zmq.EVENT_HANDSHAKE_SUCCEEDED) as monitor:
            socket.connect(self._runtime.endpoint(f"{self._name}.events"))
            await monitor.recv_multipart()
            socket.disable_monitor()
        self._listening.set()
        while True:
            name, payload = await socket.recv_multipart()
            if name.decode() in codec.GUEST_EVENTS:
                self._put(Said(payload, event=name.decode()))

    def _put(self, said: Said) -> None:
        self._to_say.append(said)
        self._something.set()

    async def _say(self) -> None:
        """Answers and events, in order, as many at once as have come since the last time."""
        while True:
            while not self._to_say:
                self._something.clear()
                await self._something.wait()
            batch, size = [self._to_say.popleft()], 0
            while self._to_say and (size := size + len(batch[-1].payload)) + len(self._to_say[0].payload) < PIECE:
                batch.append(self._to_say.popleft())
            for said in _pieces(batch):
                await self._bring(said)

    async def _bring(self, said: list[Said]) -> None:
        """Until it is there. An answer that nobody waits for any more is nobody's."""
        self._batch += 1
        message = EngineSays(process=self._process, batch=self._batch, said=said)
        while True:
            with contextlib.suppress(Unreachable):
                answer = await asyncio.wrap_future(self._session.ask(message))
                if not isinstance(answer, Refused | codec.NoAnswer):
                    return
                _log.debug("not taken: %s", answer.message)
            await asyncio.sleep(_AGAIN_S)


def _pieces(batch: list[Said]) -> list[list[Said]]:
    """The same, none larger than the link takes at once."""
    if len(batch) > 1 or len(batch[0].payload) <= PIECE:
        return [batch]
    whole, (said,) = batch[0].payload, batch
    places = range(0, len(whole), PIECE)
    return [
        [msgspec.structs.replace(said, payload=whole[at : at + PIECE], piece=k, more=at + PIECE < len(whole))]
        for k, at in enumerate(places)
    ]
