"""Elements and rows of contiguous arrays in LLVM code, without the detours that numba takes for slices and lists."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from llvmlite import ir
from numba.core import types

# Places in numba's structure of an array.
_MEMINFO = 0
_PARENT = 1
_ITEMS = 2
_ITEM_SIZE = 3
_DATA = 4
_SHAPE = 5
_STRIDES = 6


def index_types(array: types.Type, index: types.Type) -> tuple[types.Type, ...]:
    """The types of the indices, where they are whole numbers into a contiguous array; none otherwise."""
    if type(array) is not types.Array or array.layout != "C" or not array.aligned:
        return ()
    kinds = tuple(index.types) if isinstance(index, types.BaseTuple) else (index,)
    whole = all(isinstance(one, types.Integer) and one.bitwidth == 64 for one in kinds)
    return kinds if whole and 0 < len(kinds) <= array.ndim else ()


def element_pointer(
    builder: Any, array: Any, dimensions: int, kinds: Sequence[Any], index: Any
) -> tuple[Any, list[Any]]:
    """LLVM pointer to the element or subarray at an index, and the sizes of the axes that are left."""
    sizes = [builder.extract_value(array, (_SHAPE, axis)) for axis in range(dimensions)]
    offset = None
    for axis, kind in enumerate(kinds):
        place = builder.extract_value(index, axis) if isinstance(index.type, ir.Aggregate) else index
        if kind.signed and not (isinstance(place, ir.Constant) and place.constant >= 0):
            below = builder.icmp_signed("<", place, place.type(0))
            place = builder.select(below, builder.add(place, sizes[axis]), place)
        for size in sizes[axis + 1 :]:
            place = builder.mul(place, size)
        offset = place if offset is None else builder.add(offset, place)
    return builder.gep(builder.extract_value(array, _DATA), [offset]), sizes[len(kinds) :]


def subarray(builder: Any, array: Any, kind: Any, place: Any, sizes: Sequence[Any]) -> Any:
    """Structure of LLVM for the subarray that begins at a pointer and has these sizes."""
    dimensions, items, made = array.type.elements[_SHAPE].count, None, ir.Constant(kind, ir.Undefined)
    for field in (_MEMINFO, _PARENT, _ITEM_SIZE):
        made = builder.insert_value(made, builder.extract_value(array, field), field)
    made = builder.insert_value(made, place, _DATA)
    for axis, size in enumerate(sizes):
        stride = builder.extract_value(array, (_STRIDES, dimensions - len(sizes) + axis))
        made = builder.insert_value(builder.insert_value(made, size, (_SHAPE, axis)), stride, (_STRIDES, axis))
        items = size if items is None else builder.mul(items, size, flags=["nsw"])
    return builder.insert_value(made, items, _ITEMS)
