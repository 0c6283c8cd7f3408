"""Who is on the hub's socket: processes are let in, greeted (hal.can.wire), and sent away when they speak anything else."""

from __future__ import annotations

import contextlib
import os
import select
import socket
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

from hal.can import wire
from hal.can.node import Node
from hal.can.quick_path import MOST_NODES
from hal.can.timing import BusTiming


class Members:
    """All processes that are connected, by their socket's descriptor."""

    def __init__(self, path: Path, channels: Sequence[BusTiming], epoll: select.epoll, queue: int):
        """Listens at `path`, and lets `epoll` watch. queue: records that may wait for one of them.

        Raises OSError when the path can't be used or another hub listens there.
        """
        self._channels, self._queue, self._epoll = channels, queue, epoll
        self._path, self._listener = path, _listen(path)
        epoll.register(self._listener, select.EPOLLIN)
        self.nodes: dict[int, Node] = {}
        self.greeted: tuple[Node, ...] = ()
        """those that are on the bus"""

    def admit_next(self, is_free: Callable[[int], bool]) -> None:
        """Let the next one in that knocks, under a number that nobody has and that is free."""
        with contextlib.suppress(BlockingIOError):
            connection, _ = self._listener.accept()
            wire.prepare(connection)
            taken = {node.number for node in self.nodes.values()}
            number = next((i for i in range(1, MOST_NODES) if i not in taken and is_free(i)), None)
            if number is None:
                with contextlib.suppress(OSError):
                    connection.send(
                        wire.encode(wire.Sorry(reason=f"{MOST_NODES - 1} processes are on the bus already"))
                    )
                connection.close()
                return
            self.nodes[connection.fileno()] = Node(connection, number, self._queue)
            self._epoll.register(connection, select.EPOLLIN)

    def greet(self, node: Node, datagram: bytes) -> bool:
        """Answer a newcomer's first datagram; False: it can't stay."""
        names = [channel.name for channel in self._channels]
        try:
            hello = _understood(datagram, names)
        except (msgspec.DecodeError, ValueError, RecursionError) as error:  # the last for nesting without end
            with contextlib.suppress(OSError):
                node.connection.send(wire.encode(wire.Sorry(reason=str(error))))
            return False
        places = [names.index(name) for name in (names if hello.channels is None else hello.channels)]
        node.listen_to(places, len(names))
        chosen = [self._channels[place] for place in places]
        answer = [wire.ChannelInfo(c.name, c.bitrate, c.data_bitrate) for c in chosen]
        try:
            node.connection.send(wire.encode(wire.Welcome(channels=answer)))
        except OSError:
            return False
        node.greeted, node.own_frames = True, hello.own_frames
        node.control, node.ticks = hello.role == "control", hello.ticks
        if not node.control:
            node.name = hello.name or node.name
            self.greeted = (*self.greeted, node)
        return True

    def part(self, node: Node) -> None:
        """Close a connection."""
        self.nodes.pop(node.connection.fileno(), None)
        self.greeted = tuple(other for other in self.greeted if other is not node)
        with contextlib.suppress(OSError):
            self._epoll.unregister(node.connection)
        node.connection.close()

    def fileno(self) -> int:
        """Readable when somebody knocks."""
        return self._listener.fileno()

    def close(self) -> None:
        """Let nobody in any more."""
        self._listener.close()
        with contextlib.suppress(FileNotFoundError):
            self._path.unlink()


def _understood(datagram: bytes, names: list[str]) -> wire.Hello:
    hello = wire.decode_hello(datagram)
    wanted = names if hello.channels is None else hello.channels
    if hello.version != wire.VERSION:
        raise ValueError(
            f"wire version {hello.version}; this hub speaks {wire.VERSION}: start the hub and what joins it from the same "
            f"Handrail, or bring your firmware up to date (docs/can.md)"
        )
    if len(set(wanted)) != len(wanted) or not set(wanted) <= set(names):
        raise ValueError(f"channels {wanted}; expected different names out of {names}")
    return hello


def _listen(path: Path) -> socket.socket:
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    try:
        if path.is_socket():
            with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as probe:
                if probe.connect_ex(os.fspath(path)) == 0:
                    raise OSError(f"CAN hub: another hub listens at {path}; stop it, or use another runtime folder")
            path.unlink()  # left over from a hub that was killed
        listener.bind(os.fspath(path))
        listener.listen(MOST_NODES)
        listener.setblocking(False)
    except OSError:
        listener.close()
        raise
    return listener
