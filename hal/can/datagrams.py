"""Datagrams of records to and from the hub, each with what is done to them in one compiled call.

The loop does this in every cycle, after other work has had the caches: there a socket's method in Python, with its views, arguments
and exceptions, costs more than the system call within it. Nothing here waits, so nothing gives the interpreter away meanwhile.
"""

from __future__ import annotations

import errno
import socket
from typing import Any

import numpy as np
from numba import carray, types
from numba.extending import intrinsic

from hal.can.counting import SENT, count_batch, take_notices
from hal.can.frames import BYTES, TICK, WORDS
from hal.can.wire import MAX_BYTES
from hal.drives.borrowing import borrowed
from handrail.compiled import compiled

NOTHING, ENDED = -1, -2
"""What `receive` says instead of an error number: no datagram was there; the hub has ended."""

_recv: Any = types.ExternalFunction("recv", types.intp(types.int32, types.intp, types.intp, types.int32))
_send: Any = types.ExternalFunction("send", types.intp(types.int32, types.intp, types.intp, types.int32))
_errno: Any = types.ExternalFunction("__errno_location", types.intp())
_NO_WAIT = int(socket.MSG_DONTWAIT)
_QUIET = int(socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
_AGAIN, _INTERRUPTED = errno.EAGAIN, errno.EINTR
_TICK = TICK << 40


def _numbers_at(typing: Any, address: Any) -> Any:
    pointer = types.CPointer(types.int32)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], context.get_value_type(pointer))

    return pointer(types.intp), generate


_numbers: Any = intrinsic(_numbers_at)


@compiled
def _trouble():  # type: ignore[no-untyped-def]
    """The error number of the system call before."""
    return np.int64(carray(_numbers(_errno()), 1)[0])


@compiled
def _is_tick(words, row):  # type: ignore[no-untyped-def]
    return words[WORDS * row + 1] & np.uint64(_TICK) != 0


@compiled
def receive(descriptor, words, count, until_tick, ledger):  # type: ignore[no-untyped-def]
    """Read the datagrams that are there behind `count` records, take the hub's notices out of all, and count the frames.

    (frames, moved together; frames that the hub says it dropped; ticks; 0, NOTHING, ENDED or an error number). until_tick: not
    beyond a datagram that ends with a tick. ledger: a counting.Ledger's memory.
    """
    words = borrowed(words)
    room, told = len(words) // WORDS, np.int64(0)
    while room - count >= MAX_BYTES // BYTES and not (until_tick and count > 0 and _is_tick(words, count - 1)):
        got = _recv(np.int32(descriptor), words.ctypes.data + BYTES * count, MAX_BYTES, np.int32(_NO_WAIT))
        if got > 0:
            count += got // BYTES
            continue
        told = np.int64(ENDED) if got == 0 else _trouble()
        if told == _INTERRUPTED:
            continue
        if told == _AGAIN:
            told = np.int64(0 if count > 0 else NOTHING)
        break
    n, lost, ticks = take_notices(words, count, ledger)
    return n, lost, ticks, told


@compiled
def post(descriptor, words, first, n):  # type: ignore[no-untyped-def]
    """Send n records from record `first` on as one datagram; 0, or the error number."""
    words = borrowed(words)
    while _send(np.int32(descriptor), words.ctypes.data + BYTES * first, BYTES * n, np.int32(_QUIET)) < 0:
        told = _trouble()
        if told != _INTERRUPTED:
            return told
    return np.int64(0)


@compiled
def send(descriptor, words, n, ledger):  # type: ignore[no-untyped-def]
    """Send n records as one datagram and count them; 0, or the error number."""
    words = borrowed(words)
    told = post(descriptor, words, 0, n)
    if told == 0:
        count_batch(words, n, SENT, ledger)
    return told


@compiled
def take(descriptor, words, first):  # type: ignore[no-untyped-def]
    """Read one datagram to record `first` and behind, room for `MAX_BYTES` + 1 provided; its bytes, or −the error number."""
    words = borrowed(words)
    while True:
        got = _recv(np.int32(descriptor), words.ctypes.data + BYTES * first, MAX_BYTES + 1, np.int32(_NO_WAIT))
        if got >= 0:
            return got
        told = _trouble()
        if told != _INTERRUPTED:
            return -told
