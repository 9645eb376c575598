"""Compilation of kernels to machine code: when they are first called, unless the library of a wheel has them."""

from phasemap._kernels.compilation.mode import COMPILES, LIBRARY
from phasemap._kernels.compilation.numba_versions import check_numba

if COMPILES:
    check_numba()
    from phasemap._kernels.compilation.entries import ANY_ORDER, kernel, watch
else:
    from phasemap._kernels.compilation.uncompiled import ANY_ORDER, kernel, watch

__all__ = ["ANY_ORDER", "COMPILES", "LIBRARY", "kernel", "watch"]
