"""What makes a Python process keep a period: absolute deadlines, a real-time scheduler, memory that stays resident.

Everything here is permitted to root and to users with the limits `rtprio` and `memlock` (limits.conf(5)); where it is not
permitted the loop runs without, late more often, and says so in plain words.
"""

from __future__ import annotations

import ctypes
import errno
import gc
import os
import struct
import time
from collections.abc import Collection

_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4
_TIMER_ABSTIME = 1
_DMA_LATENCY = "/dev/cpu_dma_latency"

_libc = ctypes.CDLL(None, use_errno=True)


class _Timespec(ctypes.Structure):
    _fields_ = [("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long)]


_deadline = _Timespec()
_deadline_pointer = ctypes.byref(_deadline)
_clock_nanosleep = _libc.clock_nanosleep
_clock_nanosleep.argtypes = [ctypes.c_int, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p]


def sleep_until(deadline_ns: int) -> None:
    """Sleep until `time.monotonic_ns()` reaches `deadline_ns`; at once when it has. One thread of a process may use it.

    The deadline is absolute (clock_nanosleep(2), TIMER_ABSTIME), so that a period does not drift by the time its work takes.
    """
    _deadline.seconds, _deadline.nanoseconds = divmod(deadline_ns, 1_000_000_000)
    while _clock_nanosleep(time.CLOCK_MONOTONIC, _TIMER_ABSTIME, _deadline_pointer, None) == errno.EINTR:
        pass  # a signal: its Python handler runs here, then the sleep goes on to the same deadline


def sleep_then_spin_until(deadline_ns: int, spin_ns: int = 150_000) -> None:
    """Sleep until `spin_ns` before the deadline, then watch the clock: late by 0.2 µs instead of 20, for a share of a core."""
    sleep_until(deadline_ns - spin_ns)
    monotonic_ns = time.monotonic_ns
    while monotonic_ns() < deadline_ns:
        pass


class RealTime:
    """Makes this process a real-time one. `warnings` says what was not permitted, one line each, with what it costs."""

    def __init__(self, *, priority: int = 80, cpus: Collection[int] = ()):
        """`priority`: of SCHED_FIFO, 1..99 (0: keep the scheduler); `cpus`: where to run (empty: anywhere)."""
        self.warnings: list[str] = []
        self._dma_latency = -1
        if cpus:
            self._bind(cpus)
        if priority:
            self._schedule(priority)
        self._lock_memory()
        self._hold_dma_latency()
        # What exists now lives as long as the process: the collector need not look at it again (it took tens of ms).
        gc.collect()
        gc.freeze()

    def _bind(self, cpus: Collection[int]) -> None:
        there = os.sched_getaffinity(0)
        if not there.intersection(cpus):
            self.warnings.append(
                f"CPUs {sorted(cpus)} are not among this process's {sorted(there)}: it runs on any of those"
            )
            return
        os.sched_setaffinity(0, there.intersection(cpus))

    def _schedule(self, priority: int) -> None:
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
        except (PermissionError, OSError) as error:
            self.warnings.append(
                f"SCHED_FIFO {priority}: {error.strerror}. Under load, periods will be missed; "
                "allow it with rtprio in /etc/security/limits.conf, or run as root"
            )

    def _lock_memory(self) -> None:
        # ONFAULT locks a page when it is first touched: 150 MB instead of 370 MB resident for the daemon's set of libraries.
        everything = _MCL_CURRENT | _MCL_FUTURE
        if _libc.mlockall(everything | _MCL_ONFAULT) == 0:
            return
        if ctypes.get_errno() == errno.EINVAL and _libc.mlockall(everything) == 0:
            return  # a kernel older than 4.4
        self.warnings.append(
            f"mlockall: {os.strerror(ctypes.get_errno())}. A page that was swapped out may delay a cycle by milliseconds; "
            "allow it with memlock in /etc/security/limits.conf, or run as root"
        )

    def _hold_dma_latency(self) -> None:
        # Held open, the request keeps the processor out of sleep states that take long to leave (kernel PM QoS).
        try:
            self._dma_latency = os.open(_DMA_LATENCY, os.O_WRONLY | os.O_CLOEXEC)
            os.write(self._dma_latency, struct.pack("i", 0))
        except FileNotFoundError:
            pass  # this machine has no such sleep states
        except OSError as error:
            self.warnings.append(f"{_DMA_LATENCY}: {error.strerror}. Waking up may take some 10 µs longer")
