"""What is different between two programs: field by field, not line by line."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from engines.programs.program import Program


def differences(old: Program, new: Program) -> list[str]:
    """A line a field: `+` only the new one has it, `-` only the old one, `~` another value. Comments and order count not."""
    before, after = dict(_leaves(old.document.data, "")), dict(_leaves(new.document.data, ""))
    lines = []
    for path in dict.fromkeys([*before, *after]):
        if path not in after:
            lines.append(f"- {path}: {_shown(before[path])}")
        elif path not in before:
            lines.append(f"+ {path}: {_shown(after[path])}")
        elif before[path] != after[path]:
            lines.append(f"~ {path}: {_shown(before[path])} → {_shown(after[path])}")
    return lines


def _leaves(node: Any, path: str) -> Iterator[tuple[str, Any]]:
    if isinstance(node, Mapping) and node:
        for key, value in node.items():
            yield from _leaves(value, f"{path}.{key}" if path else str(key))
    elif isinstance(node, Sequence) and not isinstance(node, str) and any(isinstance(each, Mapping) for each in node):
        for k, value in enumerate(node):
            yield from _leaves(value, f"{path}[{k}]")
    else:
        yield path, list(node) if isinstance(node, Sequence) and not isinstance(node, str) else node


def _shown(value: Any) -> str:
    return "nothing" if value is None else "{}" if value == {} else str(value)
