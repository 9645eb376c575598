"""The march over surfaces that remember, called by its address: it is compiled where a material asks for it only."""

from __future__ import annotations

import functools
import math
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import carray
from numba.core import cgutils, types
from numba.core.ccallback import CFunc
from numba.extending import intrinsic

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.disk_cache import DiskCache
from phasemap._kernels.law import Law, Oscillator

LEAST = 0.03  # of a dent that a period must leave if the next one is to see it

_NUMBERS, _ADDRESSES = types.CPointer(types.float64), len(Law._fields)
_SIGNATURE = types.int64(
    *(types.int64,) * _ADDRESSES, _NUMBERS, _NUMBERS, types.float64, types.float64, _NUMBERS, types.int64, _NUMBERS,
    types.int64,
)  # fmt: skip


@kernel(inline=True)
def remembers(p: np.ndarray) -> bool:
    """Whether a material of a law with a memory relaxes, or is viscous."""
    return p[col.RELAXATION] > 0.0 or p[col.DAMPING] > 0.0


@kernel
def recovery_of(p: Any, lever: np.ndarray) -> float:
    """Rate [1/tau] at which a dent that nothing touches comes back."""
    if p[col.RELAXATION] > 0.0:
        return (1 - p[col.RELAXING]) / p[col.RELAXATION]
    return 0.75 * p[col.CONTACT] / (p[col.DAMPING] * lever[col.STIFFNESS])


@kernel
def lingering(oscillator: Oscillator) -> float:
    """Share of a dent that a period of the drive leaves; 0 where that is less than 3 %."""
    law, p, lever = oscillator
    if law.memory == 0 or not remembers(p):
        return 0.0
    share = math.exp(-recovery_of(p, lever) * 2 * math.pi / lever[col.OMEGA])
    return share if share > LEAST else 0.0


@functools.cache
def address() -> int:
    """Where the compiled march is; 1 where numba's compiler is off."""
    from phasemap._kernels.orbits.time.remembering import remember_period

    if numba.config.DISABLE_JIT:
        return 1

    def march(f0, f1, f2, f3, f4, f5, f6, p, lever, z0, eta, y, size, acc, sums):  # type: ignore[no-untyped-def]
        row = (p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8], p[9], p[10], p[11])
        law = Law(f0, f1, f2, f3, f4, f5, f6)
        return remember_period(
            Oscillator(law, row, carray(lever, (5,))), z0, eta, carray(y, (size,)), carray(acc, (sums,))
        )

    code = CFunc(march, (_SIGNATURE.args, _SIGNATURE.return_type), {}, {"error_model": "numpy"})
    code._cache = DiskCache(march)
    code.compile()
    _KEPT.append(code)
    return int(code.address)


_KEPT: list[CFunc] = []


@intrinsic
def by_memory(_context: Any, law: Any, p: Any, lever: Any, z0: Any, eta: Any, y: Any, acc: Any) -> Any:
    """As `march.march_period`, over a surface that remembers."""

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        addresses, row, lever_, z0_, eta_, y_, acc_ = arguments
        number, whole = ir.DoubleType(), ir.IntType(64)
        laws = [builder.extract_value(addresses, j) for j in range(_ADDRESSES)]
        if isinstance(p, types.Array):
            place = context.make_array(p)(context, builder, row).data
        else:
            place = cgutils.alloca_once(builder, number, col.ROW)
            for j in range(col.ROW):
                builder.store(builder.extract_value(row, j), cgutils.gep_inbounds(builder, place, j))
        of_lever, of_y, of_acc = (
            context.make_array(kind)(context, builder, one) for kind, one in ((lever, lever_), (y, y_), (acc, acc_))
        )
        pointer = number.as_pointer()
        given = [whole] * _ADDRESSES + [pointer, pointer, number, number, pointer, whole, pointer, whole]
        kind = ir.FunctionType(whole, given)
        values = [
            *laws, place, of_lever.data, z0_, eta_, of_y.data, of_y.nitems, of_acc.data, of_acc.nitems
        ]  # fmt: skip
        return builder.call(builder.inttoptr(laws[-1], kind.as_pointer()), values, attrs=("nounwind",))

    return types.int64(law, p, lever, types.float64, types.float64, y, acc), generate


def _by_python(law: Law, p: Any, lever: np.ndarray, z0: float, eta: float, y: np.ndarray, acc: np.ndarray) -> int:
    """The same where numba's compiler is off."""
    from phasemap._kernels.orbits.time.remembering import remember_period

    return int(remember_period(Oscillator(law, p, lever), z0, eta, y, acc))


if numba.config.DISABLE_JIT:
    by_memory = _by_python
