"""The neck: contact that lasts while the tip is pulled out, down to the depth of release p[RELEASE] < 0."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels.columns import FORMING, RELEASE
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, contact_force, has_longrange, longrange_force, parameters
from phasemap._kernels.lever import reach_of
from phasemap._kernels.quadrature import gauss

_X, _W = gauss(24)


@kernel
def loop_energy(law: Law, p: np.ndarray) -> float:
    """Energy [J] lost between where the neck forms and release: the integral of F_longrange - F_contact over that.

    See theory, Eq. (model-11).
    A contact force that ends at release like a root is smooth in x, d = d_r + (d_f - d_r) x^2; the long-range force is
    a power of exp(x), with the gap reach (exp(x) - 1).
    """
    depth = p[FORMING] - p[RELEASE]
    energy = 0.0
    for i in range(len(_X)):
        x = _X[i]
        energy -= _W[i] * 2.0 * depth * x * contact_force(law, p[RELEASE] + depth * x * x, p)
    if has_longrange(p):
        reach = reach_of(p)
        start = reach - p[FORMING]
        span = math.log1p(depth / start)
        for i in range(len(_X)):
            gap = start * math.exp(span * _X[i]) - reach
            energy += _W[i] * span * (reach + gap) * longrange_force(law, -gap, p)
    return energy


@kernel
def loop_energies(law: Law, rows: np.ndarray) -> np.ndarray:
    """`loop_energy` of every row; 0 without a neck."""
    energies = np.zeros(len(rows))
    for i in range(len(rows)):
        if rows[i, RELEASE] != 0.0:
            energies[i] = loop_energy(law, parameters(rows[i]))
    return energies
