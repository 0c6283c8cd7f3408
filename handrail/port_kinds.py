"""Kinds of values that flow between process nodes, and which of them are ones of another kind, too (docs/nodes.md)."""

from __future__ import annotations

_ALSO = {("integer", "number"), ("wrench", "numbers")} | {(kind, "array") for kind in ("wrench", "numbers", "cloud")}
"""(from, to) where each value of the one is one of the other"""


def misfit(kind: str, unit: str, to_kind: str, to_unit: str) -> tuple[str, str, str]:
    """What of a value is not what a port takes: (`kind` or `unit`, what it is, what is taken); empty texts where it fits.

    A port without a unit takes all.
    """
    if kind != to_kind and (kind, to_kind) not in _ALSO:
        return "kind", kind, to_kind
    if unit and to_unit and unit != to_unit:
        return "unit", unit, to_unit
    return "", "", ""
