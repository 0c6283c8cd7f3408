"""Latest-value streams on their way out: of each, only the newest message waits."""

from __future__ import annotations

import asyncio

import msgspec

from handrail.link.codec import REMOTE_EVENTS
from handrail.messages import spec

_WHOLE_STREAM = ("type",)


class LatestValues:
    """What is waiting to leave, newest only, and the last value of each stream that is one per type, for late clients."""

    def __init__(self, forget_after_s: float):
        """`forget_after_s`: a stream that has been silent for this long has no last value any more."""
        self._forget_after_s = forget_after_s
        self._decoders: dict[str, msgspec.msgpack.Decoder] = {
            name: msgspec.msgpack.Decoder(kind) for name, kind in REMOTE_EVENTS.items() if not spec(kind).reliable
        }
        self._waiting: dict[tuple[object, ...], tuple[bytes, bytes]] = {}
        self._last: dict[bytes, bytes] = {}
        self._heard = -float("inf")
        self._something = asyncio.Event()

    def put(self, kind: type, encoded: bytes, now_s: float) -> None:
        """Take a message; an older one that it supersedes is forgotten. Raises msgspec.DecodeError."""
        name = kind.__name__
        fields = spec(kind).superseded_by
        if fields == _WHOLE_STREAM:
            key: tuple[object, ...] = (name,)
            self._last[name.encode()] = encoded
            # The daemon's two streams live and die together; in lock-step one may stand still while time is held.
            self._heard = now_s
        else:
            message = self._decoders[name].decode(encoded)
            key = (name, *(getattr(message, field) for field in fields))
        # A newer value queues up behind what came before it, so that order among streams is kept too.
        self._waiting.pop(key, None)
        self._waiting[key] = (name.encode(), encoded)
        self._something.set()

    def take(self) -> list[tuple[bytes, bytes]]:
        """(type name, message) of all that is waiting, in order of arrival."""
        waiting = list(self._waiting.values())
        self._waiting.clear()
        self._something.clear()
        return waiting

    async def wait(self) -> None:
        """Until something is waiting."""
        await self._something.wait()

    def last(self, name: bytes, now_s: float) -> bytes | None:
        """The last value of a stream, or None when it never had one or all has been silent for too long."""
        if now_s - self._heard > self._forget_after_s:
            self._last.clear()
        return self._last.get(name)
