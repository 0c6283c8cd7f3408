"""What all messages are made of: how they travel, a pose, and the two answers that any call may get."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, TypeVar

import msgspec
from msgspec import Meta

Name = Annotated[str, Meta(min_length=1, max_length=128)]
Positive = Annotated[float, Meta(gt=0)]


NonNegative = Annotated[float, Meta(ge=0)]
Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Spec:
    """How a message travels."""

    priority: int = 5
    """0 is first: stop 0, commands 1, prompts and run states 2, robot state 4, logs 7."""
    reliable: bool = True
    """False: latest value only; an older one still unsent is dropped."""
    superseded_by: tuple[str, ...] = ()
    """A newer message of this type with the same values in these fields replaces this one (latest-value streams)."""
    remote: bool = False
    """True: may enter or leave through the link."""


_SPECS: dict[type, Spec] = {}
_M = TypeVar("_M", bound=type)


def travels(
    *, priority: int, reliable: bool = True, superseded_by: tuple[str, ...] = (), remote: bool = False
) -> Callable[[_M], _M]:
    def note(kind: _M) -> _M:
        _SPECS[kind] = Spec(priority, reliable, superseded_by, remote)
        return kind

    return note


def spec(kind: type) -> Spec:
    """How messages of this type travel."""
    return _SPECS[kind]


class Message(msgspec.Struct, tag_field="type", tag=True, kw_only=True, forbid_unknown_fields=True):
    """Base of all messages."""

    Reply: ClassVar[Any] = None
    """For calls: the type of the answer (None: an empty answer)."""


class Pose(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """position m, orientation unit quaternion (x, y, z, w)."""

    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    orientation: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)


class Ok(Message):
    """A call was carried out and has nothing to say."""


class Refused(Message):
    """A call was not carried out; nothing has changed."""

    message: str
    field: str = ""
    value: str = ""
    expected: str = ""
