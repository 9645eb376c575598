"""The forces of an interaction as one argument of kernels: addresses of compiled formulas.

Kernels are compiled once and serve every law. Hertzian contact and the inverse-square attraction they know by
themselves (address 0), so that the loops over nodes and steps stay what a processor does best; any other formula is
compiled alone, for (d, a row of parameters), and called by its address.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from phasemap._kernels import forces, loaded_sources
from phasemap._kernels.columns import BIAS, LONGRANGE, RELEASE, ROW, WITHDRAWN
from phasemap._kernels.compilation import COMPILES, LIBRARY, kernel
from phasemap._kernels.compilation.numba_versions import check_numba
from phasemap._kernels.compilation.of_numba import cgutils, intrinsic, ir, types

Formula = Callable[[float, Any], float]
KNOWN = (  # of a law's formulas, in its order, those that kernels know by themselves
    forces.hertzian, forces.hertzian_slope, forces.inverse_square, forces.inverse_square_slope, forces.power_law,
    forces.power_law_slope,
)  # fmt: skip
NO_NUMBA = "Here that takes numba, which is not installed: pip install 'afm-phasemap[law]'."


class Law(NamedTuple):
    """Addresses of formulas (d, p); 0 for those that kernels know. They hold in one process only."""

    # contact_force, contact_slope: force [N] and its derivative [N/m] for d >= 0, and in the neck; 0 for Hertzian
    # contact
    contact_force: int
    contact_slope: int
    # longrange_force, longrange_slope: the same for d <= 0; 0 for the inverse-square attraction
    longrange_force: int
    longrange_slope: int
    # damping, damping_slope: alpha_s [1] and its derivative [1/m] for d >= 0; 0 for the power law
    damping: int
    damping_slope: int
    attracts: int = 1  # 1 where the long-range force attracts, the more the nearer the tip; 0 where it may repel
    lossy: int = 0  # 1 where rows have WITHDRAWN, LOSS and LOSS_FALL; else the address of `withdrawn_force`, if any
    memory: int = 0  # the march of a period over surfaces that remember, `orbits.time.relaxing`; 0 if none does
    arms: int = 1  # most relaxation times of a material


class Oscillator(NamedTuple):
    """A lever over one material, whose orbits are sought."""

    law: Law
    p: Any  # parameters of the interaction, shape (ROW,)
    lever: np.ndarray  # shape (n,), see `phasemap._kernels.columns`


def law_of(*formulas: Formula) -> Law:
    """Law of formulas in the order of its fields: those that kernels do not have are compiled, if not done before.

    Raises
    ------
    TypeError
        With the reason, where numba refuses a formula.
    """
    addresses = []
    for role, formula, built_in in zip(Law._fields[:6], formulas, KNOWN, strict=True):
        try:
            addresses.append(0 if formula is built_in else address_of(formula))
        except ImportError as error:
            raise TypeError(str(error)) from error
        except Exception as error:  # numba's errors have no common base
            lines = [line.strip() for line in str(error).splitlines() if line.strip()]
            reason = next((line for line in lines if "Untyped" in line or "NameError" in line), " ".join(lines[1:3]))
            raise TypeError(f"Of its {role}: {reason or repr(error)}") from error
    return Law(*addresses)


def digest_of(formula: Formula) -> str | None:
    """Digest of a formula and all that it uses; None where these may mean something else in another process."""
    if LIBRARY and (formula in KNOWN or LIBRARY.symbol_of(formula)):
        sources = loaded_sources.digest()
        return None if sources is None else f"{sources.hex()} {LIBRARY.symbol_of(formula) or formula.__qualname__}"
    from phasemap._kernels.compilation.frozen import frozen

    copy = frozen(formula)
    return copy.digest if copy.lasts else None


def address_of(formula: Formula) -> int:
    """Address of the compiled code of a formula."""
    if LIBRARY and LIBRARY.symbol_of(formula):
        return LIBRARY.address_of(formula)
    try:
        check_numba()
        from phasemap._kernels.compilation.by_address import compiled_formula
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(NO_NUMBA) from error
    return int(compiled_formula(formula).address)


@intrinsic
def _call_formula(_context: Any, address: Any, d: Any, p: Any) -> Any:
    """Call a compiled formula by its address, with the depth d and a parameter row."""

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        where, depth, row = arguments
        number = ir.DoubleType()
        if isinstance(p, types.Array):
            place = context.make_array(p)(context, builder, row).data
        else:  # numbers in registers go to the stack
            place = cgutils.alloca_once(builder, number, ROW)
            for j in range(ROW):
                builder.store(builder.extract_value(row, j), cgutils.gep_inbounds(builder, place, j))
        kind = ir.FunctionType(number, [number, number.as_pointer()])
        return builder.call(builder.inttoptr(where, kind.as_pointer()), [depth, place], attrs=("nounwind", "readonly"))

    return types.float64(types.int64, types.float64, p), generate


def _called_by_python(address: int, d: float, p: Any) -> float:
    """Call a compiled formula from Python, where numba's compiler is off."""
    kind = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double, ctypes.POINTER(ctypes.c_double))
    return kind(address)(d, (ctypes.c_double * ROW)(*p[:ROW]))


if not COMPILES:
    _call_formula = _called_by_python

_hertzian = kernel(forces.hertzian, inline=True)
_hertzian_slope = kernel(forces.hertzian_slope, inline=True)
_inverse_square = kernel(forces.inverse_square, inline=True)
_inverse_square_slope = kernel(forces.inverse_square_slope, inline=True)
_power_law = kernel(forces.power_law, inline=True)
_power_law_slope = kernel(forces.power_law_slope, inline=True)


@kernel(inline=True)
def contact_force(law: Law, d: float, p: np.ndarray) -> float:
    """Force in contact [N], d >= p[RELEASE] [m]: the law's, less the attraction p[BIAS] that any law has."""
    force = _hertzian(d, p) if law.contact_force == 0 else _call_formula(law.contact_force, d, p)
    return force - p[BIAS]


@kernel(inline=True)
def contact_slope(law: Law, d: float, p: np.ndarray) -> float:
    """dF/dd in contact [N/m]."""
    return _hertzian_slope(d, p) if law.contact_slope == 0 else _call_formula(law.contact_slope, d, p)


@kernel(inline=True)
def longrange_force(law: Law, d: float, p: np.ndarray) -> float:
    """Force outside contact [N], d <= 0 [m]."""
    return _inverse_square(d, p) if law.longrange_force == 0 else _call_formula(law.longrange_force, d, p)


@kernel(inline=True)
def longrange_slope(law: Law, d: float, p: np.ndarray) -> float:
    """dF/dd outside contact [N/m]."""
    return _inverse_square_slope(d, p) if law.longrange_slope == 0 else _call_formula(law.longrange_slope, d, p)


@kernel(inline=True)
def damping(law: Law, d: float, p: np.ndarray) -> float:
    """alpha_s in contact [1]."""
    return _power_law(d, p) if law.damping == 0 else _call_formula(law.damping, d, p)


@kernel(inline=True)
def damping_slope(law: Law, d: float, p: np.ndarray) -> float:
    """d alpha_s / dd in contact [1/m]."""
    return _power_law_slope(d, p) if law.damping_slope == 0 else _call_formula(law.damping_slope, d, p)


@kernel(light=True, inline=True)
def has_longrange(p: np.ndarray) -> bool:
    """True if a force acts on a tip out of contact."""
    return p[LONGRANGE] != 0.0


@kernel(light=True, inline=True)
def has_hysteresis(p: np.ndarray) -> bool:
    """True if a neck holds a tip that is withdrawn, down to the depth of release."""
    return p[RELEASE] != 0.0


@kernel
def withdrawn_force(law: Law, d: float, p: np.ndarray) -> float:
    """Attraction [N] on the way out of contact, beside that on the way in, of a law with losses."""
    return p[WITHDRAWN] if law.lossy == 1 else _call_formula(law.lossy, d, p)


@kernel(light=True)
def parameters(row: np.ndarray) -> tuple[float, ...]:
    """A parameter row as numbers: passed by value, it costs no reference counts in the innermost calls."""
    return (
        row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8], row[9], row[10], row[11], row[12],
        row[13], row[14], row[15],
    )  # fmt: skip
