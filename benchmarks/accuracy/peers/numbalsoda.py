"""numbalsoda: compiled integrators that numba can call."""

from __future__ import annotations

import importlib.util
import math
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from benchmarks.accuracy.peers import shooting
from benchmarks.accuracy.peers.shooting import BEGIN, OMEGA, Period, Shoot

Array = np.ndarray


class Numbalsoda:
    """Its DOP853 with a compiled right-hand side, and the shooting compiled around it; no events."""

    name = "numbalsoda"
    tolerances: tuple[float, ...] = (1e-6, 1e-8, 1e-10, 1e-12)
    share = 1

    def prepare(self, tolerance: float) -> tuple[Shoot, Period]:
        """See `benchmarks.accuracy.peers.Peer`."""
        period, find = _compiled()
        return (lambda p, start: find(period, p, start, tolerance)), period


_KEPT: list[Any] = []  # what is compiled, once per process; and the callback, which must outlive its address


def _compiled() -> tuple[Any, Any]:
    if not _KEPT:
        _KEPT.extend(_compile())
    return _KEPT[0], _KEPT[1]


def _part(name: str) -> ModuleType:
    """A part of numbalsoda alone: its package, when imported, compiles a third integrator for six seconds."""
    package = importlib.util.find_spec("numbalsoda")
    assert package is not None and package.origin is not None
    spec = importlib.util.spec_from_file_location(name, Path(package.origin).with_name(f"{name}.py"))
    assert spec is not None and spec.loader is not None
    part = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(part)
    return part


def _compile() -> tuple[Any, ...]:
    import numba

    dop853, lsoda_sig = _part("driver_dop853").dop853, _part("driver").lsoda_sig
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
        data, y, times = np.empty(10), np.empty(4), np.empty(2)
        for i in range(9):
            data[i] = p[i]
        data[9] = x[2]
        y[0], y[1], y[2], y[3] = x[0], x[1], 0.0, 0.0
        times[0], times[1] = p[BEGIN], p[BEGIN] + 2 * math.pi / p[OMEGA]
        course, success = dop853(address, y, times, data, tolerance, tolerance, 100_000)
        for i in range(4):
            y[i] = course[1, i] if success else math.nan
        return y

    return period, njit(shooting.shoot), rate
