"""A law as a typed token: the formulas of one interaction, passed to kernels as one argument.

Closures and dispatchers passed as arguments never hit numba's disk cache. A token's numba *type* carries a fingerprint
of the formulas, so a kernel is compiled once per set of formulas and later processes find it on disk, while a changed
formula, or a changed kernel, has another fingerprint and is compiled anew.
"""

from __future__ import annotations

import hashlib
import pathlib
import types as python_types
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit
from numba.core import types
from numba.core.datamodel import models
from numba.extending import NativeValue, overload, register_model, typeof_impl, unbox

OPTIONS: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy", "fastmath": {"contract"}}
"""How every kernel is compiled. Products and sums may be fused; nothing else is relaxed, for NaN must survive."""

Formula = Callable[[float, Any], float]

_ROLES = ("contact_force", "contact_slope", "longrange_force", "longrange_slope", "damping", "damping_slope")
_COMPILED: dict[str, tuple[Any, ...]] = {}
_BIASED: set[str] = set()  # laws with an attraction p[11]; the others are spared the subtraction


def _sources() -> bytes:
    """Digest of the kernels' own source, so that numba's cache cannot outlive a kernel that calls a changed one."""
    digest = hashlib.sha256()
    for path in sorted(pathlib.Path(__file__).parent.rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.digest()


_SOURCES = _sources()


def fingerprint(function: Any, seen: set[int] | None = None) -> str:
    """Return the sha256 of a function's bytecode, constants and, recursively, of all names that it uses."""
    seen = set() if seen is None else seen
    function = getattr(function, "py_func", function)
    if id(function) in seen:
        return ""
    seen.add(id(function))
    code = function.__code__
    constants = [c for c in code.co_consts if not isinstance(c, python_types.CodeType)]
    digest = hashlib.sha256(code.co_code + repr(constants).encode() + repr(code.co_names).encode())
    used = [(n, function.__globals__[n]) for n in code.co_names if n in function.__globals__]
    used += list(zip(code.co_freevars, (cell.cell_contents for cell in function.__closure__ or ()), strict=True))
    for name, value in used:
        if hasattr(value, "py_func") or isinstance(value, python_types.FunctionType):
            digest.update((name + fingerprint(value, seen)).encode())
        elif isinstance(value, (int, float, complex, str, bool, tuple)):
            digest.update(f"{name}={value!r}".encode())
        elif isinstance(value, np.ndarray):
            digest.update(name.encode() + value.tobytes())
        else:
            digest.update(name.encode())
    return digest.hexdigest()


def compiled(function: Any) -> Any:
    """Compile a formula written in plain Python, and the plain functions that it calls."""
    if hasattr(function, "py_func"):
        return function
    code, scope, closure = function.__code__, function.__globals__, function.__closure__ or ()
    helpers = {n: compiled(scope[n]) for n in code.co_names if isinstance(scope.get(n), python_types.FunctionType)}
    cells = [cell.cell_contents for cell in closure]
    cells = [compiled(value) if isinstance(value, python_types.FunctionType) else value for value in cells]
    bound = tuple(python_types.CellType(value) for value in cells)
    copy = python_types.FunctionType(code, {**scope, **helpers}, function.__name__, function.__defaults__, bound)
    return njit(error_model="numpy")(copy)


class LawType(types.Type):
    """The numba type of a `Law`; two laws with the same formulas have the same type."""

    def __init__(self, sha: str) -> None:
        self.sha = sha
        super().__init__(name=f"Law({sha[:16]})")

    @property
    def key(self) -> str:
        return self.sha

    def __reduce__(self) -> tuple[type[LawType], tuple[str]]:
        return LawType, (self.sha,)


class Law:
    """The formulas of an interaction as one kernel argument.

    Parameters
    ----------
    contact_force, contact_slope : callable (d, p) -> float
        Force [N] and its derivative [N/m] for d >= 0, and in the neck.
    longrange_force, longrange_slope : callable (d, p) -> float
        The same for d <= 0.
    damping, damping_slope : callable (d, p) -> float
        alpha_s [1] and its derivative [1/m] for d >= 0.
    biased : bool
        Whether rows have a constant attraction p[11] in contact, whatever the law.
    """

    def __init__(self, *formulas: Formula, biased: bool = False) -> None:
        digest = hashlib.sha256(_SOURCES + bytes([biased]))
        for role, formula in zip(_ROLES, formulas, strict=True):
            digest.update((role + fingerprint(formula)).encode())
        self.sha = digest.hexdigest()
        if biased:
            _BIASED.add(self.sha)
        if self.sha not in _COMPILED:
            _COMPILED[self.sha] = tuple(compiled(formula) for formula in formulas)
        self.formulas = _COMPILED[self.sha]


def why_not_compiled(law: Law) -> str:
    """The reason why numba refuses a formula of this law; empty where it takes all of them."""
    for role, formula in zip(_ROLES, law.formulas, strict=True):
        try:
            formula.compile((types.float64, types.float64[::1]))
        except Exception as error:  # numba's errors have no common base
            said = [line.strip() for line in str(error).splitlines() if line.strip()]
            reason = next((line for line in said if "Untyped" in line or "NameError" in line), " ".join(said[1:3]))
            return f"Of its {role}: {reason or repr(error)}"
        if any(signature.return_type != types.float64 for signature in formula.nopython_signatures):
            return f"Its {role} does not return a float: {formula.nopython_signatures[0].return_type}."
    return ""


@typeof_impl.register(Law)
def _type_of_law(law: Law, _context: object) -> LawType:
    return LawType(law.sha)


@register_model(LawType)
class _LawModel(models.OpaqueModel):
    """A token has no run-time content: the call is resolved while compiling."""


@unbox(LawType)
def _unbox_law(_type: LawType, _object: object, context: Any) -> NativeValue:
    return NativeValue(context.context.get_dummy_value())


def contact_force(law: Law, d: float, p: np.ndarray) -> float:
    """Force in contact [N], d >= p[10] [m]: the law's, and the attraction p[11] that is there whatever the law."""
    return law.formulas[0](d, p) - p[11]


def contact_slope(law: Law, d: float, p: np.ndarray) -> float:
    """dF/dd in contact [N/m]."""
    return law.formulas[1](d, p)


def longrange_force(law: Law, d: float, p: np.ndarray) -> float:
    """Force outside contact [N], d <= 0 [m]."""
    return law.formulas[2](d, p)


def longrange_slope(law: Law, d: float, p: np.ndarray) -> float:
    """dF/dd outside contact [N/m]."""
    return law.formulas[3](d, p)


def damping(law: Law, d: float, p: np.ndarray) -> float:
    """alpha_s in contact [1]."""
    return law.formulas[4](d, p)


def damping_slope(law: Law, d: float, p: np.ndarray) -> float:
    """d alpha_s / dd in contact [1/m]."""
    return law.formulas[5](d, p)


def _pick(law: Any, role: int) -> Any:
    """What numba compiles in place of a stub: a direct call of the law's own formula."""
    if not isinstance(law, LawType):
        return None
    formula = _COMPILED[law.sha][role]
    if role == 0 and law.sha in _BIASED:
        return lambda law, d, p: formula(d, p) - p[11]
    return lambda law, d, p: formula(d, p)


def _resolve(stub: Any, role: int) -> None:
    overload(stub)(lambda law, d, p: _pick(law, role))


for _role, _stub in enumerate((contact_force, contact_slope, longrange_force, longrange_slope, damping, damping_slope)):
    _resolve(_stub, _role)


@njit(**OPTIONS)
def parameters(row: np.ndarray) -> tuple[float, ...]:
    """A parameter row as numbers: passed by value, it costs no reference counts in the innermost calls."""
    return (
        row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8], row[9], row[10], row[11]
    )  # fmt: skip
