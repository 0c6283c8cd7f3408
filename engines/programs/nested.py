"""Arguments that hold values deep inside, as a list of references does: their numbers may be expressions, their names texts."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

INSTANCES = frozenset({"follow"})
"""fields that name a resource of kind instance"""
_WORDS = frozenset({"type", "task", "frame", "gripper", "joints"})
"""fields that are words: texts, with {expression} in them; what else is written is an expression"""


def parts(node: Any, path: str, field: str = "") -> Iterator[tuple[str, str, str]]:
    """(where, the field it belongs to, what is written there) of all that is no number."""
    if isinstance(node, dict):
        for name, value in node.items():
            yield from parts(value, f"{path}.{name}", name)
    elif isinstance(node, list):
        for number, value in enumerate(node):
            yield from parts(value, f"{path}[{number}]", field)
    elif isinstance(node, str):
        yield path, field, node


def is_text(field: str) -> bool:
    """What stands there is words."""
    return field in _WORDS


def filled(
    node: Any,
    value: Callable[[str], Any],
    words: Callable[[str], str],
    instance: Callable[[str], Any],
    field: str = "",
) -> Any:
    """The same with every expression's value, every text's words, and every instance that is bound."""
    if isinstance(node, dict):
        return {name: filled(part, value, words, instance, name) for name, part in node.items()}
    if isinstance(node, list):
        return [filled(part, value, words, instance, field) for part in node]
    if not isinstance(node, str):
        return node
    return instance(node) if field in INSTANCES else words(node) if is_text(field) else value(node)
