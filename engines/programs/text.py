"""Texts with values in them: ``turned {turned_deg:.0f}° of {goal_deg}°``."""

from __future__ import annotations

import string
from collections.abc import Callable
from typing import Any


def fields(text: str) -> list[str]:
    """The expressions in a text. Raises ValueError where braces or formats are wrong."""
    found = []
    for _, name, spec, conversion in string.Formatter().parse(text):
        if name is None:
            continue
        if not name.strip() or conversion or "{" in (spec or ""):
            raise ValueError(f"{{{name}}} in {text!r} is not an expression")
        found.append(name.strip())
    return found


def fill(text: str, value: Callable[[str], Any]) -> str:
    """The text with each expression replaced by its formatted value; a format that does not fit the value is left out."""
    parts = []
    for literal, name, spec, _ in string.Formatter().parse(text):
        parts.append(literal)
        if name is None:
            continue
        found = value(name.strip())
        try:
            parts.append(format(found, spec or ""))
        except (TypeError, ValueError):
            parts.append(str(found))
    return "".join(parts)
