"""Records of numpy's as ROS 1 messages: what a packed record says in memory is, byte for byte, what the message says on disk.

So a record is written to an MCAP file without being looked at, and Foxglove shows its fields. A message definition lists fields in
order; numbers are little-endian without padding, so a record's padding is a field of its own; an array whose length is not fixed
begins with that as uint32 (https://wiki.ros.org/msg).
"""

from __future__ import annotations

import math

import numpy as np

_PRIMITIVE = {
    **{f"u{size}": f"uint{8 * size}" for size in (1, 2, 4, 8)},
    **{f"i{size}": f"int{8 * size}" for size in (1, 2, 4, 8)},
    "f4": "float32",
    "f8": "float64",
}
_BAR = "=" * 80


def definition(record: np.dtype, package: str, rows: tuple[str, np.dtype] | None = None) -> str:
    """The text of a `ros1msg` schema: the fields of `record`, then `rows`: an array of any length, its name and its elements.

    Records within them become messages of `package` that are called after their fields. Raises ValueError for what no ROS 1 message
    holds.
    """
    others: dict[str, np.dtype] = {}
    text = _fields(record, package, others)
    if rows is not None:
        name, kind = rows
        text += f"{_type(kind, name, package, others)}[] {name}\n"
    done: list[str] = []
    while left := [name for name in others if name not in done]:
        done.append(left[0])
        text += f"{_BAR}\nMSG: {package}/{left[0]}\n{_fields(others[left[0]], package, others)}"
    return text


def _fields(record: np.dtype, package: str, others: dict[str, np.dtype]) -> str:
    if record.names is None or record.fields is None:
        raise ValueError(f"{record}: expected a record")
    text, end = "", 0
    for name in record.names:
        kind, offset = record.fields[name][:2]
        text += _padding(end, offset)
        element, shape = kind.subdtype or (kind, ())
        count = f"[{math.prod(shape)}]" if shape else ""
        text += f"{_type(element, name, package, others)}{count} {name}\n"
        end = offset + kind.itemsize
    return text + _padding(end, record.itemsize)


def _padding(end: int, start: int) -> str:
    return f"uint8[{start - end}] padding_{end}\n" if start > end else ""


def _type(kind: np.dtype, name: str, package: str, others: dict[str, np.dtype]) -> str:
    if kind.names is not None:
        called = "".join(part.capitalize() for part in name.removesuffix("s").split("_"))
        others[called] = kind
        return f"{package}/{called}"
    primitive = _PRIMITIVE.get(kind.str[1:])
    if primitive is None or kind.str[0] == ">":
        raise ValueError(f"{name}: {kind}: no number that a ROS 1 message holds")
    return primitive
