"""The compiled march over surfaces that remember, by whose address a law has it called."""

from __future__ import annotations

import functools

import numba
from numba import carray, typeof
from numba.core import types
from numba.core.ccallback import CFunc

from phasemap._kernels import columns as col
from phasemap._kernels.compilation.disk_cache import DiskCache
from phasemap._kernels.law import Law, Oscillator
from phasemap._kernels.orbits.time.by_memory import ADDRESSES, IN_PYTHON
from phasemap._kernels.orbits.time.relaxing_events import march_relaxing
from phasemap._kernels.orbits.time.tip import PeriodResult

_NUMBERS = types.CPointer(types.float64)
_ARGUMENTS = (
    *(types.int64,) * ADDRESSES, _NUMBERS, _NUMBERS, types.float64, types.float64, _NUMBERS, types.int64,
    typeof(PeriodResult()),
)  # fmt: skip
LEVER_SIZE = (col.MODE + col.MODE_NUMBERS * col.MOST_MODES,)  # at most: what is not there is not read
_KEPT: list[CFunc] = []


@functools.cache
def address() -> int:
    """Address of the compiled march; 1 where numba's compiler is off."""
    if numba.config.DISABLE_JIT:
        IN_PYTHON.append(march_relaxing)
        return 1

    def march(f0, f1, f2, f3, f4, f5, f6, f7, f8, f9, p, lever, z0, step_size, y, size, acc):  # type: ignore[no-untyped-def]
        row = (
            p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8], p[9], p[10], p[11], p[12], p[13], p[14], p[15]
        )  # fmt: skip
        law = Law(f0, f1, f2, f3, f4, f5, f6, f7, f8, f9)
        return march_relaxing(Oscillator(law, row, carray(lever, LEVER_SIZE)), z0, step_size, carray(y, (size,)), acc)

    code = CFunc(march, (_ARGUMENTS, types.int64), {}, {"error_model": "numpy"})
    code._cache = DiskCache(march)
    code.compile()
    _KEPT.append(code)
    return int(code.address)
