"""How a process joins the hub: one JSON datagram each way on the Unix seqpacket socket, then datagrams of records only.

The newcomer says `Hello`; the hub answers `Welcome` or `Sorry`. From then on every datagram, both ways, is a whole number of
records (hal.can.frames), at most `MAX_RECORDS`. A record's `bus` counts the channels as the newcomer listed them. Who joins
with the role `control` is no node on the bus: it sends requests and gets answers, both in JSON (hal.can.control).
"""

from __future__ import annotations

import errno
import os
import select
import socket
import sys
import time
from pathlib import Path
from typing import Annotated, Literal

import msgspec

from hal.can.frames import BYTES

VERSION = 2
"""Of all that is said on the socket. A hub and a newcomer of different versions don't work together."""
MAX_RECORDS = 512
"""Records in one datagram."""
MAX_BYTES = MAX_RECORDS * BYTES
_SOCKET_BUFFER = 1 << 22
_ANSWER_S = 1.0  # a hub that is there gets this long to answer, however short the caller waits for one to appear


class BusLost(ConnectionError):
    """The bus is gone, or none is there: its hub ended, or does not answer."""


class ChannelInfo(msgspec.Struct):
    """A channel of the hub; bit rates in bit/s."""

    name: str
    bitrate: int
    data_bitrate: int


class Hello(msgspec.Struct, tag="hello", kw_only=True):
    """What a newcomer asks for."""

    version: int = VERSION
    channels: list[str] | None = None
    """names, in the order in which the newcomer counts them; None: all, in the hub's order"""
    own_frames: bool = False
    """also send the newcomer its own frames back, where they come on the bus"""
    name: Annotated[str, msgspec.Meta(max_length=64)] = ""
    """what reports and faults call it; empty: the hub gives it a name"""
    role: Literal["node", "control"] = "node"
    ticks: bool = False
    """also send the newcomer the plant's notices that a cycle is over (hal.can.frames.TICK)"""


class Welcome(msgspec.Struct, tag="welcome", kw_only=True):
    """The hub's answer: the channels, in the newcomer's order."""

    channels: list[ChannelInfo]


class Sorry(msgspec.Struct, tag="sorry", kw_only=True):
    """The hub's refusal."""

    reason: str


encode = msgspec.json.encode
decode_hello = msgspec.json.Decoder(Hello).decode
_decode_answer = msgspec.json.Decoder(Welcome | Sorry).decode


def prepare(connection: socket.socket) -> None:
    """Large buffers, so that a listener may pause; never blocking."""
    for option in (socket.SO_SNDBUF, socket.SO_RCVBUF):
        connection.setsockopt(socket.SOL_SOCKET, option, _SOCKET_BUFFER)
    connection.setblocking(False)


def default_name() -> str:
    """What a process is called on the bus when nobody says: program and process id."""
    program = Path(sys.argv[0])
    return f"{program.parent.name if program.stem == '__main__' else program.stem or 'python'}-{os.getpid()}"[-64:]


def join(
    path: str | os.PathLike[str],
    channels: list[str] | None = None,
    *,
    own_frames: bool = False,
    timeout_s: float = 5.0,
    name: str | None = None,
    role: Literal["node", "control"] = "node",
    ticks: bool = False,
) -> tuple[socket.socket, list[ChannelInfo]]:
    """Join the hub at `path`, waiting until it is there; returns the non-blocking socket and the channels.

    name: what reports and faults call this process (default: program and process id). Raises BusLost when no hub answers
    within `timeout_s`, ValueError when it refuses (it says why).
    """
    deadline = time.monotonic() + timeout_s
    connection = _connect(os.fspath(path), deadline, timeout_s)
    try:
        connection.send(
            encode(
                Hello(
                    channels=channels,
                    own_frames=own_frames,
                    name=default_name() if name is None else name,
                    role=role,
                    ticks=ticks,
                )
            )
        )
        waiting = select.poll()
        waiting.register(connection, select.POLLIN)
        patience = max(_ANSWER_S, deadline - time.monotonic())
        if not waiting.poll(patience * 1000):
            raise BusLost(f"CAN bus at {path}: its hub does not answer within {patience:.1f} s")
        answer = connection.recv(1 << 16)
    except OSError as error:
        connection.close()
        raise error if isinstance(error, BusLost) else BusLost(f"CAN bus at {path}: {error}") from error
    if not answer:
        connection.close()
        raise BusLost(f"CAN bus at {path}: the hub closed the connection")
    decoded = _decode_answer(answer)
    if isinstance(decoded, Sorry):
        connection.close()
        raise ValueError(f"CAN bus at {path}: {decoded.reason}")
    return connection, decoded.channels


def _connect(path: str, deadline: float, timeout_s: float) -> socket.socket:
    while True:
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            connection.connect(path)
        except OSError as error:
            connection.close()
            if error.errno not in (errno.ENOENT, errno.ECONNREFUSED, errno.EAGAIN):
                raise BusLost(f"CAN bus at {path}: {error}") from error
            if time.monotonic() >= deadline:
                raise BusLost(
                    f"CAN bus at {path}: no hub there after {timeout_s:g} s; start the robot's service (handrail up) or a "
                    f"bus by itself (handrail can up), or name its folder (--runtime)"
                ) from error
            time.sleep(0.02)  # nothing announces that a socket begins to listen
        else:
            prepare(connection)
            return connection
