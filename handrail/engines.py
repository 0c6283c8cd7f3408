"""A robot's engines by name: what a name may be, where each meets the others, and which one a call is for."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from typing import Any

from handrail.runtime import Runtime

FIRST = "engine"
"""the engine that owns instances, and the plans that operators ask for"""
_NAME = re.compile(r"[a-z][a-z0-9_\-]{0,12}")  # a Unix socket's path has no room for more (handrail.runtime)
_OTHERS = frozenset({"daemon", "sensors", "plant", "link", "loop", "server", "camera", "recorder", "instances", "run"})
_LOCK = ".engine"


def checked(name: str) -> str:
    """The name. Raises ValueError where an engine can't have it."""
    if not _NAME.fullmatch(name) or name in _OTHERS:
        raise ValueError(
            f"engine: got {name!r}; expected up to 13 small letters, digits, - or _, and no other process's name"
        )
    return name


def lock(runtime: Runtime, name: str) -> str:
    """The file that an engine of this name holds while it runs (handrail.sole_holder)."""
    return str(runtime.folder / f"{name}{_LOCK}")


def running(runtime: Runtime) -> Iterator[str]:
    """The names of the engines that run on this machine, the first one first."""
    names = sorted(file.stem for file in runtime.folder.glob(f"*{_LOCK}") if _NAME.fullmatch(file.stem) and _held(file))
    yield from sorted(names, key=lambda name: name != FIRST)


def _held(file: os.PathLike[str]) -> bool:
    try:
        with open(file, encoding="ascii") as lock_file:
            os.kill(int(lock_file.read()), 0)
    except (OSError, ValueError):
        return False
    return True


def of(call: Any) -> str:
    """Which engine a call is for: that which it names, else that which made what it is about (``run-1a2b@vision``)."""
    if engine := getattr(call, "engine", ""):
        return str(engine)
    for field in ("id", "deployment", "after"):
        _, at, engine = str(getattr(call, field, "")).partition("@")
        if at:
            return engine
    return FIRST
