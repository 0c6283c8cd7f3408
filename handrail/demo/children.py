"""The demo's child processes: each in a session of its own, its words in a log, and none left behind."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

_PATIENCE_S = 8.0
_TAIL = 15


class ChildDied(Exception):
    """A process that should run has ended; the text has its last words and where the rest is."""


class Child:
    """One process. Lines on its stdout are looked at as they come; stdout and stderr go to a log file."""

    def __init__(self, name: str, command: list[str], log: Path, on_line: Callable[[str], None] | None = None):
        self.name, self.log = name, log
        log.parent.mkdir(parents=True, exist_ok=True)
        self._on_line = on_line or (lambda _: None)
        self._stream = log.open("ab", buffering=0)
        # A session of its own: Ctrl-C reaches us alone, and we end it in order.
        self.process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=self._stream,
            start_new_session=True,
            env=os.environ | {"PYTHONUNBUFFERED": "1"},
        )
        self._lines: list[str] = []
        self._silent = False
        """its stdout is closed: it has ended, or is about to"""
        self._changed = threading.Condition()
        self._reader = threading.Thread(target=self._read, name=f"log-{name}", daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self._stream.write(line)
            text = line.decode(errors="replace").strip()
            with self._changed:
                self._lines.append(text)
                self._changed.notify_all()
            self._on_line(text)
        with self._changed:
            self._silent = True
            self._changed.notify_all()

    def wait_for(self, beginning: str, timeout_s: float) -> None:
        """Wait for a line of its stdout that begins like this. Raises ChildDied, also when the line doesn't come in time."""
        with self._changed:
            self._changed.wait_for(lambda: self._said(beginning) or self._silent, timeout_s)
            if self._said(beginning):
                return
        if self._silent:
            with contextlib.suppress(subprocess.TimeoutExpired):
                self.process.wait(1.0)
        self.check()
        raise ChildDied(f"{self.name} did not say “{beginning}” in {timeout_s:g} s\n{self.last_words()}")

    def _said(self, beginning: str) -> bool:
        return any(line.startswith(beginning) for line in self._lines)

    def check(self) -> None:
        """Raises ChildDied if it has ended."""
        if (status := self.process.poll()) is not None:
            raise ChildDied(f"{self.name} ended with status {status}\n{self.last_words()}")

    def last_words(self) -> str:
        """The end of its log, and where the log is."""
        lines = self.log.read_text(errors="replace").splitlines()[-_TAIL:] if self.log.exists() else []
        return "\n".join([*(f"  | {line}" for line in lines), f"  its log: {self.log}"])

    def end(self, patience_s: float = _PATIENCE_S) -> None:
        """SIGTERM, and SIGKILL to whatever of its session is left after `patience_s`."""
        if self.process.poll() is None:
            self.process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self.process.wait(patience_s)
        with contextlib.suppress(ProcessLookupError):  # nobody is left, as it should be
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        self._reader.join(1.0)
        self._stream.close()


class Children:
    """All of them; ends them in reverse order, whatever happened."""

    def __init__(self, logs: Path):
        self._logs = logs
        self._all: list[Child] = []

    def start(self, name: str, command: list[str], on_line: Callable[[str], None] | None = None) -> Child:
        child = Child(name, command, self._logs / f"{name}.log", on_line)
        self._all.append(child)
        return child

    def end(self) -> None:
        with _undisturbed():
            while self._all:
                self._all.pop().end()

    def __enter__(self) -> Children:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()


@contextlib.contextmanager
def _undisturbed() -> Iterator[None]:
    """A second Ctrl-C does not keep children from being ended (each is given so long and no longer)."""
    if threading.current_thread() is not threading.main_thread():
        yield  # signals reach the main thread only
        return
    before = {number: signal.signal(number, signal.SIG_IGN) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
