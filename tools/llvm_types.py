"""Types of arguments and answers of kernels, as JSON tells them to what calls kernels without numba."""

from __future__ import annotations

from typing import Any

from numba.core import types

NAMES = {
    types.float64: "float64",
    types.int64: "int64",
    types.boolean: "bool",
    types.complex128: "complex128",
    types.none: "none",
    types.npy_rng: "generator",
}


def kind_of(one: types.Type) -> Any:
    """A type as JSON has it."""
    if isinstance(one, types.Array):
        return {"array": str(one.dtype), "dimensions": one.ndim}
    if isinstance(one, types.BaseNamedTuple):
        name = f"{one.instance_class.__module__}.{one.instance_class.__qualname__}"
        return {"class": name, "fields": list(map(kind_of, one.types))}
    if isinstance(one, types.BaseTuple):
        return {"items": [kind_of(part) for part in one.types]}
    return {"record": one.words} if hasattr(one, "words") else NAMES[types.unliteral(one)]
