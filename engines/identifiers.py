"""Names of what an engine makes: plans, deployments, runs, prompts. Only the first engine's don't say whose: ``run-1a@vision``."""

from __future__ import annotations

import uuid

from handrail.engines import FIRST

_engine = FIRST


def belong_to(engine: str) -> None:
    """From now on this process makes names for that engine."""
    global _engine  # noqa: PLW0603 (a process is one engine)
    _engine = engine


def new(kind: str, digits: int = 8) -> str:
    """A name that nothing else has."""
    name = f"{kind}-{uuid.uuid4().hex[:digits]}"
    return name if _engine == FIRST else f"{name}@{_engine}"
