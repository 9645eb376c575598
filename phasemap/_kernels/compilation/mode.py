"""Switch for compilation: where `NUMBA_DISABLE_JIT` is set Python runs kernels as they are."""

import os

from phasemap._kernels.compilation import library

_AS_THEY_ARE = os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")
LIBRARY = None if _AS_THEY_ARE else library.best_library()
"""The library of a wheel; None without one."""
COMPILES = not _AS_THEY_ARE and LIBRARY is None
"""True if kernels are compiled here; else they, and what only numba can run in them, are functions of Python."""
