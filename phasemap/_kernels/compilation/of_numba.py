"""Parts of numba for instructions that it does not have; stand-ins where nothing is compiled."""

from phasemap._kernels.compilation.mode import COMPILES

if COMPILES:
    from llvmlite import ir
    from numba import carray
    from numba.core import cgutils, types
    from numba.extending import intrinsic
else:
    carray = cgutils = ir = types = None

    def intrinsic(function):  # type: ignore[no-untyped-def]
        """Stand in for numba's: kernels put a function of Python in the place of what it is given."""
        return function


__all__ = ["carray", "cgutils", "intrinsic", "ir", "types"]
