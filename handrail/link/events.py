"""A client's stream of events: a queue in which latest-value messages replace older ones."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from handrail.messages import spec

_MOST_WAITING = 20_000


@dataclass(frozen=True)
class Live:
    """The stream is complete from here on: it has just begun, or begun anew after the connection was lost.

    Whoever keeps a picture of the robot takes a `snapshot()` now.
    """


class Events:
    """Events of chosen types, in order. Made by `Client.events`; safe to use from one thread while another closes it.

    Iterating waits for the next event and ends when the stream (or its client) is closed. Reliable events all arrive, in order;
    of a latest-value stream only the newest unread one waits.
    """

    def __init__(self, kinds: tuple[type, ...], on_close: Callable[[Events], None]):
        self.kinds = kinds
        self.dropped = 0
        """events lost because more than 20,000 were left unread"""
        self._on_close = on_close
        self._changed = threading.Condition()
        self._waiting: dict[Any, Any] = {}
        self._count = 0
        self._live = threading.Event()
        self._closed = False
        self._tell: Callable[[], None] = _nobody

    def next(self, timeout_s: float | None = None) -> Any | None:
        """The next event; None when none came in time or the stream is closed (None waits for ever, 0 does not wait)."""
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        with self._changed:
            while not self._waiting and not self._closed:
                remaining = None if deadline is None else deadline - time.monotonic()
                if remaining is not None and remaining <= 0:
                    return None
                self._changed.wait(remaining)
            if not self._waiting:
                return None
            return self._waiting.pop(next(iter(self._waiting)))

    def drain(self) -> list[Any]:
        """All events that wait, without waiting."""
        with self._changed:
            waiting = list(self._waiting.values())
            self._waiting.clear()
            return waiting

    def __iter__(self) -> Iterator[Any]:
        while (event := self.next()) is not None:
            yield event

    @property
    def closed(self) -> bool:
        return self._closed

    def on_change(self, tell: Callable[[], None]) -> None:
        """Call `tell` whenever an event came or the stream ended, in the session's thread: for loops that wait elsewhere."""
        self._tell = tell

    def wait_live(self, timeout_s: float | None = None) -> bool:
        """Wait until the robot's side has confirmed the stream; False when it has not in time."""
        return self._live.wait(timeout_s)

    def close(self) -> None:
        """End the stream; whoever waits for it returns."""
        if not self._closed:
            self._end()
            self._on_close(self)

    def __enter__(self) -> Events:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # ------------------------------------------------------------------------------------- called by the session's thread

    def _put(self, event: Any) -> None:
        kind = type(event)
        self._count += 1
        key: Any = self._count
        if kind is not Live and not spec(kind).reliable:
            fields = spec(kind).superseded_by
            key = (kind, *(getattr(event, field) for field in fields if field != "type"))
        with self._changed:
            self._waiting.pop(key, None)
            self._waiting[key] = event
            if len(self._waiting) > _MOST_WAITING:
                self._waiting.pop(next(iter(self._waiting)))
                self.dropped += 1
            self._changed.notify()
        self._tell()

    def _went_live(self) -> None:
        if Live in self.kinds:
            self._put(Live())
        self._live.set()

    def _end(self) -> None:
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        self._tell()


def _nobody() -> None:
    pass
