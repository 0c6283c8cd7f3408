"""Pairing: a client's key comes to the robot and the robot's to the client, under a code read off one and typed at the other.

The code is 40 random bits. Neither side ever sends it: both stretch it by scrypt (RFC 7914) with each other's nonces for salt,
and prove by HMAC-SHA256 (RFC 2104) that they know it, over both public keys, both nonces and the client's name. Whoever stands
between has to show the client a key that is not the robot's: then the proofs don't fit, the try is used up, and both sides say
so. What was overheard can be searched for the code, at one scrypt a guess, 2^39 of them on average, while the code counts for two
minutes, once. A code of fewer digits would need a PAKE; one that is typed once need not be shorter.

One connection a try (plain ZeroMQ, nothing secret crosses it): `Hello` → `Offer`, `Proof` → `Accepted` or `Declined`.
"""

from __future__ import annotations

import hashlib
import hmac
import platform
import re
import secrets
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import msgspec
import zmq
from msgspec import Meta

from handrail.link import keys

TRIES = 3
LASTS_S = 120.0
"""how long a code counts"""
NAME = r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}"
"""what a client can be called: a file's name"""
PORT_OFFSET = 2
"""pairing listens so many ports above the link (its events are on the next one)"""
_DIGITS = "0123456789ABCDEFGHJKMNPQRSTVWXYZ"  # Crockford's base 32: no I, L, O, U
_READ_AS = str.maketrans("ILO", "110")
_LENGTH = 8
_SCRYPT_N = 2**14  # 16 MiB and some 40 ms a guess
_LONGEST = 4096  # bytes of a message

_Key = Annotated[str, Meta(pattern=r"^[0-9A-Za-z.:+=^!/*?&<>()\[\]{}@%$#-]{40}$", max_length=40)]
"""Z85 (ZeroMQ RFC 32)"""
_Nonce = Annotated[bytes, Meta(min_length=16, max_length=16)]
_Mac = Annotated[bytes, Meta(min_length=32, max_length=32)]


class PairingError(Exception):
    """The two are not paired; str() says why and what to do."""


class Hello(msgspec.Struct, tag=True, kw_only=True):
    """A client wants in."""

    client: _Key
    """its public key, Z85"""
    name: Annotated[str, Meta(pattern=f"^{NAME}$", max_length=64)]
    nonce: _Nonce


class Offer(msgspec.Struct, tag=True, kw_only=True):
    """Who the robot says it is."""

    server: _Key
    nonce: _Nonce


class Proof(msgspec.Struct, tag=True, kw_only=True):
    """That the client knows the code, and which keys it has seen."""

    mac: _Mac


class Accepted(msgspec.Struct, tag=True, kw_only=True):
    """The robot knows it, too, and lets the client in."""

    mac: _Mac
    role: str
    name: str


class Declined(msgspec.Struct, tag=True, kw_only=True):
    """Not, and why."""

    why: Annotated[str, Meta(max_length=400)]


_from_client = msgspec.msgpack.Decoder(Hello | Proof)
_from_robot = msgspec.msgpack.Decoder(Offer | Accepted | Declined)
_encoder = msgspec.msgpack.Encoder()


def new_code() -> str:
    """Eight digits in two groups, as people read them."""
    digits = "".join(secrets.choice(_DIGITS) for _ in range(_LENGTH))
    return f"{digits[:4]}-{digits[4:]}"


def read_code(typed: str) -> str:
    """The code's digits however they were typed: small, with I for 1 or O for 0, with spaces. Raises PairingError."""
    digits = re.sub(r"[\s-]", "", typed).upper().translate(_READ_AS)
    if len(digits) != _LENGTH or any(digit not in _DIGITS for digit in digits):
        raise PairingError(f"code: got {typed!r}; expected eight digits as the robot shows them, such as 7K2M-9QXD")
    return digits


@dataclass(frozen=True)
class _Meeting:
    """What both sides have seen of each other."""

    hello: Hello
    offer: Offer

    def mac(self, digits: str, who: str) -> bytes:
        """That `who` (client, robot) knows the code, and has seen this."""
        salt = self.hello.nonce + self.offer.nonce
        key = hashlib.scrypt(digits.encode(), salt=salt, n=_SCRYPT_N, r=8, p=1, maxmem=2**26)
        seen = msgspec.msgpack.encode(
            [who, self.offer.server, self.hello.client, self.hello.nonce, self.offer.nonce, self.hello.name]
        )
        return hmac.new(key, seen, hashlib.sha256).digest()


# ---------------------------------------------------------------------------------------------------------------- the robot


@dataclass
class Paired:
    """Who was let in."""

    name: str
    role: str
    file: Path


@dataclass
class Desk:
    """The robot's side of one code: answers messages until somebody is paired, the tries are used up, or time is over."""

    gate: keys.GateKeys
    role: keys.Role = "operator"
    name: str = ""
    """that the client gets; empty: its own"""
    code: str = field(default_factory=new_code)
    lasts_s: float = LASTS_S
    tries: int = TRIES
    paired: Paired | None = None
    _meetings: dict[bytes, _Meeting] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._until = time.monotonic() + self.lasts_s

    @property
    def left_s(self) -> float:
        """Seconds that the code still counts; 0 when it does not any more."""
        return 0.0 if self.paired or self.tries <= 0 else max(0.0, self._until - time.monotonic())

    def answer(self, client: bytes, raw: bytes) -> Offer | Accepted | Declined:
        """To a message from a connection."""
        if self.left_s <= 0:
            return Declined(why="the code does not count any more: ask for another one with handrail pair")
        try:
            message = _from_client.decode(raw)
        except (msgspec.MsgspecError, RecursionError) as problem:
            return Declined(why=f"not understood: {problem}"[:400])
        if isinstance(message, Hello):
            offer = Offer(server=self.gate.public.decode(), nonce=secrets.token_bytes(16))
            if len(self._meetings) < 4 * TRIES or client in self._meetings:
                self._meetings[client] = _Meeting(message, offer)
                return offer
            return Declined(why="too many begin and don't go on")
        meeting = self._meetings.pop(client, None)
        if meeting is None:
            return Declined(why="a proof without a beginning")
        digits = read_code(self.code)
        if not hmac.compare_digest(meeting.mac(digits, "client"), message.mac):
            self.tries -= 1
            return Declined(
                why=f"not the code that the robot shows, or somebody stands between; {self.tries} tries left"
            )
        try:
            self.paired = self._let_in(meeting.hello)
        except PairingError as problem:
            return Declined(why=str(problem))
        return Accepted(mac=meeting.mac(digits, "robot"), role=self.role, name=self.paired.name)

    def _let_in(self, hello: Hello) -> Paired:
        name = self.name or hello.name
        public = hello.client.encode()
        file = keys.file_for(self.gate, name, self.role)
        known = self.gate.name_of(public)
        if file.exists() and known != name:
            raise PairingError(f"name: {name!r} is another client's already; expected --name with another one")
        keys.allow(file, public)
        return Paired(name, self.role, file)

    def serve(self, endpoint: str) -> None:
        """Answer until the code does not count any more. Raises PairingError where it can't listen."""
        context = zmq.Context()
        socket = context.socket(zmq.ROUTER)
        socket.setsockopt(zmq.LINGER, 500)
        socket.setsockopt(zmq.MAXMSGSIZE, _LONGEST)
        try:
            try:
                socket.bind(endpoint)
            except zmq.ZMQError as error:
                raise PairingError(f"{endpoint}: can't listen there: {error}; is another pairing under way?") from error
            while self.left_s > 0:
                if socket.poll(100):
                    client, *parts = socket.recv_multipart()
                    socket.send_multipart([client, _encoder.encode(self.answer(client, parts[-1] if parts else b""))])
        finally:
            socket.close()
            context.term()


# --------------------------------------------------------------------------------------------------------------- the client


def pair(
    endpoint: str, typed: str, folder: Path | str | None = None, *, name: str, timeout_s: float = 10.0
) -> Accepted:
    """Bring this user's key to the robot that shows the code, and its key here. Raises PairingError, KeysError.

    :param endpoint: tcp://HOST:PORT of the pairing, as `endpoint_of` says
    :param folder: of keys, None: this user's. A `server.key` that is there and another one is kept as `server.key.before`
    :param name: what the robot is to call this client
    """
    digits = read_code(typed)
    own = keys.for_client(keys.ensure(folder))
    try:
        hello = Hello(client=own.public.decode(), name=name, nonce=secrets.token_bytes(16))
        _from_client.decode(_encoder.encode(hello))
    except msgspec.ValidationError as problem:
        raise PairingError(f"name: got {name!r}; expected letters, digits, '_', '.' and '-', at most 64") from problem
    context = zmq.Context()
    socket = context.socket(zmq.DEALER)
    socket.setsockopt(zmq.LINGER, 0)
    socket.setsockopt(zmq.MAXMSGSIZE, _LONGEST)
    try:
        socket.connect(endpoint)
        offer = _ask(socket, hello, timeout_s, endpoint)
        if not isinstance(offer, Offer):
            raise PairingError(_why(offer))
        meeting = _Meeting(hello, offer)
        accepted = _ask(socket, Proof(mac=meeting.mac(digits, "client")), timeout_s, endpoint)
        if not isinstance(accepted, Accepted):
            raise PairingError(_why(accepted))
        if not hmac.compare_digest(meeting.mac(digits, "robot"), accepted.mac):
            raise PairingError(
                "who answered does not know the code: it is not the robot that shows it. Nothing was changed here"
            )
    finally:
        socket.close()
        context.term()
    assert own.folder is not None
    keys.trust(own.folder, offer.server.encode())
    return accepted


def _ask(socket: zmq.Socket, message: Hello | Proof, timeout_s: float, endpoint: str) -> Offer | Accepted | Declined:
    socket.send(_encoder.encode(message))
    if not socket.poll(round(timeout_s * 1000)):
        raise PairingError(
            f"{endpoint}: nobody answers; is handrail pair running on the robot, and the way to it open?"
        )
    try:
        return _from_robot.decode(socket.recv())
    except (msgspec.MsgspecError, RecursionError) as problem:
        raise PairingError(f"{endpoint}: what answers there is no robot that pairs") from problem


def _why(answer: Offer | Accepted | Declined) -> str:
    return f"the robot declined: {answer.why}" if isinstance(answer, Declined) else "the robot answered out of turn"


def link_of(address: str) -> str:
    """tcp://HOST:PORT of a link, or HOST, or HOST:PORT → the first. Raises PairingError."""
    found = re.fullmatch(r"(?:tcp://)?([A-Za-z0-9_.-]+|\[[0-9A-Fa-f:.]+\])(?::([0-9]{1,5}))?", address.strip())
    port = int(found[2] or 47800) if found else 0
    if found is None or not 0 < port <= 65535 - PORT_OFFSET:
        raise PairingError(f"address: got {address!r}; expected the link's, tcp://HOST:47800, or its host alone")
    return f"tcp://{found[1]}:{port}"


def endpoint_of(address: str) -> str:
    """Where the pairing of the robot with such a link listens. Raises PairingError."""
    place, _, port = link_of(address).rpartition(":")
    return f"{place}:{int(port) + PORT_OFFSET}"


def own_name() -> str:
    """This machine's, as far as a client can be called so."""
    return re.sub(r"[^A-Za-z0-9_.-]+", "-", platform.node()).strip("-._")[:64] or "client"
