"""How kernels are compiled, linked and kept on disk, by parts of numba that are replaced here."""

from phasemap._kernels.compilation.entries import ANY_ORDER, compiled, compiled_more_than_once, kernel

__all__ = ["ANY_ORDER", "compiled", "compiled_more_than_once", "kernel"]
