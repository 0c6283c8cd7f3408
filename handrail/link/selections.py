"""What a client chooses to hear of a type of events: which of them, which of their fields, how often at most. The gate keeps to it.

A selection is a topic of its own (``~LogLine?level=warning|error!``, ``~RobotState@2;time_ns,position!``), so that nobody is sent
what only others have chosen.
"""

from __future__ import annotations

import fnmatch
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import quote, unquote

import msgspec

from handrail.link.codec import REMOTE_EVENTS
from handrail.messages import spec
from handrail.messages.base import Message, travels

MARK, _END = "~", "!"
_MOST = 200
"""selections that all clients have together"""
_LONGEST = 900
"""bytes of a topic (the gate takes no longer ones)"""
_FASTEST_HZ, _SLOWEST_HZ = 1000.0, 1e-3


@travels(priority=5)
class Part(Message):
    """The chosen fields of an event."""

    kind: str
    """name of the event's type"""
    values: dict[str, Any]


@dataclass(frozen=True)
class Selection:
    """What somebody wants to hear of one type of events."""

    kind: type
    rate: float = 0.0
    """Hz, at most; then the newest goes, and what came in between is left out. 0: as they come"""
    fields: tuple[str, ...] = ()
    """those that travel; none: the whole event"""
    where: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """field → patterns (`*` stands for anything), one of which its text, or one of the texts in its list, must match"""

    def __post_init__(self) -> None:
        """Raises ValueError for what no event has."""
        name = self.kind.__name__
        if REMOTE_EVENTS.get(name) is not self.kind:
            raise ValueError(f"events: {name} does not travel over the link; it has {', '.join(REMOTE_EVENTS)}")
        if self.rate and not _SLOWEST_HZ <= self.rate <= _FASTEST_HZ:
            raise ValueError(f"rate: got {self.rate:g} Hz; expected {_SLOWEST_HZ:g} to {_FASTEST_HZ:g} Hz, or 0")
        known = self.kind.__struct_fields__  # type: ignore[attr-defined]
        for chosen in (*self.fields, *self.where):
            if chosen not in known:
                raise ValueError(f"fields: {name} has no field {chosen!r}; expected some of {', '.join(known)}")
        if len(self.topic()) > _LONGEST:
            raise ValueError(f"where: the selection has {len(self.topic())} bytes; expected at most {_LONGEST}")

    def topic(self) -> bytes:
        """The selection as a topic: its end is marked, so that none is the beginning of another."""
        rate = f"@{self.rate:g}" if self.rate else ""
        fields = f";{','.join(self.fields)}" if self.fields else ""
        where = "&".join(
            f"{name}={'|'.join(quote(each, safe='*') for each in self.where[name])}" for name in sorted(self.where)
        )
        return f"{MARK}{self.kind.__name__}{rate}{fields}{'?' if where else ''}{where}{_END}".encode()

    @classmethod
    def read(cls, topic: bytes) -> Selection:
        """Of a topic. Raises ValueError."""
        text = topic.decode("ascii")
        if text[:1] != MARK or text[-1:] != _END:
            raise ValueError(f"selection: got {text!r}; expected it between {MARK} and {_END}")
        head, _, where = text[1:-1].partition("?")
        head, _, fields = head.partition(";")
        name, _, rate = head.partition("@")
        if name not in REMOTE_EVENTS:
            raise ValueError(f"selection: got {name!r}; expected one of {', '.join(REMOTE_EVENTS)}")
        pairs = [pair.partition("=") for pair in where.split("&") if pair]
        return cls(
            REMOTE_EVENTS[name],
            float(rate or 0),
            tuple(each for each in fields.split(",") if each),
            {key: tuple(unquote(each) for each in patterns.split("|")) for key, _, patterns in pairs},
        )

    def wants(self, event: Any) -> bool:
        """Whether it is one of those that were chosen."""
        return all(_matches(getattr(event, name), patterns) for name, patterns in self.where.items())


def _matches(value: Any, patterns: Sequence[str]) -> bool:
    texts = value if isinstance(value, list | tuple) else [value]
    return any(fnmatch.fnmatchcase(str(text), pattern) for text in texts for pattern in patterns)


class _Stream:
    """One selection, and what of it waits until it may go."""

    def __init__(self, selection: Selection):
        self.selection = selection
        # Streams of one value per name (instances, cameras) have a rate for each of them.
        self.key = tuple(each for each in spec(selection.kind).superseded_by if each != "type")
        self.due: dict[tuple[Any, ...], float] = {}
        self.waiting: dict[tuple[Any, ...], bytes] = {}


class Selections:
    """The selections that somebody has, on the gate's side."""

    def __init__(self) -> None:
        self._streams: dict[bytes, _Stream] = {}
        self._decoders: dict[type, msgspec.msgpack.Decoder] = {}
        self._encoder = msgspec.msgpack.Encoder()

    def add(self, topic: bytes) -> Selection:
        """Somebody chose this. Raises ValueError."""
        if len(self._streams) >= _MOST and topic not in self._streams:
            raise ValueError(f"selections: all clients together have {_MOST} already")
        selection = Selection.read(topic)
        self._streams.setdefault(topic, _Stream(selection))
        return selection

    def remove(self, topic: bytes) -> None:
        """Nobody wants it any more."""
        self._streams.pop(topic, None)

    def take(self, name: bytes, encoded: bytes, now_s: float) -> Iterator[tuple[bytes, bytes]]:
        """(topic, message) of all that is to be sent now because of this event. Raises msgspec.DecodeError."""
        event = None
        for topic, stream in self._streams.items():
            selection = stream.selection
            if selection.kind.__name__.encode() != name:
                continue
            key: tuple[Any, ...] = ()
            if selection.where or selection.fields or (stream.key and selection.rate):
                event = self._decoder(selection.kind).decode(encoded) if event is None else event
                if not selection.wants(event):
                    continue
                key = tuple(getattr(event, each) for each in stream.key)
            data = encoded
            if selection.fields:
                values = {each: getattr(event, each) for each in selection.fields}
                data = self._encoder.encode(Part(kind=selection.kind.__name__, values=values))
            if not selection.rate:
                yield topic, data
            elif now_s >= stream.due.get(key, -math.inf):
                stream.due[key] = now_s + 1 / selection.rate
                stream.waiting.pop(key, None)
                yield topic, data
            else:
                stream.waiting[key] = data

    def due(self, now_s: float) -> Iterator[tuple[bytes, bytes]]:
        """(topic, message) of what has waited for its turn."""
        for topic, stream in self._streams.items():
            for key in [key for key in stream.waiting if stream.due[key] <= now_s]:
                stream.due[key] = now_s + 1 / stream.selection.rate
                yield topic, stream.waiting.pop(key)

    @property
    def next_due_s(self) -> float:
        """When `due` has something to give; infinite when nothing waits."""
        return min((stream.due[key] for stream in self._streams.values() for key in stream.waiting), default=math.inf)

    def _decoder(self, kind: type) -> msgspec.msgpack.Decoder:
        return self._decoders.setdefault(kind, msgspec.msgpack.Decoder(kind))
