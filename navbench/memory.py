"""Arrays in compiled code whose memory is neither counted nor allocated, and how many of them are handed over."""

from typing import Any, TypeVar

import numpy as np
from llvmlite.ir import Constant
from numba.core import cgutils, types
from numba.extending import lower_builtin, type_callable
from numba.np import arrayobj
from numba.typed import List
from numpy.typing import NDArray

from navbench.compiled import compiled

Given = TypeVar("Given")
kinds: Any = types  # numba's are untyped
unpack_tuple: Any = cgutils.unpack_tuple
populate_array: Any = arrayobj.populate_array


def borrowed(given: Given) -> Given:
    """Return an array, or a tuple of arrays and numbers, whose memory somebody else keeps while compiled code uses it.

    Each view of an array counts references to its memory, in an atomic step that takes as long as ten additions; of
    borrowed memory nothing is counted. What is borrowed must not be returned from compiled code.
    """
    return given


def scratch(shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return an array of floats, not set, that lasts until the compiled function that asks for it returns.

    It lies on the stack, since to allocate memory takes longer than a small inference: it must be small, not be asked
    for in a loop, and not be returned.
    """
    return np.empty(shape)


@compiled
def handed(given: Any, count: int) -> Any:
    """Return a list that holds a tuple of arrays so many times, which compiled code takes as one object.

    To hand over each array by itself takes 0.1 us, at every call.
    """
    places = List()
    for _ in range(count):
        places.append(given)
    return places


@type_callable(borrowed)  # type: ignore[no-untyped-call,untyped-decorator,unused-ignore]
def _type_borrowed(_: Any) -> Any:
    return lambda given: given if _can_be_lent(given) else None


def _can_be_lent(kind: Any) -> bool:
    """Return whether of a kind of values only arrays are counted: anything else would be freed too soon."""
    if isinstance(kind, kinds.BaseTuple):
        return all(map(_can_be_lent, kind))
    return isinstance(kind, kinds.Array | kinds.Number | kinds.Boolean)


@lower_builtin(borrowed, kinds.Any)  # type: ignore[no-untyped-call,untyped-decorator,unused-ignore]
def _borrow(context: Any, builder: Any, signature: Any, values: Any) -> Any:
    return _without_owner(context, builder, signature.return_type, values[0])


def _without_owner(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    if isinstance(kind, kinds.Array):
        array = context.make_helper(builder, kind, value=value)
        array.meminfo, array.parent = Constant(array.meminfo.type, None), Constant(array.parent.type, None)
        return array._getvalue()
    if isinstance(kind, kinds.BaseTuple):
        items = zip(kind, unpack_tuple(builder, value), strict=True)
        return context.make_tuple(builder, kind, [_without_owner(context, builder, *item) for item in items])
    return value


@type_callable(scratch)  # type: ignore[no-untyped-call,untyped-decorator,unused-ignore]
def _type_scratch(_: Any) -> Any:
    return lambda shape: kinds.Array(kinds.float64, len(shape), "C")


@lower_builtin(scratch, kinds.BaseTuple)  # type: ignore[no-untyped-call,untyped-decorator,unused-ignore]
def _reserve(context: Any, builder: Any, signature: Any, values: Any) -> Any:
    array = context.make_array(signature.return_type)(context, builder)
    counts = unpack_tuple(builder, values[0])
    strides = [context.get_constant(kinds.intp, 8)]
    for count in reversed(counts):
        strides.insert(0, builder.mul(strides[0], count))
    data = builder.alloca(context.get_value_type(kinds.float64), builder.udiv(strides[0], strides[-1]))
    data.align = 64
    populate_array(array, data, counts, strides[1:], strides[-1], None)
    return array._getvalue()
