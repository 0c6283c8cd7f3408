"""What a node's process and its host say to each other: MessagePack structs, each after its length, over a socket pair.

Arrays among inputs and outputs travel beside it where they are large (`engines.nodes.shared`).
"""

from __future__ import annotations

import os
import select
import socket
import struct
import threading
import time
from typing import Any

import msgspec

from engines.nodes.shared import BLOCKS, Reader, Writer

_LENGTH = struct.Struct("<Q")


class Put(msgspec.Struct, tag=True):
    """To the node: inputs and parameters, all or none of which count from the next step on."""

    inputs: dict[str, Any] = {}
    params: dict[str, Any] = {}
    number: int = 0
    """that the answer repeats; the first is 0"""
    step: bool = False
    """one step follows"""


class End(msgspec.Struct, tag=True):
    """To the node: end after this step."""


class PortTold(msgspec.Struct):
    name: str
    kind: str
    doc: str = ""
    unit: str = ""
    default: Any = None
    rate: float | None = None
    """times a second that an output may be told by a node that steps by itself"""
    low: float | None = None
    """of a parameter, in its unit; None: no bound"""
    high: float | None = None
    choices: tuple[str, ...] = ()


class Limits(msgspec.Struct):
    """What a node may take; who takes more is slowed down, or ended."""

    step_s: float
    memory_mb: int
    cpu_share: float
    restarts: int


class Hello(msgspec.Struct, tag=True):
    """From the node: it is loaded."""

    name: str
    doc: str
    every: float | None
    limits: Limits
    inputs: list[PortTold]
    outputs: list[PortTold]
    params: list[PortTold]
    process: int


class Ready(msgspec.Struct, tag=True):
    """From the node: its first parameters and inputs fit, and it has started."""


class Stepped(msgspec.Struct, tag=True):
    """From the node: a step is done, or what was put was taken."""

    number: int
    """as asked; 0: it steps by itself"""
    outputs: dict[str, Any]
    took_s: float


class Declined(msgspec.Struct, tag=True):
    """From the node: what was put does not fit; it goes on with what it had."""

    number: int
    why: str


class Failed(msgspec.Struct, tag=True):
    """From the node: its code raised; it ends."""

    why: str
    traceback: str


class Noted(msgspec.Struct, tag=True):
    """From the node: something that a person should know, and that does not end it."""

    text: str


class Beat(msgspec.Struct, tag=True):
    """From the node, several times a second unless it says something else, from a thread of its own."""

    busy_s: float
    """wall time since the step began that is under way; 0: none is"""


FromNode = Hello | Ready | Stepped | Declined | Failed | Noted | Beat
ToNode = Put | End


class Wire:
    """One end. Sending is safe from several threads."""

    def __init__(self, connection: socket.socket, kinds: Any):
        self.socket = connection
        self._decoder = msgspec.msgpack.Decoder(kinds)
        self._lock = threading.Lock()
        self._got = bytearray()
        self._writer, self._reader = Writer(), Reader()
        self.sent_at = 0.0
        """monotonic s, of the last message"""

    def send(self, message: msgspec.Struct, *, leave_out: bool = False) -> list[str]:
        """Raises OSError when the other end is gone.

        :param leave_out: large arrays where the other end still looks at all that it was sent: their names are returned
        """
        descriptors: list[int] = []
        left_out: list[str] = []
        with self._lock:
            if isinstance(message, Put):
                values, descriptors, _ = self._writer.prepared(message.inputs, leave_out=False)
                message = msgspec.structs.replace(message, inputs=values)
            elif isinstance(message, Stepped):
                values, descriptors, left_out = self._writer.prepared(message.outputs, leave_out=leave_out)
                message = msgspec.structs.replace(message, outputs=values)
            payload = msgspec.msgpack.encode(message)
            try:
                if descriptors:
                    socket.send_fds(self.socket, [_LENGTH.pack(len(payload))], descriptors)
                    self.socket.sendall(payload)
                else:
                    self.socket.sendall(_LENGTH.pack(len(payload)) + payload)
            finally:
                for each in descriptors:
                    os.close(each)
            self.sent_at = time.monotonic()
        return left_out

    def close(self) -> None:
        """Whoever sends afterwards gets an OSError."""
        with self._lock:
            self.socket.close()
            self._reader.close()
            self._writer.close()

    def receive(self, timeout_s: float | None) -> Any | None:
        """The next message, None when none came in time. Raises EOFError when the other end is gone."""
        while True:
            if (message := self.arrived()) is not None:
                return message
            if not select.select([self.socket], [], [], timeout_s)[0]:
                return None
            self.read()

    def arrived(self) -> Any | None:
        """The next message of what has been read."""
        if len(self._got) < _LENGTH.size:
            return None
        end = _LENGTH.size + _LENGTH.unpack_from(self._got)[0]
        if len(self._got) < end:
            return None
        payload = bytes(self._got[_LENGTH.size : end])
        del self._got[:end]
        message = self._decoder.decode(payload)
        if isinstance(message, Put):
            message.inputs = self._reader.taken(message.inputs)
        elif isinstance(message, Stepped):
            message.outputs = self._reader.taken(message.outputs)
        return message

    def read(self) -> None:
        """Read once what is there, or comes next. Raises EOFError when the other end is gone."""
        try:
            more, descriptors, _flags, _address = socket.recv_fds(
                self.socket, 1 << 20, 2 * BLOCKS, socket.MSG_CMSG_CLOEXEC
            )
            self._reader.descriptors.extend(descriptors)
        except OSError:
            more = b""
        if not more:
            raise EOFError
        self._got += more
