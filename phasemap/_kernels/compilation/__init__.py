"""How kernels become machine code: they are compiled when they are first called, or found in the library of a wheel."""

from phasemap._kernels.compilation.mode import COMPILES, LIBRARY

if COMPILES:
    from phasemap._kernels.compilation.entries import ANY_ORDER, kernel, watch
else:
    from phasemap._kernels.compilation.uncompiled import ANY_ORDER, kernel, watch

__all__ = ["ANY_ORDER", "COMPILES", "LIBRARY", "kernel", "watch"]
