"""The march over surfaces that remember, called by its address: it is compiled where a material asks for it only."""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, Oscillator
from phasemap._kernels.orbits.time.tip import PeriodResult

LEAST_LEFT = 0.03  # of a dent that a period must leave if the next one is to see it

ADDRESSES = len(Law._fields)
MEMORY = Law._fields.index("memory")


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
    return share if share > LEAST_LEFT else 0.0


@intrinsic
def by_memory(_context: Any, law: Any, p: Any, lever: Any, z0: Any, step_size: Any, y: Any, acc: Any) -> Any:
    """March one period over a surface that remembers; arguments as for `march.march_period`."""

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


IN_PYTHON: list[Any] = []
"""`march_relaxing`, put here by `compiled_memory` where numba's compiler is off."""


def _by_python(
    law: Law, p: Any, lever: np.ndarray, z0: float, step_size: float, y: np.ndarray, acc: PeriodResult
) -> int:
    """The same where numba's compiler is off."""
    return int(IN_PYTHON[0](Oscillator(law, p, lever), z0, step_size, y, acc))


if numba.config.DISABLE_JIT:
    by_memory = _by_python
