"""What the lever does over an element, mode by mode: left alone, and by a force at the nodes.

A mode left alone turns by exp(lambda theta), lambda = a + i nu, and answers a kick of one with Im exp(lambda theta) /
(omega^2 nu): theory, Eq. (collocation-4).
"""

from __future__ import annotations

import numpy as np

from phasemap._kernels.columns import OMEGA
from phasemap._kernels.compilation import ANY_ORDER, kernel
from phasemap._kernels.lever_modes import mode_of, modes_of
from phasemap._kernels.numerics import fill_growth, fill_turn
from phasemap._kernels.orbits.collocation.system import PLACES, Orbit, element_of, motion_of_mode
from phasemap._kernels.quadrature import NODES, T_UPTO
from phasemap._kernels.records import column, record


@kernel
def fill_turns(lever: np.ndarray, orbit: Orbit, e: int) -> None:
    """Fill the free motion of each mode over element e: its state is multiplied by exp(lambda theta)."""
    element = element_of(orbit, e)
    last = element_of(orbit, e + 1).edge - element.edge
    for i in range(modes_of(lever)):
        mode, motion = mode_of(lever, i), motion_of_mode(orbit, e, i)
        angle = motion.growth
        for j in range(PLACES):
            angle[j] = element.theta[j] - element.edge if j < NODES else last
        fill_turn(angle, mode.turn, motion.sin, motion.cos)
        fill_growth(angle, mode.decay, motion.growth)


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
    element, omega, motion, kicks = element_of(orbit, e), lever[OMEGA], motion_of_mode(orbit, e, i), Kicks()
    a, nu, _, _, yields = mode_of(lever, i)
    table, grow, cosine, sine = orbit.tables[element.table], motion.growth, motion.cos, motion.sin
    share = part * element.scale * yields / (omega * omega * nu)
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
