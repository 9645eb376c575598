"""Code called by its address: formulas of contact laws, and parts of large kernels that only some materials need."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba.core import types
from numba.core.ccallback import CFunc
from numba.core.compiler_lock import global_compiler_lock

from phasemap._kernels.compilation.disk_cache import DiskCache
from phasemap._kernels.compilation.frozen import frozen

OPTIONS = {"error_model": "numpy"}
FORMULA = (types.float64, types.CPointer(types.float64)), types.float64
KEPT: dict[Any, CFunc] = {}  # for as long as this process, by digest where there is one


def compiled_formula(formula: Callable[[float, Any], float]) -> CFunc:
    """Compile a formula for (d, a row of parameters)."""
    with global_compiler_lock:
        copy = frozen(formula)
        code = KEPT.get(copy.digest)
        if code is None:
            code = CFunc(copy.function, FORMULA, {}, OPTIONS)
            if copy.lasts:
                code._cache = DiskCache(formula, digest=copy.digest)
            code.compile()
            KEPT[copy.digest or code] = code  # what has no digest is compiled anew each time
        return code


def compiled_kernel(function: Callable[..., Any], signature: Any) -> CFunc:
    """Compile a function that calls kernels, for a signature."""
    KEPT[function] = code = CFunc(function, signature, {}, OPTIONS)
    code._cache = DiskCache(function)
    code.compile()
    return code
