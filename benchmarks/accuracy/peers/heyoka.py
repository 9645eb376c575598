"""heyoka: Taylor series of high order, compiled for the equation at hand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from benchmarks.accuracy.peers.shooting import (
    ALPHA0,
    BASE,
    BEGIN,
    INVERSE,
    LOSS,
    OMEGA,
    PULL,
    REACH,
    STIFF,
    Period,
    Shoot,
    shoot,
)

Array = np.ndarray
Z0, END = 9, 10  # places among the parameters, after the constants
CROSSED, ENDED = -1, -2  # outcomes: heyoka numbers its terminal events -1, -2, ...


class Heyoka:
    """One Taylor integrator before contact and one in contact, changed at terminal events.

    A Taylor series knows no kink: in contact the state is q = sqrt(d) and time runs as dtau = 2 q ds, which makes the
    3/2 power and the root of the damping polynomials.
    """

    name = "heyoka"
    tolerances: tuple[float, ...] = (1e-4, 1e-6, 1e-9, 1e-12)
    share = 1

    def prepare(self, tolerance: float) -> tuple[Shoot, Period]:
        """See `benchmarks.accuracy.peers.Peer`."""
        period = _Period(tolerance)
        return (lambda p, start: shoot(period, p, start, tolerance)), period


class _Period:
    """Integrates one period; the tolerance is compiled in."""

    def __init__(self, tolerance: float) -> None:
        import heyoka

        self.done = heyoka.taylor_outcome.time_limit
        self.flight = _flight(heyoka, tolerance)
        self.contact = _contact(heyoka, tolerance)

    def __call__(self, x: Array, p: Array, tolerance: float) -> Array:
        """See `benchmarks.accuracy.peers.shooting.Period`."""
        z0, time = float(x[2]), float(p[BEGIN])
        end = time + 2 * math.pi / float(p[OMEGA])
        flight, contact = self.flight, self.contact
        flight.pars[:] = (*p, z0)
        contact.pars[:] = (*p, z0, end)
        z, v, c, s = float(x[0]), float(x[1]), 0.0, 0.0
        touching = z > z0
        q = math.sqrt(max(z - z0, 0.0))
        for _ in range(100):
            if touching:
                contact.time = 0.0
                contact.state[:] = (q, v, time, c, s)
                contact.reset_cooldowns()
                outcome = contact.propagate_until(1e6)[0]
                q, v, time, c, s = contact.state
                if int(outcome) == ENDED:
                    return np.array([z0 + q * q, v, c, s])
                z = z0
            else:
                flight.time = time
                flight.state[:] = (z, v, c, s)
                flight.reset_cooldowns()
                outcome = flight.propagate_until(end)[0]
                z, v, c, s = flight.state
                time, q = flight.time, 0.0
                if outcome == self.done:
                    return np.array([z, v, c, s])
            if int(outcome) != CROSSED:
                break
            touching = not touching
        return np.full(4, math.nan)


def _flight(heyoka: Any, tolerance: float) -> Any:
    z, v, c, s = heyoka.make_vars("z", "v", "c", "s")
    p = heyoka.par
    d, phase = z - p[Z0], p[OMEGA] * heyoka.time
    nearness = 1 - d * p[INVERSE]
    acceleration = p[BASE] * heyoka.cos(phase) - 2 * p[ALPHA0] * v - z + p[REACH] / (nearness * nearness)
    weight = p[OMEGA] / math.pi
    rates = [(z, v), (v, acceleration), (c, weight * z * heyoka.cos(phase)), (s, weight * z * heyoka.sin(phase))]
    touches = heyoka.t_event(d, direction=heyoka.event_direction.positive)
    return heyoka.taylor_adaptive(rates, [0.0] * 4, tol=tolerance, t_events=[touches], pars=[0.0] * 10)


def _contact(heyoka: Any, tolerance: float) -> Any:
    q, v, time, c, s = heyoka.make_vars("q", "v", "t", "c", "s")
    p = heyoka.par
    z, phase = p[Z0] + q * q, p[OMEGA] * time
    drive = p[BASE] * heyoka.cos(phase) - z
    acceleration = drive - 2 * (p[ALPHA0] + p[LOSS] * q) * v - p[STIFF] * q * q * q + p[PULL]
    weight = 2 * q * p[OMEGA] / math.pi
    rates = [
        (q, v), (v, 2 * q * acceleration), (time, 2 * q),
        (c, weight * z * heyoka.cos(phase)), (s, weight * z * heyoka.sin(phase)),
    ]  # fmt: skip
    leaves = heyoka.t_event(q, direction=heyoka.event_direction.negative)
    ends = heyoka.t_event(time - p[END], direction=heyoka.event_direction.positive)
    return heyoka.taylor_adaptive(rates, [0.0] * 5, tol=tolerance, t_events=[leaves, ends], pars=[0.0] * 11)
