"""Nodes along an orbit that is solved, for integrals over it.

`harmonic` takes it as harmonic about its deepest point, d = depth - A (1 - cos(theta)): what the higher harmonics do to
the depth within a contact is left out; that they lift or lower all of it is not, for the depth is the orbit's own.

Where the nodes of a harmonic orbit lie:

* contact: sin(theta/2) = sin(theta0/2) sin(psi), as in `averaged.harmonics`;
* outside: tan(theta/2) = tan(start/2) + delta x/(1 - x), delta the distance to the pole of the long-range force;
* neck: theta = theta_r - (theta_r - theta0) x^2, so that a root of the force at release is smooth.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law
from phasemap._kernels.lever import reach_of
from phasemap._kernels.orbits.collocation.system import MOST_ELEMENTS
from phasemap._kernels.quadrature import NODES, gauss
from phasemap._kernels.records import column, record

HARMONIC_NODES = 20  # of each part of a harmonic orbit
NODES_ALL_ROUND = 48  # of one that is always in contact
HARMONIC_X, HARMONIC_WEIGHTS = gauss(HARMONIC_NODES)
_COS2, _SIN2 = np.cos(0.5 * np.pi * HARMONIC_X) ** 2, np.sin(0.5 * np.pi * HARMONIC_X) ** 2
_HARMONIC_TOUCH_W = HARMONIC_WEIGHTS * np.pi * np.cos(0.5 * np.pi * HARMONIC_X)
MOST_NODES = MOST_ELEMENTS * NODES


@record
class OrbitNodes:
    """Nodes along an orbit."""

    count: int  # how many there are
    begins: float  # sum of 1/|dd/dtheta| where contacts begin, and where they, or necks, end [1/m]
    ends: float
    cos: np.ndarray = column(MOST_NODES)  # of the angle theta of the first harmonic
    sin: np.ndarray = column(MOST_NODES)
    depth: np.ndarray = column(MOST_NODES)  # d [m]
    rate: np.ndarray = column(MOST_NODES)  # dd/d(theta) [m]
    weight: np.ndarray = column(MOST_NODES)  # [rad]
    touches: np.ndarray = column(MOST_NODES)  # 1 in contact or neck, else 0


@kernel
def _put(at: OrbitNodes, j: int, amplitude: float, c: float, s: float, depth: float, weight: float, on: float) -> None:
    """Put node j at the angle with cosine c and sine s of a harmonic orbit; `on` is 1 in contact or neck."""
    at.cos[j], at.sin[j], at.depth[j], at.rate[j] = c, s, depth, -amplitude * s
    at.weight[j], at.touches[j] = weight, on


@kernel
def _outside(reach: float, amplitude: float, c: float, begin: float, side: float, first: int, at: OrbitNodes) -> int:
    """Nodes from tan(theta/2) = `begin` to theta = pi, way in (side -1) or out (1); returns how many there are."""
    ratio = 0.5 * (max(c - 1.0, 0.0) + reach / amplitude) * (1.0 + begin * begin) ** 2
    delta = math.sqrt(begin * begin + ratio) - begin
    if delta < 1e-4 * begin:
        delta = 0.5 * ratio / begin
    there = (1.0 - begin * begin) / (1.0 + begin * begin)
    for i in range(HARMONIC_NODES):
        u = begin + delta * HARMONIC_X[i] / (1.0 - HARMONIC_X[i])
        below = 1.0 / (1.0 + u * u)
        weight = 2.0 * delta * HARMONIC_WEIGHTS[i] / (1.0 - HARMONIC_X[i]) ** 2 * below
        # cos(begin) - cos(theta) without cancellation
        more = 2.0 * (u - begin) * (u + begin) * below / (1.0 + begin * begin)
        depth = -amplitude * (c - there + more)
        _put(at, first + i, amplitude, 2.0 * below - 1.0, side * 2.0 * u * below, depth, weight, 0.0)
    return first + HARMONIC_NODES


@kernel
def _contact(amplitude: float, c: float, at: OrbitNodes) -> int:
    """Nodes in contact, |theta| < theta0, |c| < 1."""
    m2 = 0.5 * (1.0 - c)
    for i in range(HARMONIC_NODES):
        y = (1.0 - c) * _COS2[i]
        weight = math.sqrt(m2) * _HARMONIC_TOUCH_W[i] / math.sqrt(1.0 - m2 * _SIN2[i])
        sine = math.sqrt(max(1.0 - (c + y) ** 2, 0.0))
        _put(at, i, amplitude, c + y, sine, amplitude * y, weight, 1.0)
        _put(at, HARMONIC_NODES + i, amplitude, c + y, -sine, amplitude * y, weight, 1.0)
    return 2 * HARMONIC_NODES


@kernel
def _neck(amplitude: float, c: float, release: float, first: int, at: OrbitNodes) -> int:
    """Nodes in the neck, on the way out from d = 0 to d = `release` < 0."""
    begin, end = math.acos(c), math.acos(c + release / amplitude)
    for i in range(HARMONIC_NODES):
        back = (end - begin) * HARMONIC_X[i] * HARMONIC_X[i]
        theta, weight = end - back, 2.0 * (end - begin) * HARMONIC_X[i] * HARMONIC_WEIGHTS[i]
        depth = release + 2.0 * amplitude * math.sin(0.5 * back) * math.sin(end - 0.5 * back)
        _put(at, first + i, amplitude, math.cos(theta), math.sin(theta), depth, weight, 1.0)
    return first + HARMONIC_NODES


@kernel
def harmonic(law: Law, p: np.ndarray, amplitude: float, depth: float, at: OrbitNodes) -> None:
    """Fill the nodes of a harmonic orbit that is so deep [m]."""
    c, release = 1.0 - depth / amplitude, p[col.RELEASE]
    at.begins, at.ends = 0.0, 0.0
    if c <= -1.0 or (release < 0.0 and c < 1.0 and amplitude * (c + 1.0) <= -release):
        at.count = NODES_ALL_ROUND
        for i in range(NODES_ALL_ROUND):  # always in contact
            theta = 2.0 * math.pi * (i + 0.5) / NODES_ALL_ROUND
            x = math.cos(theta)
            _put(at, i, amplitude, x, math.sin(theta), amplitude * (x - c), 2.0 * math.pi / NODES_ALL_ROUND, 1.0)
        return
    count, begin, last = 0, 0.0, c
    if c < 1.0:
        count, begin = _contact(amplitude, c, at), math.sqrt((1.0 - c) / (1.0 + c))
        if release < 0.0:
            count, last = _neck(amplitude, c, release, count, at), c + release / amplitude
        at.begins = 1.0 / (amplitude * math.sqrt(1.0 - c * c))
        at.ends = 1.0 / (amplitude * math.sqrt(1.0 - last * last))
    if p[col.LONGRANGE] != 0.0:
        reach, end = reach_of(law, p), math.sqrt((1.0 - last) / (1.0 + last)) if last < 1.0 else 0.0
        count = _outside(reach, amplitude, c, begin, -1.0, count, at)
        count = _outside(reach, amplitude, c, end, 1.0, count, at)
    at.count = count


@kernel
def moves(row: np.ndarray) -> bool:
    """Whether a result row has a periodic orbit."""
    return math.isfinite(row[col.INDENTATION]) and row[col.AMPLITUDE] > 0.0 and not row[col.SPREAD_AMPLITUDE] > 0.0
