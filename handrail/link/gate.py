"""The robot's only door to the outside: known keys only, typed calls in, events out.

A ROUTER takes calls on one TCP port and an XPUB gives events on the next, both under CURVE with ZAP: a client whose public key
is not in the allowed folder never gets as far as a message. Each call is read strictly (`handrail.link.codec`) and passed on by
its type to the daemon or the engine, each with its own time to answer; an operator stop goes straight to the daemon loop's stop
socket. Events leave as their spec says: reliable ones in order, of latest-value streams only the newest, at most 60 times a
second. Nothing here keeps state that matters: daemon, engine and gate may each die and come back.

    python -m handrail.link.gate --runtime DIR [--port 47800] [--bind 127.0.0.1]
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import logging
import math
import signal
import sys
from pathlib import Path
from typing import Any

import msgspec
import zmq
import zmq.asyncio
from zmq.auth.asyncio import AsyncioAuthenticator
from zmq.utils import z85

from handrail.engines import FIRST, running
from handrail.engines import of as engine_of
from handrail.link import codec, keys, selections
from handrail.link.archive import Archive
from handrail.link.backend import Backend, Gone
from handrail.link.command import Command
from handrail.link.guests import Guests, check_owner
from handrail.link.selections import Selections
from handrail.link.service import ask_supervisor
from handrail.link.streams import LatestValues
from handrail.messages import (
    ClientIdentity,
    EngineInfo,
    Engines,
    GetEngines,
    GetIdentity,
    GetSamples,
    ListRecordings,
    Mark,
    Ok,
    Recordings,
    Refused,
    ReturnCommand,
    Samples,
    Stop,
    TakeCommand,
    spec,
)
from handrail.runtime import Runtime
from handrail.stop import NoAnswer, stop_now
from handrail.topics import Publisher, RefusedError

_log = logging.getLogger("handrail.link")

_IN_FLIGHT = 32
"""calls that one connection may have open at once"""
_WINDOW_S = 1 / 60
"""latest-value events that come within this time leave together"""
_DAEMON_SILENT_S = 2.0
"""the daemon's last values are not handed to late clients once it has been silent for this long"""
_FRAMES_OF_A_CALL = 3
"""identity, number, payload"""
_LOOK_S = 0.5
"""how often it is looked which engines there are"""
_INFO_S = 1.0
"""for an engine to say what it does"""
_CURVE_KEY_BYTES = 32
_SUBSCRIBE, _UNSUBSCRIBE = b"\x01", b"\x00"
_DOMAIN = "handrail"


_engines_decoder = msgspec.msgpack.Decoder(Engines)
_answers = msgspec.msgpack.Decoder(Recordings | Samples | Refused)


class PortTaken(Exception):
    """Something else listens where the gate should."""


class _AllowedClients(AsyncioAuthenticator):
    """ZAP: lets in the clients whose keys are in the folder now, under the names of their files."""

    def __init__(self, context: zmq.asyncio.Context, gate_keys: keys.GateKeys):
        # The authenticator's own log tells of each handshake at debug level only; ours names the client.
        super().__init__(context)
        self._keys = gate_keys
        self.configure_curve_callback(_DOMAIN, self)

    def callback(self, domain: str, key: bytes) -> bool:
        name = self._keys.name_of(key)
        if name is None:
            _log.warning("an unknown key was turned away: %s", key.decode("ascii", "replace"))
        return name is not None

    def curve_user_id(self, client_public_key: bytes) -> str:
        # The key and not its name: what it may do is asked when it does it.
        return z85.encode(client_public_key).decode() if len(client_public_key) == _CURVE_KEY_BYTES else ""


class Gate:
    """Forwards calls and events between clients and the local processes of one robot."""

    def __init__(self, runtime: Runtime, gate_keys: keys.GateKeys, *, bind: str = "127.0.0.1", port: int = 47800):
        """`bind`: the address to listen on (``*``: every interface); events go out on `port` + 1. Raises PortTaken."""
        self._runtime, self._keys = runtime, gate_keys
        self._context = zmq.asyncio.Context()
        self._authenticator = _AllowedClients(self._context, gate_keys)
        self._calls = self._curve_socket(zmq.ROUTER, gate_keys)
        self._calls.setsockopt(zmq.MAXMSGSIZE, codec.LARGEST_CALL + 1024)
        self._events_out = self._curve_socket(zmq.XPUB, gate_keys)
        self._events_out.setsockopt(zmq.XPUB_VERBOSE, 1)
        self._events_out.setsockopt(zmq.SNDHWM, 10_000)
        self._events_out.setsockopt(zmq.MAXMSGSIZE, 1024)
        self._endpoints = [(self._calls, f"tcp://{bind}:{port}"), (self._events_out, f"tcp://{bind}:{port + 1}")]
        self._daemon = Backend(self._context, runtime.endpoint("daemon.call"), "daemon")
        self._engines = {FIRST: self._backend(FIRST)}
        """those that are known to be there, and the first one"""
        self._inside = self._context.socket(zmq.SUB)
        self._archive = Archive()
        self._marks = Publisher(runtime.endpoint("link.events"))
        self._guests = Guests(runtime, self._context)
        self._unpacker = codec.Unpacker(codec.REMOTE_CALL, codec.LARGEST_CALL)
        self._unpacker_of_engines = codec.Unpacker(codec.REMOTE_CALL_OF_ENGINES, codec.LARGEST_CALL)
        self._packer = codec.Packer()
        self._encoder = msgspec.msgpack.Encoder()
        self._latest = LatestValues(_DAEMON_SILENT_S)
        self._selections = Selections()
        self._held_back = asyncio.Event()
        self._subscribed: set[bytes] = set()
        """beginnings of the types' names that somebody wants to hear; a client may subscribe what it likes, others are not kept"""
        self._command = Command()
        self._in_flight: dict[bytes, int] = {}
        self._tasks: set[asyncio.Task[None]] = set()

    def _backend(self, engine: str) -> Backend:
        return Backend(self._context, self._runtime.endpoint(f"{engine}.call"), engine)

    def _curve_socket(self, kind: int, gate_keys: keys.GateKeys) -> zmq.asyncio.Socket:
        socket = self._context.socket(kind)
        socket.setsockopt(zmq.LINGER, 0)
        socket.setsockopt(zmq.CURVE_SERVER, 1)
        socket.setsockopt(zmq.CURVE_PUBLICKEY, gate_keys.public)
        socket.setsockopt(zmq.CURVE_SECRETKEY, gate_keys.secret)
        socket.setsockopt(zmq.ZAP_DOMAIN, _DOMAIN.encode())
        socket.setsockopt(zmq.HEARTBEAT_IVL, 1000)
        socket.setsockopt(zmq.HEARTBEAT_TIMEOUT, 5000)
        return socket

    async def serve(self, until: asyncio.Event, ready: asyncio.Event | None = None) -> None:
        """Serve until told otherwise. Raises PortTaken."""
        # The authenticator first: a socket that is bound without one would let everybody in.
        self._authenticator.start()
        try:
            for socket, endpoint in self._endpoints:
                try:
                    socket.bind(endpoint)
                except zmq.ZMQError as error:
                    raise PortTaken(
                        f"{endpoint}: can't listen there: {error}; is another robot up? choose --port"
                    ) from error
            work = [
                asyncio.create_task(self._take_calls()),
                asyncio.create_task(self._take_events()),
                asyncio.create_task(self._take_subscriptions()),
                asyncio.create_task(self._send_latest()),
                asyncio.create_task(self._watch_engines()),
                asyncio.create_task(self._send_held_back()),
                asyncio.create_task(self._guests.watch()),
            ]
            if ready:
                ready.set()
            finished = asyncio.create_task(until.wait())
            done, _ = await asyncio.wait({*work, finished}, return_when=asyncio.FIRST_COMPLETED)
            open_calls = list(self._tasks)
            for task in (*work, finished, *open_calls):
                task.cancel()
            await asyncio.gather(*open_calls, return_exceptions=True)
            for task in done:
                if task is not finished:
                    task.result()
        finally:
            self._authenticator.stop()
            self._daemon.close()
            self._guests.close()
            self._marks.close()
            for engine in self._engines.values():
                engine.close()
            self._context.destroy(linger=0)

    # ------------------------------------------------------------------------------------------------------------- calls

    async def _take_calls(self) -> None:
        while True:
            frames = await self._calls.recv_multipart(copy=False)
            if len(frames) != _FRAMES_OF_A_CALL or len(frames[1].bytes) != 8:
                continue  # not even the number to answer to
            identity, number, payload = (frame.bytes for frame in frames)
            try:
                message = self._unpack(payload, _key(frames[-1]))
                if not isinstance(message, codec.RAW):
                    codec.check_plain(message)
            except codec.Malformed as problem:
                await self._answer(
                    identity,
                    number,
                    Refused(
                        message=f"not a call that the link takes: {problem}",
                        field=problem.where,
                        value=problem.value,
                        expected=problem.expected,
                    ),
                )
                continue
            if not isinstance(message, Stop) and self._in_flight.get(identity, 0) >= _IN_FLIGHT:
                await self._answer(
                    identity, number, Refused(message=f"{_IN_FLIGHT} calls of this client are open already")
                )
                continue
            self._in_flight[identity] = self._in_flight.get(identity, 0) + 1
            task = asyncio.create_task(self._carry_out(identity, number, message, _key(frames[-1])))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)

    def _unpack(self, payload: bytes, key: bytes) -> Any:
        """The call. Raises Malformed, for what this key may not say, too."""
        try:
            return self._unpacker.unpack(payload)
        except codec.Malformed:
            if self._role_of(key) != "engine":
                raise
        return self._unpacker_of_engines.unpack(payload)

    def _role_of(self, key: bytes) -> str:
        who = self._keys.identity_of(key)
        return who.role if who else "none"

    async def _carry_out(self, identity: bytes, number: bytes, message: Any, key: bytes) -> None:
        if self._command.holder:
            self._command.heard(self._name_of(key))
        try:
            if isinstance(message, Stop):
                await self._answer(identity, number, await self._stop(message, self._name_of(key)))
                return
            if isinstance(message, GetIdentity):
                await self._answer(identity, number, self._whose(key))
                return
            if not isinstance(message, codec.OBSERVING) and self._role_of(key) == "observer":
                await self._answer(identity, number, _only_observes(message, self._name_of(key)))
                return
            if isinstance(message, codec.CODE):
                who = self._keys.identity_of(key)
                if who is None or who.role != "developer":
                    await self._answer(identity, number, _no_code(message, who, key))
                    return
            if isinstance(message, TakeCommand | ReturnCommand):
                await self._answer(identity, number, self._hand_over(message, key))
                return
            if self._command.holder and self._role_of(key) != "engine":  # what programs move is settled by leases
                self._command.check(self._name_of(key), message)
            if isinstance(message, codec.COMMANDS):
                check_owner(message, self._name_of(key))
            if isinstance(message, codec.GUEST_CALLS):
                await self._answer(identity, number, await self._guest(message, key) or Ok())
                return
            message = self._signed(message, key)
            if isinstance(message, GetEngines) and not message.engine:
                await self._answer(identity, number, Engines(engines=await self._all_engines()))
                return
            if isinstance(message, ListRecordings | GetSamples):
                await self._answer(identity, number, await self._look_up(message))
                return
            if isinstance(message, codec.SERVICE_CALLS):
                answer = await self._ask_supervisor(message)
                if isinstance(message, Mark) and isinstance(self._unpack_answer(answer), Ok):
                    self._marks.send(message)
                await self._calls.send_multipart((identity, number, answer))
                return
            backend = self._daemon
            if not isinstance(message, codec.DAEMON_CALLS + codec.COMMANDS):
                engine = engine_of(message)
                if engine not in self._engines:
                    known = ", ".join(self._engines)
                    await self._answer(identity, number, _no_engine(engine, known))
                    return
                backend = self._engines[engine]
            try:
                answer = await backend.call(self._encoder.encode(message), codec.timeout_s(type(message)))
            except Gone as problem:
                await self._answer(identity, number, codec.NoAnswer(message=f"{type(message).__name__}: {problem}"))
            else:
                await self._calls.send_multipart((identity, number, self._packer.pack_encoded(answer)))
        except RefusedError as refused:
            await self._answer(identity, number, refused.refusal)
        finally:
            self._in_flight[identity] -= 1
            if not self._in_flight[identity]:
                del self._in_flight[identity]

    def _whose(self, key: bytes) -> ClientIdentity:
        who = self._keys.identity_of(key)
        name, role = (who.name, who.role) if who else ("", "none")
        return ClientIdentity(name=name, role=role, commander=self._command.holder)  # type: ignore[arg-type]

    def _hand_over(self, message: TakeCommand | ReturnCommand, key: bytes) -> ClientIdentity:
        """Raises RefusedError."""
        name = self._name_of(key)
        if isinstance(message, ReturnCommand):
            self._command.give_back(name)
            _log.info("%s has returned the command", name)
        elif (before := self._command.take(name, take_over=message.take_over)) != name:
            _log.info("%s has the command%s", name, f", taken over from {before}" if before else "")
        return self._whose(key)

    async def _ask_supervisor(self, message: Any) -> bytes:
        """Its answer, packed."""
        name = type(message).__name__
        try:
            encoded = await ask_supervisor(self._runtime, self._encoder.encode(message), codec.timeout_s(type(message)))
        except Gone as problem:
            return self._packer.pack(codec.NoAnswer(message=f"{name}: {problem}"))
        return self._packer.pack_encoded(encoded)

    def _unpack_answer(self, packed: bytes) -> Any:
        return codec.Unpacker(codec.REMOTE_ANSWER, codec.LARGEST_ANSWER).unpack(packed)

    async def _look_up(self, message: ListRecordings | GetSamples) -> msgspec.Struct:
        """What a process of its own reads in recordings, with what the supervisor knows of the one that is being made."""
        try:
            found = _answers.decode(await self._archive.ask(message, codec.timeout_s(type(message)) - 1.0))
        except Gone as problem:
            return codec.NoAnswer(message=str(problem))
        if not isinstance(found, Recordings):
            return found
        now = self._unpack_answer(await self._ask_supervisor(message))
        if not isinstance(now, Recordings) or not now.running:
            return found
        others = [each for each in found.recordings if each.name != now.running]
        return msgspec.structs.replace(found, recordings=others, running=now.running, running_s=now.running_s)

    async def _guest(self, message: Any, key: bytes) -> msgspec.Struct | None:
        """The answer to an engine on another machine. Raises RefusedError."""
        who = self._keys.identity_of(key)
        if who is None or who.role != "engine":
            raise RefusedError(_no_engines_key(who))
        return await self._guests.answer(message, who.name)

    def _signed(self, message: Any, key: bytes) -> Any:
        """The call with the name and the role that its key has here, whatever it says of itself."""
        if not isinstance(message, codec.SIGNED):
            return message
        who = self._keys.identity_of(key)
        name, role = (who.name, who.role) if who else ("unknown", "none")
        said = {"by": name, "role": role}
        return msgspec.structs.replace(message, **{field: said[field] for field in said if hasattr(message, field)})

    def _name_of(self, key: bytes) -> str:
        return self._keys.name_of(key) or "unknown"

    async def _stop(self, message: Stop, user: str) -> Any:
        reason = message.reason or f"stopped by {user}"
        _log.warning("STOP from %s: %s", user, reason)
        try:
            # In a thread: it waits for the loop's answer, and other clients' calls go on meanwhile.
            answer = await asyncio.to_thread(stop_now, self._runtime, reason, codec.timeout_s(Stop))
        except NoAnswer as problem:
            _log.error("STOP: %s", problem)
            return codec.NoAnswer(message=f"Stop: {problem}")
        if not answer.startswith("stopped"):
            return codec.NoAnswer(message=f"Stop: the loop answered {answer!r}, expected 'stopped'")
        return Ok()

    async def _all_engines(self) -> list[EngineInfo]:
        return list(await asyncio.gather(*(self._info(name) for name in self._engines)))

    async def _info(self, name: str) -> EngineInfo:
        """What an engine says of itself."""
        try:
            encoded = await self._engines[name].call(self._encoder.encode(GetEngines(engine=name)), _INFO_S)
            return _engines_decoder.decode(encoded).engines[0]
        except (Gone, KeyError, msgspec.DecodeError):
            return EngineInfo(name=name, up=False)

    async def _watch_engines(self) -> None:
        """Take up the engines that come, tell of those that go."""
        up: set[str] = set()
        while True:
            there = set(running(self._runtime))
            for name in there - up:
                if name not in self._engines:
                    self._engines[name] = self._backend(name)
                    self._inside.connect(self._runtime.endpoint(f"{name}.events"))
                await self._tell(await self._info(name))
            for name in up - there:
                await self._tell(EngineInfo(name=name, up=False))
                if name != FIRST:
                    self._inside.disconnect(self._runtime.endpoint(f"{name}.events"))
                    self._engines.pop(name).close()
            up = there
            await asyncio.sleep(_LOOK_S)

    async def _tell(self, event: msgspec.Struct) -> None:
        await self._take_event(type(event).__name__.encode(), self._encoder.encode(event))

    async def _answer(self, identity: bytes, number: bytes, message: msgspec.Struct) -> None:
        await self._calls.send_multipart((identity, number, self._packer.pack(message)))

    # ------------------------------------------------------------------------------------------------------------ events

    async def _take_events(self) -> None:
        events = self._inside
        events.setsockopt(zmq.LINGER, 0)
        events.setsockopt(zmq.RCVHWM, 10_000)
        events.setsockopt(zmq.RECONNECT_IVL, 50)
        for wanted in codec.REMOTE_EVENTS:
            events.subscribe(wanted)
        for endpoint in ("daemon.events", f"{FIRST}.events", "sensors.events"):
            events.connect(self._runtime.endpoint(endpoint))
        at_once: zmq.Socket[bytes] = zmq.Socket.shadow(events)
        while True:
            await self._take_event(*await events.recv_multipart())
            # Events come in bursts: waiting for each would cost more than all that is done with it.
            with contextlib.suppress(zmq.Again):
                while True:
                    await self._take_event(*at_once.recv_multipart(zmq.NOBLOCK))

    async def _take_event(self, name: bytes, encoded: bytes) -> None:
        kind = codec.REMOTE_EVENTS.get(name.decode("ascii", "replace"))
        if kind is None:
            return
        if spec(kind).reliable:
            # What was true before it leaves before it.
            await self._flush()
            await self._publish(name, encoded)
        else:
            try:
                self._latest.put(kind, encoded, asyncio.get_running_loop().time())
            except msgspec.DecodeError as problem:
                _log.error("an event that is no %s came from inside: %s", name.decode(), problem)

    async def _send_latest(self) -> None:
        while True:
            await self._latest.wait()
            await self._flush()
            await asyncio.sleep(_WINDOW_S)

    async def _flush(self) -> None:
        for name, encoded in self._latest.take():
            await self._publish(name, encoded)

    async def _publish(self, name: bytes, encoded: bytes) -> None:
        if any(name.startswith(topic) for topic in self._subscribed):  # packing costs more than sending
            await self._events_out.send_multipart((name, self._packer.pack_encoded(encoded)))
        await self._select(name, encoded)

    async def _select(self, name: bytes, encoded: bytes) -> None:
        """To those who have chosen some of this type of events."""
        try:
            chosen = list(self._selections.take(name, encoded, asyncio.get_running_loop().time()))
        except msgspec.DecodeError as problem:
            _log.error("an event that is no %s came from inside: %s", name.decode(), problem)
            return
        for topic, data in chosen:
            await self._events_out.send_multipart((topic, self._packer.pack_encoded(data)))
        if self._selections.next_due_s < math.inf:
            self._held_back.set()

    async def _send_held_back(self) -> None:
        """What was chosen to come less often, when its time is there."""
        clock = asyncio.get_running_loop().time
        while True:
            await self._held_back.wait()
            wait_s = self._selections.next_due_s - clock()
            if wait_s == math.inf:
                self._held_back.clear()
                continue
            await asyncio.sleep(max(0.0, min(wait_s, _LOOK_S)))
            for topic, data in list(self._selections.due(clock())):  # others may be chosen while these leave
                await self._events_out.send_multipart((topic, self._packer.pack_encoded(data)))

    async def _take_selection(self, topic: bytes) -> None:
        try:
            chosen = self._selections.add(topic)
        except (ValueError, UnicodeDecodeError) as problem:
            _log.warning("a selection that can't be: %s", problem)
            return
        name = chosen.kind.__name__.encode()
        for encoded in self._latest.last(name, asyncio.get_running_loop().time()):
            await self._select(name, encoded)

    async def _take_subscriptions(self) -> None:
        clock = asyncio.get_running_loop().time
        while True:
            message, *more = await self._events_out.recv_multipart()
            asked, topic = message[:1], message[1:]
            if more or asked not in (_SUBSCRIBE, _UNSUBSCRIBE):
                continue  # who sends such is no subscriber, and ends nobody's subscription
            if asked == _UNSUBSCRIBE:
                self._subscribed.discard(topic)  # told of the last one's only
                self._selections.remove(topic)
                continue
            if topic.startswith(selections.MARK.encode()):
                await self._take_selection(topic)
                continue
            if topic.startswith(codec.SYNC):
                await self._events_out.send_multipart((topic, b""))
            elif any(name.encode().startswith(topic) for name in codec.REMOTE_EVENTS):
                self._subscribed.add(topic)
                for encoded in self._latest.last(topic, clock()):
                    await self._publish(topic, encoded)


def _key(frame: zmq.Frame) -> bytes:
    """The public key (Z85) that the frame's connection was authenticated with."""
    try:
        return str(frame.get("User-Id")).encode()
    except zmq.ZMQError:
        return b""


def _no_engine(engine: str, known: str) -> Refused:
    return Refused(message="no such engine", field="engine", value=engine[:80], expected=f"one of: {known}")


def _no_code(message: Any, who: keys.Identity | None, key: bytes) -> Refused:
    """Why this one may not bring code."""
    shown = key.decode("ascii", "replace")
    name, role = (who.name, who.role) if who else ("nobody", "none: it is not allowed in any more")
    _log.warning("%s from %s, whose role is %s, was refused", type(message).__name__, name, role)
    return Refused(
        message=f"code is accepted from developers only: {name}'s key {shown} has the role {role}; on the robot, move "
        f"allowed/{name}.key to allowed/developers/ where that is right",
        field="role",
        value=role,
        expected="developer",
    )


def _only_observes(message: Any, name: str) -> Refused:
    """Why this one may not command."""
    _log.warning("%s from %s, who observes, was refused", type(message).__name__, name)
    return Refused(
        message=f"observers look on, and may stop the robot: {name}'s key has the role observer; on the robot, move "
        f"allowed/observers/{name}.key to allowed/ where that is to change",
        field="role",
        value="observer",
        expected="operator",
    )


def _no_engines_key(who: keys.Identity | None) -> Refused:
    """Why this one is no engine."""
    name, role = (who.name, who.role) if who else ("nobody", "none: it is not allowed in any more")
    where = "allowed/developers" if role == "developer" else "allowed"
    return Refused(
        message=f"engines come with keys of their own: {name}'s key has the role {role}; on the robot, move {where}/{name}.key to "
        "allowed/engines/ENGINE.key where that is right",
        field="role",
        value=role,
        expected="engine",
    )


async def _main(runtime: Runtime, gate_keys: keys.GateKeys, bind: str, port: int) -> None:
    until, ready = asyncio.Event(), asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, until.set)
    serving = asyncio.create_task(Gate(runtime, gate_keys, bind=bind, port=port).serve(until, ready))
    announced = asyncio.create_task(ready.wait())
    await asyncio.wait({serving, announced}, return_when=asyncio.FIRST_COMPLETED)
    if ready.is_set():
        print("link ready", flush=True)
    announced.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await serving


def main(arguments: list[str] | None = None) -> int:
    """The robot's door to the outside: authenticated calls in, events out. Returns 1 when it can't be opened."""
    parser = argparse.ArgumentParser(
        prog="python -m handrail.link.gate", description="The robot's door to the outside."
    )
    parser.add_argument("--runtime", help="folder where the robot's processes meet")
    parser.add_argument("--port", type=int, default=47800, help="TCP port for calls; events go out on the next one")
    parser.add_argument("--bind", default="127.0.0.1", help="address to listen on; '*' for every interface")
    parser.add_argument("--keys", type=Path, help="folder of keys (default: this user's)")
    given = parser.parse_args(arguments)
    logging.basicConfig(level=logging.INFO, format="link: %(message)s")
    try:
        asyncio.run(_main(Runtime.at(given.runtime), keys.for_gate(given.keys), given.bind, given.port))
    except (keys.KeysError, PortTaken, ValueError) as problem:
        print(f"link: {problem}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
