"""A file descriptor that becomes readable at a given moment, to the microsecond: epoll's own time-out counts milliseconds."""

from __future__ import annotations

import ctypes
import os

_MONOTONIC, _NONBLOCK = 1, os.O_NONBLOCK


class _Spec(ctypes.Structure):
    _fields_ = [(name, ctypes.c_long) for name in ("every_s", "every_ns", "s", "ns")]


class Alarm:
    """A Linux timerfd (timerfd_create(2)). Python has it from 3.13 on."""

    def __init__(self) -> None:
        """Raises OSError when the system gives none."""
        self._libc = ctypes.CDLL(None, use_errno=True)
        self._fd = self._libc.timerfd_create(_MONOTONIC, _NONBLOCK | os.O_CLOEXEC)
        if self._fd < 0:
            raise OSError(ctypes.get_errno(), "timerfd_create")
        self._spec = _Spec()
        self._is_set = False

    def fileno(self) -> int:
        """Readable from the moment on."""
        return int(self._fd)

    def set(self, delay_ns: int | None) -> None:
        """Go off in so many ns from now, at once when that is not positive; None: not at all. Replaces what was set."""
        if delay_ns is None:
            if not self._is_set:
                return
            self._spec.s = self._spec.ns = 0  # disarms
        else:
            self._spec.s, self._spec.ns = divmod(max(1, delay_ns), 1_000_000_000)
        self._is_set = delay_ns is not None
        self._libc.timerfd_settime(self._fd, 0, ctypes.byref(self._spec), None)  # also takes back what went off unread

    def close(self) -> None:
        """Give the descriptor back. May be called again."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1
