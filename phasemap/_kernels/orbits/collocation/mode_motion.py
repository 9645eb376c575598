"""Motion of each mode of the lever over an element: left alone, and by a force at the nodes.

A mode left alone turns by exp(lambda theta), lambda = a + i nu, and answers a kick of one with Im exp(lambda theta) /
(omega^2 nu): theory, Eq. (collocation-4).
"""

from __future__ import annotations

import numpy as np

from phasemap._kernels.columns import OMEGA
from phasemap._kernels.compilation import ANY_ORDER, kernel
from phasemap._kernels.lever import mode_of, modes_of
from phasemap._kernels.orbits.collocation.system import PLACES, Orbit, element_of, motion_of_mode
from phasemap._kernels.quadrature import NODES, T_UPTO
from phasemap._kernels.records import column, record


@kernel(fastmath=ANY_ORDER)
def fill_turns(lever: np.ndarray, orbit: Orbit, e: int) -> None:
    """Fill the free motion of each mode over element e: it turns by exp(lambda theta), lambda = a + i nu.

    By Taylor's series at an eighth of the angle, doubled three times, in vectors: to rounding up to 4 rad.
    """
    one = element_of(orbit, e)
    last = element_of(orbit, e + 1).edge - one.edge
    for i in range(modes_of(lever)):
        a, nu, _, _, _ = mode_of(lever, i)
        own = motion_of_mode(orbit, e, i)
        grow, c, s = own.growth, own.cos, own.sin
        for j in range(PLACES):
            grow[j] = 0.125 * (one.theta[j] - one.edge if j < NODES else last)
        for j in range(PLACES):
            x = nu * grow[j]
            q = x * x
            sine = x * (1 + q * (-1 / 6 + q * (1 / 120 + q * (-1 / 5040 + q * (1 / 362880 + q * (
                -1 / 39916800 + q * (1 / 6227020800 - q / 1307674368000)))))))  # fmt: skip
            less = q * (-1 / 2 + q * (1 / 24 + q * (-1 / 720 + q * (1 / 40320 + q * (
                -1 / 3628800 + q * (1 / 479001600 + q * (-1 / 87178291200 + q / 20922789888000)))))))  # fmt: skip
            sine, less = 2.0 * sine * (1.0 + less), 2.0 * less * (2.0 + less)
            sine, less = 2.0 * sine * (1.0 + less), 2.0 * less * (2.0 + less)
            s[j], c[j] = 2.0 * sine * (1.0 + less), 1.0 + 2.0 * less * (2.0 + less)
            x = a * grow[j]
            x = 1 + x * (1 + x * (1 / 2 + x * (1 / 6 + x * (1 / 24 + x * (1 / 120 + x * (1 / 720 + x * (1 / 5040 + x * (
                1 / 40320 + x * (1 / 362880 + x * (1 / 3628800 + x / 39916800))))))))))  # fmt: skip
            x *= x
            x *= x
            grow[j] = x * x


@kernel(inline=True)
def free_transfer(
    a: float, nu: float, inverse: float, growth: float, cosine: float, sine: float
) -> tuple[float, float, float, float]:
    """Transfer (w by w, w by w', w' by w, w' by w') of a mode that moves freely over an angle; `inverse` is 1 / nu."""
    c, s = growth * cosine, growth * sine * inverse
    return c - a * s, s, -(a * a + nu * nu) * s, c + a * s


@record
class Kicks:
    """Sums of kicks up to the nodes of an element, turned back to its start."""

    re: np.ndarray = column(NODES)
    im: np.ndarray = column(NODES)


@kernel(fastmath=ANY_ORDER)
def add_response(
    lever: np.ndarray, orbit: Orbit, e: int, i: int, part: float, f: np.ndarray, w: np.ndarray, u: np.ndarray
) -> None:
    """Add to w and u the motion and the rate of mode i by a force, `part` of f at the nodes of element e."""
    one, omega, own, kicks = element_of(orbit, e), lever[OMEGA], motion_of_mode(orbit, e, i), Kicks()
    a, nu, _, _, yields = mode_of(lever, i)
    table, grow, cosine, sine = orbit.tables[one.table], own.growth, own.cos, own.sin
    share = part * one.scale * yields / (omega * omega * nu)
    re, im = kicks.re, kicks.im
    for j in range(NODES):
        re[j], im[j] = 0.0, 0.0
    for k in range(NODES):
        kick, upto = share * f[k] / grow[k], table[T_UPTO + k]
        of_re, of_im = kick * cosine[k], -kick * sine[k]
        for j in range(NODES):
            re[j] += upto[j] * of_re
            im[j] += upto[j] * of_im
    for j in range(NODES):
        c, s = grow[j] * cosine[j], grow[j] * sine[j]
        more = c * im[j] + s * re[j]
        w[j] += more
        u[j] += a * more + nu * (c * re[j] - s * im[j])
