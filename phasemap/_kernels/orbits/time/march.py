"""A period over any surface: which kind of contact marches it.

`elastic` has the period over surfaces that remember nothing, `relaxing_events` that over surfaces that do; both step
through it by `equation_of_motion.march_period`. The latter is compiled by itself, where a material asks for it, and
called by its address (`Law.memory`).
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import COMPILES, LIBRARY, kernel
from phasemap._kernels.compilation.of_numba import carray, cgutils, intrinsic, ir, types
from phasemap._kernels.law import Law, Oscillator
from phasemap._kernels.orbits.time.arms import remembers
from phasemap._kernels.orbits.time.elastic import march_elastic
from phasemap._kernels.orbits.time.relaxing_events import march_relaxing
from phasemap._kernels.orbits.time.surface_memory import CONTACT_MODE, INNER_COUNT, OUTER_COUNT
from phasemap._kernels.orbits.time.tip import PeriodResult

ADDRESSES = len(Law._fields)
MEMORY = Law._fields.index("memory")
LEVER_SIZE = (col.MODE + col.MODE_NUMBERS * col.MOST_MODES,)  # at most: what is not there is not read


@intrinsic
def _march_by_address(_context: Any, law: Any, p: Any, lever: Any, z0: Any, step_size: Any, y: Any, acc: Any) -> Any:
    """March one period over a surface that remembers; arguments as for `march_oscillator`."""

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        addresses, row, lever_, z0_, eta_, y_, acc_ = arguments
        number, whole = ir.DoubleType(), ir.IntType(64)
        laws = [builder.extract_value(addresses, j) for j in range(ADDRESSES)]
        if isinstance(p, types.Array):
            place = context.make_array(p)(context, builder, row).data
        else:
            place = cgutils.alloca_once(builder, number, col.ROW)
            for j in range(col.ROW):
                builder.store(builder.extract_value(row, j), cgutils.gep_inbounds(builder, place, j))
        of_lever, of_y = (context.make_array(kind)(context, builder, one) for kind, one in ((lever, lever_), (y, y_)))
        pointer = number.as_pointer()
        given = [whole] * ADDRESSES + [pointer, pointer, number, number, pointer, whole, acc_.type]
        kind = ir.FunctionType(whole, given)
        values = [*laws, place, of_lever.data, z0_, eta_, of_y.data, of_y.nitems, acc_]
        return builder.call(builder.inttoptr(laws[MEMORY], kind.as_pointer()), values, attrs=("nounwind",))

    return types.int64(law, p, lever, types.float64, types.float64, y, acc), generate


def _march_in_python(
    law: Law, p: Any, lever: np.ndarray, z0: float, step_size: float, y: np.ndarray, acc: PeriodResult
) -> int:
    """`_march_by_address` in Python, where numba's compiler is off."""
    return int(march_relaxing(Oscillator(law, p, lever), z0, step_size, y, acc))


if not COMPILES:
    _march_by_address = _march_in_python


@functools.cache
def address_of_relaxing() -> int:
    """Address of the compiled march over surfaces that remember; 1 where numba's compiler is off."""
    if not COMPILES:
        return LIBRARY.address_of(address_of_relaxing) if LIBRARY else 1
    from numba import typeof

    from phasemap._kernels.compilation.by_address import compiled_kernel

    def march(f0, f1, f2, f3, f4, f5, f6, f7, f8, f9, p, lever, z0, step_size, y, size, acc):  # type: ignore[no-untyped-def]
        row = (p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8], p[9], p[10], p[11], p[12], p[13], p[14], p[15])
        law = Law(f0, f1, f2, f3, f4, f5, f6, f7, f8, f9)
        return march_relaxing(Oscillator(law, row, carray(lever, LEVER_SIZE)), z0, step_size, carray(y, (size,)), acc)

    numbers, number, whole = types.CPointer(types.float64), types.float64, types.int64
    given = (*(whole,) * ADDRESSES, numbers, numbers, number, number, numbers, whole, typeof(PeriodResult()))
    return int(compiled_kernel(march, (given, whole)).address)


@kernel
def march_oscillator(oscillator: Oscillator, z0: float, step_size: float, y: np.ndarray, acc: PeriodResult) -> int:
    """March a lever over a material for a period, from drive phase 0 on or where y says that periods begin.

    The settled phase is off by less than 1e-4, 2e-6, 2e-9 degree at a `step_size` of 0.5, 0.3, 0.15 in nine of ten
    orbits with Q <= 1000; the error is of order 8 in it (eta in the theory) and proportional to Q.

    `y` is the state with entries as `tip` names them, advanced in place; where the law may remember, entries of
    `surface_memory` follow. The entry for contact or neck is read only where the law has a neck: elsewhere the depth
    tells. `acc` is filled: its energy into the surface is that of damping and relaxation, and that of the neck's loop
    at each release; its virial is that of the whole surface force. Returns the steps taken, or minus a status.
    """
    law, p, lever = oscillator
    if law.memory != 0:
        if remembers(p):
            return _march_by_address(law, p, lever, z0, step_size, y, acc)
        y[CONTACT_MODE] = y[INNER_COUNT] = y[OUTER_COUNT] = 0.0  # over another material
    return march_elastic(oscillator, z0, step_size, y, acc)
