"""Whoever waits for a plan: may cancel it, and is told in a few words what is being done."""

from __future__ import annotations

from collections.abc import Callable


class Cancelled(Exception):
    """Planning was told to stop."""


def never() -> bool:
    """Where nobody cancels."""
    return False


def quiet(_: str) -> None:
    """Where nobody wants to be told."""


def go_on(cancelled: Callable[[], bool]) -> None:
    """Raises Cancelled where it says True."""
    if cancelled():
        raise Cancelled("planning was cancelled")
