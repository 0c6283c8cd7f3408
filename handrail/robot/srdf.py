"""Semantic robot descriptions (SRDF, as MoveIt writes them): which pairs of links are not checked for collision."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path


def disabled_pairs(file: Path) -> tuple[tuple[str, str], ...]:
    """Names of links that may touch. Raises ValueError naming the file for what is no SRDF, OSError."""
    try:
        root = ET.parse(file).getroot()
    except ET.ParseError as problem:
        raise ValueError(f"{file} is not an SRDF: {problem}") from problem
    if root.tag != "robot":
        raise ValueError(f"{file}: got an element {root.tag!r}; expected an SRDF's 'robot'")
    pairs = [(entry.get("link1", ""), entry.get("link2", "")) for entry in root.iter("disable_collisions")]
    if any(not (one and other) for one, other in pairs):
        raise ValueError(f"{file}: disable_collisions: got one without link1 or link2; expected both")
    return tuple(pairs)
