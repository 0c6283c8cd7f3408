"""Arrays that a kernel uses without owning a share of them.

Numba counts references to an array at every assignment and every call of an inlined helper, each an atomic instruction; in a kernel
that walks a table of small fields that costs several times what the fields do. An array without an owner has nothing to count. And
numpy's views and reshapes, asked about any strides, take 20 ns each, where it is known how the memory is laid out.
"""

from __future__ import annotations

from typing import Any

from numba.core import cgutils, types
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array


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


def _piece(typing: Any, memory: Any, first: Any, shape: Any, dtype: Any) -> Any:
    kind = types.Array(dtype.dtype, len(shape), "C")

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        whole, made = (
            context.make_array(memory)(context, builder, arguments[0]),
            context.make_array(kind)(context, builder),
        )
        width = context.get_constant(types.intp, context.get_abi_sizeof(context.get_data_type(dtype.dtype)))
        sizes, strides = cgutils.unpack_tuple(builder, arguments[2]), [width]
        for size in reversed(sizes[1:]):
            strides.insert(0, builder.mul(strides[0], size))
        begin = builder.bitcast(builder.gep(whole.data, [arguments[1]]), made.data.type)
        populate_array(made, data=begin, shape=sizes, strides=strides, itemsize=width, meminfo=None)
        return made._getvalue()

    return kind(memory, first, shape, dtype), generate


piece: Any = intrinsic(_piece)
"""piece(memory, first, shape, dtype): the C-ordered array of this shape (a tuple) and type that begins at item `first` of a
one-dimensional C-ordered array, and must end within it; without an owner, as above."""
