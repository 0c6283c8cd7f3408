"""Latest-value streams on their way out: of each, only the newest message waits."""

from __future__ import annotations

import asyncio

import msgspec

from handrail.link.codec import REMOTE_EVENTS
from handrail.messages import PointCloud, spec

_WHOLE_STREAM = ("type",)


class LatestValues:
    """What is waiting to leave, newest only, and for late clients the last value of what no snapshot holds.

    That is: of each stream that is one per type, and of each camera. Instances and plans are in the engine's snapshot.
    """

    def __init__(self, forget_after_s: float):
        """`forget_after_s`: a stream that has been silent for this long has no last value any more."""
        self._forget_after_s = forget_after_s
        self._decoders: dict[str, msgspec.msgpack.Decoder] = {
            name: msgspec.msgpack.Decoder(kind) for name, kind in REMOTE_EVENTS.items() if not spec(kind).reliable
        }
        self._waiting: dict[tuple[object, ...], tuple[bytes, bytes]] = {}
        self._last: dict[bytes, dict[tuple[object, ...], bytes]] = {}
        self._heard = -float("inf")
        self._something = asyncio.Event()

    def put(self, kind: type, encoded: bytes, now_s: float) -> None:
        """Take a message; an older one that it supersedes is forgotten. Raises msgspec.DecodeError."""
        name = kind.__name__
        fields = spec(kind).superseded_by
        if fields == _WHOLE_STREAM:
            key: tuple[object, ...] = (name,)
        else:
            message = self._decoders[name].decode(encoded)
            key = (name, *(getattr(message, field) for field in fields))
        if fields == _WHOLE_STREAM or kind is PointCloud:
            self._last.setdefault(name.encode(), {})[key] = encoded
            # They live and die together; in lock-step some may stand still while time is held.
            self._heard = now_s
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

    def last(self, name: bytes, now_s: float) -> list[bytes]:
        """The last values of the streams of a type: none when there never were any or all has been silent for too long."""
        if now_s - self._heard > self._forget_after_s:
            self._last.clear()
        return list(self._last.get(name, {}).values())
