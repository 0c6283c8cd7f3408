"""Arrays that a kernel uses without owning a share of them.

Numba counts references to an array at every assignment and every call of an inlined helper, each an atomic instruction; in a kernel
that walks a table of small fields that costs several times what the fields do. An array without an owner has nothing to count.
"""

from __future__ import annotations

from typing import Any

from numba.core import cgutils, types
from numba.extending import intrinsic


def _without_owner(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    made = context.make_array(kind)(context, builder, value)
    made.meminfo = cgutils.get_null_value(made.meminfo.type)
    made.parent = cgutils.get_null_value(made.parent.type)
    return made._getvalue()


def _borrowed(typing: Any, arrays: Any) -> Any:
    kinds: Any = arrays

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        if isinstance(arrays, types.BaseTuple):
            members = cgutils.unpack_tuple(builder, arguments[0])
            bare = [_without_owner(context, builder, *pair) for pair in zip(kinds, members, strict=True)]
            return context.make_tuple(builder, arrays, bare)
        return _without_owner(context, builder, arrays, arguments[0])

    return arrays(arrays), generate


borrowed: Any = intrinsic(_borrowed)
"""An array, or a tuple of arrays, without its owner; whoever called the kernel holds on to it. Neither return nor keep it."""
