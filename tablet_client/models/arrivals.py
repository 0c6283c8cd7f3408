"""What reaches the models: messages from the robot, and the session's own news about the connection and about calls.

`Inbox` stands between the network's threads and the window. Streams keep their latest value only (as each message's spec says),
so a window that is busy drawing falls behind by one state, never by a queue of them.
"""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from handrail.messages import DaemonStatus, EngineSnapshot, Message, RobotInfo, spec


@dataclass(frozen=True)
class Attached:
    """The robot answers (anew)."""

    info: RobotInfo
    status: DaemonStatus


@dataclass(frozen=True)
class Unanswered:
    """The robot does not answer: not yet, or not any more. The session goes on trying."""

    tries: int
    why: str


@dataclass(frozen=True)
class EngineAttached:
    """The engine answers (anew): all that it has."""

    snapshot: EngineSnapshot


@dataclass(frozen=True)
class EngineDetached:
    """The robot answers, its engine does not."""

    why: str


@dataclass(frozen=True)
class CallDone:
    """A call was answered."""

    call: Message
    answer: Any


@dataclass(frozen=True)
class CallFailed:
    """A call was refused, or not answered (`refused` False: nobody knows whether it was carried out)."""

    call: Message
    why: str
    refused: bool


@dataclass(frozen=True)
class StopProgress:
    """How a STOP fares: `sending` (attempt n), `answered`, or `failed` when the session gave up."""

    state: str
    attempt: int
    why: str = ""


@dataclass(frozen=True)
class Pinged:
    """A call that asks for nothing but whose key this is has come back, or has not."""

    at: float
    """s, monotonic"""
    took_s: float | None
    """there and back; None: no answer in time"""
    received: Mapping[str, int]
    """bytes so far on this connection by type of event; of answers under the empty name"""
    name: str = ""
    """that this window's key has at the robot"""
    role: str = ""
    """and what it may; both empty where the robot did not say"""
    commander: str = ""
    """name of the key that has the command; empty: whoever is connected may command"""


class Inbox:
    """Thread-safe, and small whatever happens: `put` from any thread, `take` from the window's."""

    def __init__(self, wake: Callable[[], None] | None = None, limit: int = 5000):
        """`wake` is called, on the putting thread, when the inbox stops being empty. Beyond `limit` the oldest item goes."""
        self._wake = wake
        self._limit = limit
        self._lock = threading.Lock()
        self._items: dict[Any, Any] = {}
        self._held: list[Any] | None = None
        self._number = itertools.count()
        self.dropped = 0

    def put(self, item: Any) -> None:
        with self._lock:
            if self._held is not None and isinstance(item, Message):
                self._held.append(item)
                return
            wake = self._add(item)
        if wake and self._wake is not None:
            self._wake()

    def hold(self) -> None:
        """Keep events back while a snapshot is fetched: one that the snapshot does not contain must come after it."""
        with self._lock:
            self._held = self._held or []

    def release(self, *first: Any) -> None:
        """Let `first` through (the snapshot), then the events that were kept back."""
        with self._lock:
            held, self._held = self._held or [], None
            wake = False
            for item in (*first, *held):
                wake |= self._add(item)
        if wake and self._wake is not None:
            self._wake()

    def take(self) -> list[Any]:
        """Everything that has arrived, oldest first."""
        with self._lock:
            items, self._items = list(self._items.values()), {}
        return items

    def _add(self, item: Any) -> bool:
        was_empty = not self._items
        key = _key(item) or (next(self._number),)
        self._items.pop(key, None)
        self._items[key] = item
        if len(self._items) > self._limit:
            self._items.pop(next(iter(self._items)))
            self.dropped += 1
        return was_empty


def _key(item: Any) -> tuple[Any, ...] | None:
    """What a newer item replaces; None for items that must all arrive."""
    if not isinstance(item, Message) or spec(type(item)).reliable:
        return None
    fields = spec(type(item)).superseded_by
    return type(item).__name__, *(getattr(item, field) for field in fields if field != "type")
