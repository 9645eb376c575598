"""numbalsoda: compiled integrators that numba can call."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from phasemap.validation.bench.peers import shooting
from phasemap.validation.bench.peers.shooting import BEGIN, OMEGA, Period, Shoot

Array = np.ndarray


class Numbalsoda:
    """Its DOP853 with a compiled right-hand side, and the shooting compiled around it; no events."""

    name = "numbalsoda"
    tolerances: tuple[float, ...] = (1e-6, 1e-8, 1e-10, 1e-12)
    share = 1

    def prepare(self, tolerance: float) -> tuple[Shoot, Period]:
        """See `phasemap.validation.bench.peers.Peer`."""
        period, find = _compiled()
        return (lambda p, start: find(period, p, start, tolerance)), period


_KEPT: list[Any] = []  # what is compiled, once per process; and the callback, which must outlive its address


def _compiled() -> tuple[Any, Any]:
    if not _KEPT:
        _KEPT.extend(_compile())
    return _KEPT[0], _KEPT[1]


def _compile() -> tuple[Any, ...]:
    import numba
    from numbalsoda import dop853, lsoda_sig

    njit: Any = numba.njit
    carray: Any = vars(numba)["carray"]  # not among the names that numba's types export

    accelerated = njit(shooting.acceleration)

    @numba.cfunc(lsoda_sig)
    def rate(time, y, dy, data):  # type: ignore[no-untyped-def]
        p = carray(data, (10,))
        z, v = y[0], y[1]
        dy[0] = v
        dy[1] = accelerated(time, z, v, p[9], p)
        dy[2] = p[OMEGA] / math.pi * z * math.cos(p[OMEGA] * time)
        dy[3] = p[OMEGA] / math.pi * z * math.sin(p[OMEGA] * time)

    address = rate.address

    @njit
    def period(x, p, tolerance):  # type: ignore[no-untyped-def]
        data = np.empty(10)
        data[:9] = p
        data[9] = x[2]
        y = np.zeros(4)
        y[:2] = x[:2]
        times = np.array([p[BEGIN], p[BEGIN] + 2 * math.pi / p[OMEGA]])
        course, success = dop853(address, y, times, data, tolerance, tolerance, 100_000)
        return course[1] if success else np.full(4, math.nan)

    return period, njit(shooting.shoot), rate
