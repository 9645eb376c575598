"""scipy's solve_ivp."""

from __future__ import annotations

import math

import numpy as np

from benchmarks.accuracy.peers.shooting import BEGIN, OMEGA, Period, Shoot, acceleration, shoot

Array = np.ndarray


class Scipy:
    """DOP853 of `scipy.integrate.solve_ivp`, the right-hand side in Python; no events, step control finds the kink."""

    name = "scipy"
    tolerances: tuple[float, ...] = (1e-5, 1e-7, 1e-9)
    share = 6

    def prepare(self, tolerance: float) -> tuple[Shoot, Period]:
        """See `benchmarks.accuracy.peers.Peer`."""
        return (lambda p, start: shoot(_period, p, start, tolerance)), _period


def _period(x: Array, p: Array, tolerance: float) -> Array:
    from scipy.integrate import solve_ivp

    constants, z0 = p.tolist(), float(x[2])
    omega, weight = constants[OMEGA], constants[OMEGA] / math.pi

    def rate(time: float, y: Array) -> list[float]:
        z, v = y.item(0), y.item(1)
        c, s = math.cos(omega * time), math.sin(omega * time)
        return [v, acceleration(time, z, v, z0, constants), weight * z * c, weight * z * s]

    begin = constants[BEGIN]
    span = (begin, begin + 2 * math.pi / omega)
    solved = solve_ivp(rate, span, [x[0], x[1], 0.0, 0.0], "DOP853", rtol=tolerance, atol=tolerance)
    return np.asarray(solved.y[:, -1])
