"""Makes tests/data/recovering.json: taps on viscous surfaces that attract the tip while they come back.

    python tests/reference/make_recovering.py

A Kelvin-Voigt contact after Ting whose dent is gone when the next tap begins has its force in closed form, with
S = K sqrt(R) and t0 = 4 k alpha1 / (3 K R):

    growing    F = S (d^1.5 + 1.5 t0 sqrt(d) d') - P,                       to d' = 0
    shrinking  F = S (d + t0 d')^1.5 - P,                                   to d + t0 d' = 0
    off        F = -P / (1 + gap/d0)^2,   gap = d_1 exp(-(t - t_1)/t0) - d

scipy's DOP853 integrates z'' + 2 alpha0 z' + z + F/k = u0 cos(t) with a tolerance of 1e-12, in the root of the time where
the contact grows, in pieces of some t0 where the surface comes back. Newton's method finds the periodic motion of the
setpoint, beginning with the harmonic one on the side that `repulsive` says. `closure` is what is missing of the energy:
drive less air less F z', over the drive.
"""

from __future__ import annotations

import json
import math
import pathlib
from typing import Any

import numpy as np
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

DATA = pathlib.Path(__file__).parent.parent / "data" / "recovering.json"
POISSON, PERIOD = 0.35, 2.0 * math.pi
LAYER = (0.25, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)  # ends of the pieces in which a surface comes back, in t0
EXACT = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-15}
FIELDS = ("stiffness", "quality_factor", "free_amplitude", "radius", "modulus", "adhesion", "decay_length", "damping")


class Tap:
    """The force of a case, lengths over the free amplitude and forces over that of the lever there."""

    def __init__(self, case: dict[str, Any]) -> None:
        k, quality, free, radius, modulus, adhesion, decay, damping = (case[name] for name in FIELDS)
        stiff = 4.0 / 3.0 * modulus / (1.0 - POISSON**2)
        self.hertz = stiff * math.sqrt(radius * free) / k
        self.t0 = 4.0 * k * damping / (3.0 * stiff * radius)
        self.pull = 2.0 * math.pi * radius * adhesion / (k * free)
        self.decay = decay / free
        self.alpha0, self.base = 0.5 / quality, 1.0 / quality
        self.setpoint, self.repulsive = case["setpoint"], case["repulsive"]

    def off(self, gap: float) -> float:
        return -self.pull / (1.0 + max(gap, 0.0) / self.decay) ** 2

    def growing(self, d: float, v: float) -> float:
        return self.hertz * math.sqrt(max(d, 0.0)) * (d + 1.5 * self.t0 * v) - self.pull

    def shrinking(self, d: float, v: float) -> float:
        return self.hertz * max(d + self.t0 * v, 0.0) ** 1.5 - self.pull

    def harmonic(self, e: float) -> tuple[float, float]:
        """Cosine and sine parts of the force for d = setpoint cos - e, over pi; the dent is left out."""

        def force(theta: float) -> float:
            d, v = self.setpoint * math.cos(theta) - e, -self.setpoint * math.sin(theta)
            if d <= 0.0:
                return self.off(-d)
            return self.growing(d, v) if v > 0.0 else self.shrinking(d, v)

        edge = math.acos(min(max(e / self.setpoint, -1.0), 1.0))
        ends = (-math.pi, -edge, 0.0, edge, math.pi)
        parts = zip(ends, ends[1:], strict=False)
        found = [
            [quad(lambda t, f=f: f(t) * force(t), *part, epsrel=1e-6)[0] for f in (math.cos, math.sin)]
            for part in parts
        ]
        return tuple(np.sum(found, axis=0) / math.pi)

    def start(self) -> tuple[float, np.ndarray]:
        """Lag and (z, z', z0) where the tip is highest, of the harmonic motion that the drive supports."""

        def surplus(e: float) -> float:
            push, drag = self.harmonic(e)
            return push**2 + (2.0 * self.alpha0 * self.setpoint - drag) ** 2 - self.base**2

        places = self.setpoint + np.linspace(0.15, -0.5, 300)
        values = [surplus(e) for e in places]
        for i in range(1, len(places)):
            if values[i - 1] * values[i] <= 0.0:
                e = brentq(surplus, places[i], places[i - 1])
                push, drag = self.harmonic(e)
                if (push > 0.0) == self.repulsive:
                    return math.atan2(2.0 * self.alpha0 * self.setpoint - drag, push), np.array(
                        [-self.setpoint, 0.0, e]
                    )
        raise ValueError("no harmonic orbit on this side")


def period(tap: Tap, start: np.ndarray, phase: float) -> tuple[np.ndarray, float]:
    """Motion and integrals after a period that begins out of contact at a drive phase, and the largest depth.

    Of z, z', and the integrals of z cos, z sin, F z' and z'^2. At most one tap, over a surface without dents.
    """
    z0, t0 = start[2], tap.t0

    def rates(t: float, y: np.ndarray, force: float) -> list[float]:
        z, v = y[0], y[1]
        c, s = math.cos(t + phase), math.sin(t + phase)
        return [v, tap.base * c - z - force - 2.0 * tap.alpha0 * v, z * c, z * s, force * v, v * v]

    def piece(rhs: Any, ends: tuple[float, float], y: np.ndarray, until: Any) -> tuple[float, np.ndarray, bool]:
        until.terminal, until.direction = True, -1
        found = solve_ivp(rhs, ends, y, events=until, **EXACT)
        return found.t[-1], found.y[:, -1], found.status == 1

    y = np.array([start[0], start[1], 0.0, 0.0, 0.0, 0.0])
    t, y, touched = piece(
        lambda t, y: rates(t, y, tap.off(z0 - y[0])), (0.0, PERIOD), y, lambda t, y: z0 - y[0]
    )  # fmt: skip
    if not touched:
        raise ValueError("the tip does not tap")
    first = t
    root, y, _ = piece(
        lambda s, y: [2.0 * s * rate for rate in rates(first + s * s, y, tap.growing(y[0] - z0, y[1]))],
        (0.0, math.sqrt(PERIOD)), y, lambda s, y: y[1],
    )  # fmt: skip
    turn, deepest = first + root**2, y[0] - z0
    last, y, _ = piece(
        lambda t, y: rates(t, y, tap.shrinking(y[0] - z0, y[1])),
        (turn, PERIOD), y, lambda t, y: y[0] - z0 + t0 * y[1],
    )  # fmt: skip
    dent, t = y[0] - z0, last
    if not t0 * 32.0 < PERIOD - last:
        raise ValueError("the dent lasts")
    for end in (*(last + t0 * times for times in LAYER), PERIOD):
        y = solve_ivp(
            lambda t, y: rates(t, y, tap.off(dent * math.exp((last - t) / t0) - y[0] + z0)), (t, end), y, **EXACT
        ).y[:, -1]
        t = end
    return y, deepest


def solved(case: dict[str, Any]) -> dict[str, Any]:
    """The case with its orbit."""
    tap = Tap(case)
    lag, u = tap.start()
    phase, size, move = lag + math.pi, 1e-6, np.ones(3)

    def missed(u: np.ndarray) -> np.ndarray:
        y, _ = period(tap, u, phase)
        return np.array([y[0] - u[0], y[1] - u[1], math.hypot(y[2], y[3]) / math.pi - tap.setpoint])

    for _ in range(30):
        now = missed(u)
        slopes = np.column_stack([(missed(u + size * one) - now) / size for one in np.eye(3)])
        move = -np.linalg.solve(slopes, now)
        u = u + move * min(1.0, 0.003 / np.abs(move).max())
        if np.abs(move).max() < 1e-10:
            break
    y, deepest = period(tap, u, phase)
    unit = case["stiffness"] * case["free_amplitude"] ** 2
    given = tap.base * y[3]
    found = {
        "phase": 90.0 - math.degrees(math.atan2(y[3], y[2])), "tip_offset": u[2] * case["free_amplitude"],
        "indentation": deepest * case["free_amplitude"], "dissipation": y[4] * unit, "given": given * unit,
        "closure": (given - y[4] - 2.0 * tap.alpha0 * y[5]) / given, "left": float(np.abs(move).max()), "t0": tap.t0,
    }  # fmt: skip
    print({**case, **found}, flush=True)
    return {**case, **{name: float(value) for name, value in found.items()}}


SOFT = (28.9, 121.0, 12.4e-9, 19.8e-9, 324e6, 0.053, 0.3e-9)
CASES = [
    *(
        {**dict(zip(FIELDS, (*SOFT, damping), strict=True)), "setpoint": 0.9, "repulsive": False}
        for damping in (1e-4, 3e-4, 1e-3)
    ),
    {
        **dict(zip(FIELDS, (11.94, 333.0, 17.6e-9, 14.4e-9, 7.2e9, 0.0395, 0.3e-9, 1e-3), strict=True)),
        "setpoint": 0.6,
        "repulsive": True,
    },
]
ATTRACTED = (5, 9, 10, 12, 14)  # of the drawn cases, those in which attraction holds a tip lowered from far


def drawn(count: int) -> list[dict[str, Any]]:
    """Cases at random, t0 between 3e-5 and 3e-3."""
    rng, cases = np.random.default_rng(35), []
    low = (1.0, 30.0, 8e-9, 5e-9, 0.1e9, 0.02, 0.2e-9, 3e-5)
    high = (60.0, 500.0, 60e-9, 30e-9, 10e9, 0.12, 0.6e-9, 3e-3)
    for i in range(count):
        numbers = np.exp(rng.uniform(np.log(low), np.log(high)))
        numbers[7] *= numbers[4] / (1.0 - POISSON**2) * numbers[3] / numbers[0]  # alpha1 of t0
        setpoint = round(rng.uniform(0.4, 0.9), 3)
        case = {name: float(f"{number:.4g}") for name, number in zip(FIELDS, numbers, strict=True)}
        cases.append({**case, "setpoint": setpoint, "repulsive": i not in ATTRACTED})
    return cases


if __name__ == "__main__":
    found = []
    for case in (*CASES, *drawn(17)):
        try:
            found.append(solved(case))
        except ValueError as reason:  # it does not tap, or never leaves
            print(case, reason)
    DATA.write_text(json.dumps(found, indent=1) + "\n")
