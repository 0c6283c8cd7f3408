"""Child processes that make up a robot's service: started in order, watched, started anew with back-off, ended in reverse order.

A child says `NAME ready` on its standard output when it can serve. One thread, and no timer but the back-off: the supervisor
sleeps on the children's pipes and on their pidfds. The kernel ends the children should the supervisor be killed.
"""

from __future__ import annotations

import ctypes
import enum
import os
import selectors
import signal
import subprocess
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import IO, Protocol

from daemon.serving.health import ProcessTold
from handrail.messages.processes import MOST_LINES

_PR_SET_PDEATHSIG = 1
_libc = ctypes.CDLL(None, use_errno=True)

FIRST_DELAY_S, LONGEST_DELAY_S = 0.25, 10.0
"""before a child is started anew; doubled at every death"""
STEADY_S = 10.0
"""a child that was ready for so long before it died is started anew after the first delay again"""
_LINES_S = 0.1
"""between two times that last words are told"""
END_S = 2.0
"""from SIGTERM to SIGKILL"""
_LONGEST_LINE = 500
"""characters that are kept of a line"""
_RESTART_S = 0.2
"""from the word to the end: whoever carried it may be the one that ends, and has an answer to bring"""


@dataclass(frozen=True)
class Child:
    """A process to keep alive."""

    name: str
    command: tuple[str, ...]
    after: tuple[str, ...] = ()
    """children that must be ready before this one starts"""
    bound_to: tuple[str, ...] = ()
    """children whose death means that this one is ended and started anew, after them"""
    ready_s: float = 240.0
    """from start to `NAME ready`; one that takes longer counts as dead. The first start after kernels have changed compiles them:
    a minute of a processor's time"""
    says: str = ""
    """the name in its `NAME ready`, where that is not its own"""
    keep: bool = True
    """False: one that has ended is forgotten, however it ended"""


class State(enum.Enum):
    WAITING = "waiting"
    STARTING = "starting"
    UP = "up"
    BACK_OFF = "back-off"


class HasFileno(Protocol):
    """What can be waited for, as a socket can."""

    def fileno(self) -> int: ...


class StartError(RuntimeError):
    """A child did not become ready at the first start; everything has been ended again."""

    def __init__(self, name: str, problem: str, status: int | None):
        self.name, self.problem, self.status = name, problem, status
        super().__init__(f"{name} {problem}")


@dataclass
class _Kept:
    child: Child
    state: State = State.WAITING
    process: subprocess.Popen[bytes] | None = None
    pidfd: int = -1
    since: float = 0.0
    """when it entered its state"""
    delay_s: float = FIRST_DELAY_S
    start_at: float = 0.0
    deaths: int = 0
    ever_up: bool = False
    restart_at: float | None = None
    """when it is to be ended and started anew, though it is well"""
    said: deque[tuple[float, str]] = field(default_factory=lambda: deque(maxlen=MOST_LINES))
    """(s, monotonic, line) said by it or about it"""
    partial: dict[str, bytes] = field(default_factory=dict)
    """by stream, the line that has not ended yet"""

    def stream(self, what: str) -> IO[bytes] | None:
        """The pipe `out` or `err`; None without a process."""
        if self.process is None:
            return None
        return self.process.stdout if what == "out" else self.process.stderr

    @property
    def last(self) -> str:
        """The last line said by it or about it."""
        return self.said[-1][1] if self.said else ""


class Supervisor:
    """Keeps children alive. Not for more than one thread: the children end with the thread that started them."""

    def __init__(
        self,
        children: Sequence[Child],
        *,
        report: Callable[[str, str], None],
        environment: Mapping[str, str] | None = None,
    ):
        """`report(name, text)` is called for every line of a child and every change; `environment`: added to this one's."""
        names = [child.name for child in children]
        for child in children:
            for other in (*child.after, *child.bound_to):
                if other not in names[: names.index(child.name)]:
                    raise ValueError(
                        f"{child.name} waits for {other!r}: expected one of {names[: names.index(child.name)]}"
                    )
        self._kept = {child.name: _Kept(child) for child in children}
        self._report = report
        self._environment = {**os.environ, **(environment or {})}
        self._selector = selectors.DefaultSelector()
        self._wake_read, self._wake_write = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        self._selector.register(self._wake_read, selectors.EVENT_READ, ("wake", None))
        self._end_asked = False
        self.on_health: Callable[[dict[str, str]], None] = lambda health: None
        """called with `health()` at every change"""
        self.on_processes: Callable[[list[ProcessTold]], None] = lambda processes: None
        """called when a state has changed, and for new last words at most ten times a second"""
        self._told_at, self._untold = 0.0, False

    def health(self) -> dict[str, str]:
        """Child → `up`, `starting`, `waiting`, or `down, starting anew` with the count of its deaths."""
        told = {}
        for name, kept in self._kept.items():
            deaths = f" (died {kept.deaths} times)" if kept.deaths > 1 else " (died once)" if kept.deaths else ""
            told[name] = "down, starting anew" + deaths if kept.state is State.BACK_OFF else kept.state.value + deaths
        return told

    def processes(self) -> list[ProcessTold]:
        """All children, in the order of their start."""
        now = time.time() - time.monotonic()
        return [
            ProcessTold(name, kept.state.value, self.pid(name), now + kept.since, kept.deaths, kept.last)
            for name, kept in self._kept.items()
        ]

    def pid(self, name: str) -> int | None:
        """The process of a child, None while it has none."""
        process = self._kept[name].process
        return process.pid if process is not None else None

    def log(self, name: str, lines: int) -> list[tuple[float, str]]:
        """(age in s, line) of the last lines that a child said, or that were said about it, oldest first. Raises KeyError."""
        now = time.monotonic()
        return [(now - at, line) for at, line in list(self._kept[name].said)[-lines:]]

    def restart(self, name: str, why: str) -> None:
        """End a child in a moment, with those bound to it, and start them anew; one that waits out its back-off starts now.

        Raises KeyError.
        """
        kept = self._kept[name]
        self._say(name, why)
        kept.delay_s = FIRST_DELAY_S
        if kept.process is not None:
            kept.restart_at = time.monotonic() + _RESTART_S
        elif kept.state is State.BACK_OFF:
            kept.start_at = time.monotonic()

    def add(self, child: Child) -> None:
        """Start one more, after all the others. Raises ValueError where there is one of that name."""
        if child.name in self._kept:
            raise ValueError(f"{child.name} is there already")
        self._kept[child.name] = _Kept(child)

    def ask_to_end(self, name: str) -> None:
        """SIGTERM, and no waiting: for one that is not kept. Raises KeyError."""
        kept = self._kept[name]
        if kept.process is not None:
            signal.pidfd_send_signal(kept.pidfd, signal.SIGTERM)
        elif not kept.child.keep:
            del self._kept[name]

    def hear(self, source: int | HasFileno, call: Callable[[], None]) -> None:
        """Have `call` called whenever there is something to read at `source`, until it is told to `forget` it."""
        self._selector.register(source, selectors.EVENT_READ, ("heard", call))

    def forget(self, source: int | HasFileno) -> None:
        """The opposite of `hear`."""
        self._selector.unregister(source)

    @property
    def all_up(self) -> bool:
        return all(kept.state is State.UP for kept in self._kept.values())

    @property
    def wake_fd(self) -> int:
        """Non-blocking file descriptor; a byte written to it ends a wait in `step` (for `signal.set_wakeup_fd`)."""
        return self._wake_write

    def ask_end(self) -> None:
        """Make `run` and `start` return soon. May be called from a signal handler."""
        self._end_asked = True
        os.write(self._wake_write, b"!")

    def start(self) -> bool:
        """Start all, each as soon as those before it are ready. False: `ask_end` came first.

        Raises StartError, with everything ended, when one dies or does not become ready.
        """
        try:
            while not self._end_asked and not self.all_up:
                self.step(None, first_start=True)
        except StartError:
            self.end()
            raise
        return not self._end_asked

    def run(self) -> None:
        """Keep them alive until `ask_end`."""
        while not self._end_asked:
            self.step(None)

    def step(self, timeout_s: float | None, *, first_start: bool = False) -> None:
        """Start what may start, then deal with what happens within `timeout_s` (None: until something does)."""
        now = time.monotonic()  # the same for both: what falls due between two looks would never be woken for
        for kept in self._kept.values():
            if kept.restart_at is not None and now >= kept.restart_at:
                self._anew(kept)
        self._start_due(now)
        if self._untold and now - self._told_at >= _LINES_S:
            self._tell_processes()
        due = self._next_due(now)
        if due is not None:
            timeout_s = due if timeout_s is None else min(due, timeout_s)
        died = []
        for key, _ in self._selector.select(timeout_s):
            what, kept = key.data
            if what == "wake":
                os.read(self._wake_read, 64)
            elif what == "heard":
                kept()
            elif what == "dead":
                died.append(kept)
            else:
                self._read(kept, what)
        now = time.monotonic()
        for kept in self._kept.values():
            if kept.state is State.STARTING and now - kept.since > kept.child.ready_s and kept not in died:
                self._say(kept.child.name, f"is not ready after {kept.child.ready_s:g} s: ended")
                self._kill(kept)
                died.append(kept)
        for kept in died:
            if kept.process is None:
                continue  # ended along with another that died in the same moment
            self._died(kept, first_start=first_start)

    def end(self) -> None:
        """End all in reverse order: SIGTERM, and SIGKILL to what is still there 2 s later. Their last lines are reported."""
        for kept in reversed(self._kept.values()):
            self._end_one(kept)
            kept.state = State.WAITING
        self._tell_health()

    def close(self) -> None:
        """End all and free the supervisor's own descriptors."""
        self.end()
        self._selector.close()
        os.close(self._wake_read)
        os.close(self._wake_write)

    # -------------------------------------------------------------------------------------------------- start

    def _start_due(self, now: float) -> None:
        for kept in self._kept.values():
            due = kept.state is State.WAITING or (kept.state is State.BACK_OFF and now >= kept.start_at)
            needs = (*kept.child.after, *kept.child.bound_to)
            if due and not self._end_asked and all(self._kept[name].state is State.UP for name in needs):
                self._spawn(kept)

    def _next_due(self, now: float) -> float | None:
        """s until a back-off or the patience with a start ends."""
        moments = [
            kept.start_at for kept in self._kept.values() if kept.state is State.BACK_OFF and kept.start_at > now
        ]
        moments += [kept.restart_at for kept in self._kept.values() if kept.restart_at is not None]
        if self._untold:
            moments.append(self._told_at + _LINES_S)
        moments += [kept.since + kept.child.ready_s for kept in self._kept.values() if kept.state is State.STARTING]
        return max(0.0, min(moments) - now + 1e-3) if moments else None

    def _spawn(self, kept: _Kept) -> None:
        parent = os.getpid()

        def die_with_parent() -> None:
            _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
            if os.getppid() != parent:  # it died before we asked
                os._exit(1)

        # A session of its own: Ctrl-C at the terminal reaches the supervisor alone, which ends the children in order.
        kept.process = subprocess.Popen(
            kept.child.command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env=self._environment,
            start_new_session=True,
            preexec_fn=die_with_parent,  # noqa: PLW1509 - one thread only; nothing in the standard library sets it otherwise
        )
        kept.pidfd = os.pidfd_open(kept.process.pid)
        kept.partial = {"out": b"", "err": b""}
        self._selector.register(kept.pidfd, selectors.EVENT_READ, ("dead", kept))
        for what in ("out", "err"):
            stream = kept.stream(what)
            assert stream is not None
            os.set_blocking(stream.fileno(), False)
            self._selector.register(stream, selectors.EVENT_READ, (what, kept))
        self._enter(kept, State.STARTING)

    def _enter(self, kept: _Kept, state: State) -> None:
        kept.state, kept.since = state, time.monotonic()
        self._tell_health()

    def _tell_health(self) -> None:
        self.on_health(self.health())
        self._tell_processes()

    def _tell_processes(self) -> None:
        self._told_at, self._untold = time.monotonic(), False
        self.on_processes(self.processes())

    def _say(self, name: str, text: str) -> None:
        """A line of a child, or about it."""
        self._report(name, text)
        self._kept[name].said.append((time.monotonic(), text[:_LONGEST_LINE]))
        self._untold = True

    # -------------------------------------------------------------------------------------------------- watch

    def _read(self, kept: _Kept, what: str) -> bool:
        """Report the lines that have come; the child's `NAME ready` takes it up. False: there is no more now."""
        stream = kept.stream(what)
        if stream is None or stream.closed:
            return False
        try:
            data = os.read(stream.fileno(), 1 << 16)
        except BlockingIOError:
            return False
        if not data:
            self._selector.unregister(stream)
            stream.close()
        *lines, kept.partial[what] = (kept.partial[what] + data).split(b"\n")
        if not data and kept.partial[what]:
            lines, kept.partial[what] = [kept.partial[what]], b""
        for line in lines:
            text = line.decode(errors="replace").rstrip()
            if what == "out" and text == f"{kept.child.says or kept.child.name} ready" and kept.state is State.STARTING:
                took = time.monotonic() - kept.since
                kept.ever_up = True
                self._enter(kept, State.UP)
                self._say(kept.child.name, f"up after {took:.1f} s")
            elif text:
                self._say(kept.child.name, text)
        return bool(data)

    def _died(self, kept: _Kept, *, first_start: bool) -> None:
        steady = kept.state is State.UP and time.monotonic() - kept.since > STEADY_S
        problem, status = self._bury(kept)
        if not kept.child.keep:
            self._say(kept.child.name, problem)
            del self._kept[kept.child.name]
            self._tell_health()
            return
        if first_start and not kept.ever_up:
            kept.state = State.WAITING
            raise StartError(kept.child.name, problem, status)
        kept.deaths += 1
        if steady:
            kept.delay_s = FIRST_DELAY_S
        self._say(kept.child.name, f"{problem}; starting it anew in {kept.delay_s:g} s")
        self._back_off(kept, kept.delay_s)
        kept.delay_s = min(2 * kept.delay_s, LONGEST_DELAY_S)
        for other in self._kept.values():
            if kept.child.name in other.child.bound_to and other.process is not None:
                self._say(other.child.name, f"ended, since it can't go on without {kept.child.name}")
                self._end_one(other)
                self._back_off(other, 0.0)

    def _anew(self, kept: _Kept) -> None:
        kept.restart_at = None
        if kept.process is None:
            return  # it has died meanwhile, and its back-off runs
        name = kept.child.name
        bound = [other for other in self._kept.values() if name in other.child.bound_to and other.process is not None]
        for other in bound:
            self._say(other.child.name, f"ended, since {name} is started anew")
        for each in (*bound, kept):
            self._end_one(each)
            self._back_off(each, 0.0)

    def _back_off(self, kept: _Kept, delay_s: float) -> None:
        kept.start_at = time.monotonic() + delay_s
        self._enter(kept, State.BACK_OFF)

    # -------------------------------------------------------------------------------------------------- end

    def _bury(self, kept: _Kept) -> tuple[str, int | None]:
        """Read what a dead child left and forget its process. In words how it ended, and its exit status."""
        process = kept.process
        assert process is not None
        self._kill(kept)  # what it started itself and left behind: its number stays its own until it is waited for
        status = process.wait()
        self._selector.unregister(kept.pidfd)
        os.close(kept.pidfd)
        for what in ("out", "err"):
            # A grandchild may hold the pipe open: read what is there, then let go of it.
            while self._read(kept, what):
                pass
            stream = kept.stream(what)
            if stream is not None and not stream.closed:
                self._selector.unregister(stream)
                stream.close()
        kept.process, kept.pidfd = None, -1
        if status < 0:
            return f"was ended by {signal.Signals(-status).name}", status
        return f"ended with exit status {status}", status

    def _end_one(self, kept: _Kept) -> None:
        if kept.process is None:
            return
        signal.pidfd_send_signal(kept.pidfd, signal.SIGTERM)
        # Everybody's pipes are read meanwhile, so that none blocks on a full one.
        with selectors.DefaultSelector() as watched:
            watched.register(kept.pidfd, selectors.EVENT_READ, ("dead", kept))
            for key in self._selector.get_map().values():
                if key.data[0] in ("out", "err"):
                    watched.register(key.fileobj, selectors.EVENT_READ, key.data)
            deadline = time.monotonic() + END_S
            dead = False
            while not dead:
                if (left := deadline - time.monotonic()) <= 0:
                    self._say(kept.child.name, f"did not end within {END_S:g} s of SIGTERM: killed")
                    self._kill(kept)
                    break
                for key, _ in watched.select(left):
                    what, other = key.data
                    if what == "dead":
                        dead = True
                    elif not self._read(other, what):
                        watched.unregister(key.fileobj)
        self._bury(kept)

    @staticmethod
    def _kill(kept: _Kept) -> None:
        assert kept.process is not None
        os.killpg(kept.process.pid, signal.SIGKILL)
