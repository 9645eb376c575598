"""Relaxation times of a material, at whose address the column SPECTRUM has them: arms of a generalised Maxwell solid.

An element that is pushed in by w has f = w - sum_a kappa_a y_a and tau_a dy_a/dt = w - y_a: y_a is what the dashpot of
an arm has crept. Where nothing touches it, f = 0, and w = sum_j c_j is a sum of dents that recover at the rates r_j
between those of the arms, sum_a kappa_a/(1 - r_j tau_a) = 1 (theory, Eq. (memory-12)):

    y_a = sum_j c_j / (1 - r_j tau_a),    c_j = n_j sum_a kappa_a tau_a y_a / (1 - r_j tau_a)
"""

from __future__ import annotations

import ctypes
import math
from typing import Any

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import COMPILES, kernel
from phasemap._kernels.compilation.of_numba import intrinsic, ir, types
from phasemap._kernels.law import Oscillator
from phasemap._kernels.records import column, record

LEAST_LEFT = 0.03  # of a dent that a period must leave if the next one is to see it


@record
class Arms:
    """Arms of a material, and numbers of one element for each of them or for each dent."""

    count: int
    share: np.ndarray = column(col.MOST_ARMS)  # kappa_a [1]
    rate: np.ndarray = column(col.MOST_ARMS)  # 1/tau_a [omega_c]
    recovery: np.ndarray = column(col.MOST_ARMS)  # r_j [omega_c]
    to_arms: np.ndarray = column(col.MOST_ARMS**2)  # y_a from c_j, a row for each a
    to_dents: np.ndarray = column(col.MOST_ARMS**2)  # c_j from y_a, a row for each j
    whole: np.ndarray = column(col.MOST_ARMS)  # c_j of an element that has crept as far as it was pushed, over that
    one: np.ndarray = column(col.MOST_ARMS)  # 1, the same of y_a
    y: np.ndarray = column(col.MOST_ARMS)  # at the edge of the contact [m]
    value: np.ndarray = column(col.MOST_ARMS)  # of an element: numbers, and derivatives by xi
    slope: np.ndarray = column(col.MOST_ARMS)
    curve: np.ndarray = column(col.MOST_ARMS)
    converted: np.ndarray = column(col.MOST_ARMS)  # space of `transform_arms`


@intrinsic
def _number_at(_context: Any, address: Any, i: Any) -> Any:
    """Number i at an address."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        place = builder.inttoptr(arguments[0], ir.DoubleType().as_pointer())
        return builder.load(builder.gep(place, [arguments[1]]))

    return types.float64(types.int64, types.int64), generate


def _read(address: int, i: int) -> float:
    """Number i at an address, read from Python where numba's compiler is off."""
    return float((ctypes.c_double * (i + 1)).from_address(address)[i])


if not COMPILES:
    _number_at = _read


@kernel
def multiply_by(matrix: np.ndarray, n: int, of: np.ndarray, to: np.ndarray) -> None:
    """Multiply n numbers by a matrix of `Arms`."""
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += matrix[n * i + j] * of[j]
        to[i] = total


@kernel
def transform_arms(matrix: np.ndarray, arms: Arms) -> None:
    """Multiply the value, slope and curvature of an element, in all arms, by a matrix of `Arms`."""
    for values in (arms.value, arms.slope, arms.curve):
        multiply_by(matrix, arms.count, values, arms.converted)
        values[: arms.count] = arms.converted[: arms.count]


@kernel
def fill_arms(p: Any, arms: Arms) -> None:
    """Fill in the arms of a solid that relaxes."""
    address = int(p[col.SPECTRUM])
    if address == 0:
        kappa, rate = p[col.RELAXING], 1 / p[col.RELAXATION]
        arms.count, arms.share[0], arms.rate[0], arms.recovery[0] = 1, kappa, rate, (1 - kappa) * rate
        arms.to_arms[0], arms.to_dents[0], arms.whole[0], arms.one[0] = 1 / kappa, kappa, kappa, 1.0
        return
    n = int(_number_at(address, 0))
    arms.count = n
    for a in range(n):
        arms.share[a], arms.rate[a] = _number_at(address, 1 + a), _number_at(address, 1 + n + a)
        arms.recovery[a] = _number_at(address, 1 + 2 * n + a)
    for i in range(n * n):
        arms.to_arms[i] = _number_at(address, 1 + 3 * n + i)
        arms.to_dents[i] = _number_at(address, 1 + 3 * n + n * n + i)
    for a in range(n):
        arms.one[a] = 1.0
    multiply_by(arms.to_dents, n, arms.one, arms.whole)


@kernel
def fill_kelvin(recovery: float, arms: Arms) -> None:
    """Fill in the one arm of a Kelvin-Voigt surface: its dent comes back at the rate `recovery` [1/tau]."""
    arms.count, arms.share[0], arms.rate[0], arms.recovery[0] = 1, 1.0, 0.0, recovery
    arms.to_arms[0] = arms.to_dents[0] = arms.whole[0] = arms.one[0] = 1.0


@kernel(inline=True)
def remembers(p: np.ndarray) -> bool:
    """True if a material of a law with a memory relaxes, or is viscous."""
    return p[col.RELAXATION] > 0.0 or p[col.DAMPING] > 0.0


@kernel
def recovery_of(p: Any, lever: np.ndarray) -> float:
    """Rate [1/tau] at which a dent that nothing touches comes back, of one relaxation time or of none.

    That is (1 - kappa)/tau_R; over a Kelvin-Voigt solid, stiffness over damping of its contact: theory, Eq. (memory-7).
    """
    if p[col.RELAXATION] > 0.0:
        return (1 - p[col.RELAXING]) / p[col.RELAXATION]
    return 0.75 * p[col.CONTACT] / (p[col.DAMPING] * lever[col.STIFFNESS])


@kernel
def dent_survival(oscillator: Oscillator) -> float:
    """Share of a dent that is left after a period of the drive; 0 where that is less than 3 %."""
    law, p, lever = oscillator
    if law.memory == 0 or not remembers(p):
        return 0.0
    share = math.exp(-recovery_of(p, lever) * 2 * math.pi / lever[col.OMEGA])
    return share if share > LEAST_LEFT else 0.0
