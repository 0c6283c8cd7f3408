"""Handrail: supervised robot manipulation, from the operator's tablet to the joint's controller."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from handrail.client import Client, connect

__all__ = ["Client", "connect"]


def __getattr__(name: str) -> Any:
    # The client needs sockets and keys; most of the packages that begin with `handrail.` need neither.
    if name in __all__:
        from handrail import client

        return getattr(client, name)
    raise AttributeError(f"module 'handrail' has no attribute {name!r}")
