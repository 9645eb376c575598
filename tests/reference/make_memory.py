"""Makes tests/data/memory.json: orbits over surfaces that remember, by elements in equal steps.

    python tests/reference/make_memory.py

The method is none of the package's. A linear viscoelastic half-space under an axisymmetric tip is, exactly, a row of
independent elements under a profile of one dimension (V. L. Popov, M. Hess, Method of Dimensionality Reduction in
Contact Mechanics and Friction, 2015): under a sphere the element at x is pushed in by w = d - x^2/R, and the force is
twice the integral of f over x > 0. An element is a spring beside a spring with a dashpot (standard linear solid), or a
spring beside a dashpot (Kelvin-Voigt); it leaves the tip when f falls to 0 and then recovers by itself. That is Ting's
theory for all histories: several contacts, and contacts with a surface that has not recovered.

    z'' + 2 alpha0 z' + z + F/k = u0 cos(tau),    d = z - z0,    at resonance, tau = 2 pi f0 t

Elements lie on an equal grid, time goes on in equal steps of the classical Runge-Kutta method, and no contact is
located but the edge between two elements. A feedback of the drive's period brings the tip to its setpoint, Newton's
method by differences to the end. `error` is the change of the phase [degree] if grid and steps are coarser by half; a
third of it is taken off, as both are of second order. Before that the loss tangent that an indentation prescribed as
a tap of a cosine sees is compared with one by Ting's own integrals, and a contact that does not relax with Hertz's.
"""

from __future__ import annotations

import json
import math
import pathlib

import numpy as np
from numba import njit

DATA = pathlib.Path(__file__).parent.parent / "data" / "memory.json"
STIFFNESS, FREQUENCY, RADIUS, POISSON = 40.0, 300e3, 10e-9, 0.35
SOLID, KELVIN = 0, 1


@njit(cache=True, error_model="numpy")
def spread(kind, p, dx, w, keep, d, v):
    """Integral of f over x / sqrt(R), over E*: up to the edge, which lies between two elements."""
    kappa, time = p[1], p[2]
    total, before = 0.0, 0.0
    for i in range(len(w) - 1):
        x2 = (i * dx) ** 2
        if kind == SOLID:
            f = d - x2 - kappa * w[i]
            if f <= 0.0:
                share = before / (before - f) if i > 0 else 0.0
                return total + 0.5 * before * share * dx
        else:
            f, gap = d - x2 + time * v, d - x2 - w[i] * keep
            if f <= 0.0 or gap < 0.0:
                share, edge = 1.0, f
                if gap < 0.0:
                    beyond = d - ((i + 1) * dx) ** 2 - w[i + 1] * keep
                    share = min(1.0, max(0.0, 1.0 + gap / (gap - beyond)))
                    edge = before + share * (f - before)
                if edge <= 0.0:
                    share, edge = (before / (before - f) if i > 0 else 0.0), 0.0
                return total + 0.5 * (before + edge) * share * dx if i > 0 else 0.0
        if i > 0:
            total += 0.5 * (before + f) * dx
        before = f
    return math.nan  # the grid is too small


@njit(cache=True, error_model="numpy")
def force(kind, p, dx, w, keep, d, v):
    """Force over the lever's stiffness: p = K sqrt(R)/k, kappa, tau or t0, pull/k, d0."""
    depth = p[1] * w[0] if kind == SOLID else w[0] * keep
    pushed = spread(kind, p, dx, w, keep, d, v)
    gap = max(depth - d, 0.0)
    if pushed > 0.0:
        gap = 0.0
    return 1.5 * p[0] * pushed - p[3] / (1.0 + gap / p[4]) ** 2


@njit(cache=True, error_model="numpy")
def period(kind, p, lever, z0, dx, steps, y, w, out):
    """March z, z' and the elements, from drive phase 0 to 2 pi."""
    alpha0, base = lever
    h, n = 2.0 * math.pi / steps, len(w)
    a, b = np.zeros((4, n)), np.zeros(n)
    dz, dv = np.zeros(4), np.zeros(4)
    cosine = sine = mean = deepest = lost = virial = 0.0
    for i in range(steps):
        for s in range(4):
            c = 0.0 if s == 0 else (1.0 if s == 3 else 0.5)
            z, v = y[0], y[1]
            if s > 0:
                z, v = z + c * h * dz[s - 1], v + c * h * dv[s - 1]
            d, keep = z - z0, 1.0
            if kind == SOLID:
                for j in range(n):
                    b[j] = w[j] + (c * h * a[s - 1, j] if s > 0 else 0.0)
                    a[s, j] = (max(d - (j * dx) ** 2, p[1] * b[j]) - b[j]) / p[2]
                f = force(kind, p, dx, b, keep, d, v)
            else:
                keep = math.exp(-c * h / p[2])
                f = force(kind, p, dx, w, keep, d, v)
            t = (i + c) * h
            dz[s], dv[s] = v, base * math.cos(t) - z - f - 2.0 * alpha0 * v
            share = h / 6.0 * (1.0 if s == 0 or s == 3 else 2.0)
            cosine += share * z * math.cos(t)
            sine += share * z * math.sin(t)
            mean += share * z
            lost += share * f * v
            virial -= share * f * z
            deepest = max(deepest, d)
        y[0] += h / 6.0 * (dz[0] + 2.0 * dz[1] + 2.0 * dz[2] + dz[3])
        y[1] += h / 6.0 * (dv[0] + 2.0 * dv[1] + 2.0 * dv[2] + dv[3])
        d, keep = y[0] - z0, math.exp(-h / p[2])
        for j in range(n):
            if kind == SOLID:
                w[j] += h / 6.0 * (a[0, j] + 2.0 * a[1, j] + 2.0 * a[2, j] + a[3, j])
            else:
                w[j] = max(d - (j * dx) ** 2, w[j] * keep)
    out[0], out[1], out[2] = cosine / math.pi, sine / math.pi, mean / (2.0 * math.pi)
    out[3], out[4], out[5] = lost, virial / (2.0 * math.pi), deepest


def solve(kind, p, lever, target, steps, elements, start=None):
    """Phase [degree], tip offset, mean [m], dissipation / k, virial / k [m^2], depth [m] at an amplitude [m]."""
    free = lever[1] / (2.0 * lever[0])
    y, w, out = np.array([0.0, free]), np.zeros(2), np.zeros(6)
    z0, deep = target - 0.02 * free, 0.0
    ring = max(int(1.0 / (2.0 * math.pi * lever[0])), 3)
    if start is not None:
        y, z0, deep = start[0].copy(), start[1], start[2]
    if start is None:
        z0, dx, w = free, math.sqrt(2.0 * free) / 100, np.zeros(101)
        for _ in range(60 * ring):
            period(kind, p, lever, z0, dx, 1000, y, w, out)
            z0 += (target - math.hypot(out[0], out[1])) * 0.3 / ring
        deep = out[5]
    for _ in range(2 if start is None else 1):  # the second time with a grid of the right size
        dx, w = math.sqrt(1.15 * deep) / elements, np.zeros(elements + 1)
        for trial in range(40):
            for _ in range(2):
                period(kind, p, lever, z0, dx, steps, y, w, out)
            size, table = 1e-6 * free, np.zeros((3, 4))
            for j in range(4):
                u = np.array([y[0], y[1], z0])
                if j > 0:
                    u[j - 1] += size
                now, field = u[:2].copy(), w.copy()
                period(kind, p, lever, u[2], dx, steps, now, field, out)
                table[:, j] = now[0] - u[0], now[1] - u[1], math.hypot(out[0], out[1]) - target
                if j == 0:
                    kept = field
            jacobian = (table[:, 1:] - table[:, :1]) / size
            move = -np.linalg.solve(jacobian, table[:, 0])
            largest = np.abs(move).max()
            move *= min(1.0, 0.02 * free / largest)
            y, z0, w = y + move[:2], z0 + move[2], kept
            if largest < 1e-11 * free:
                break
        period(kind, p, lever, z0, dx, steps, y.copy(), w, out)
        deep = out[5]
    phase = 90.0 - math.degrees(math.atan2(out[1], out[0]))
    return np.array([phase, z0, *out[2:]]), (y, z0, deep), largest / free


def numbers(case):
    """Kind and parameters as `force` takes them."""
    plain = case["modulus"] / (1.0 - POISSON**2) * 4.0 / 3.0
    pull = 2.0 * math.pi * RADIUS * case["adhesion"] / STIFFNESS
    decay, omega = case["decay_length"] or 1.0, 2.0 * math.pi * FREQUENCY
    stiff = plain * math.sqrt(RADIUS) / STIFFNESS
    if "viscosity" in case:  # F = (4/3) E* sqrt(R) d^1.5 + eta sqrt(R d) d'
        t0 = case["viscosity"] * omega / (1.5 * plain)
        return KELVIN, np.array([stiff, 1.0, t0, pull, decay])
    kappa = 1.0 - case["relaxed_modulus"] / case["modulus"]
    return SOLID, np.array([stiff, kappa, case["relaxation_time"] * omega, pull, decay])


def solved(case, steps=16000, elements=1600):
    """The case with its orbit."""
    kind, p = numbers(case)
    steps *= 6 if kind == KELVIN else 1  # its force sets in as the root of time
    lever = 0.5 / case["quality_factor"], case["free_amplitude"] / case["quality_factor"]
    target = case["setpoint"] * case["free_amplitude"]
    coarse, near, _ = solve(kind, p, lever, target, steps // 2, elements // 2)
    fine, _, left = solve(kind, p, lever, target, steps, elements, near)
    best = fine + (fine - coarse) / 3.0
    found = dict(
        zip(("phase", "tip_offset", "mean_deflection", "dissipation", "virial", "indentation"), best, strict=True)
    )
    found["dissipation"] *= STIFFNESS
    found["virial"] *= STIFFNESS
    print(case, found, "error", fine[0] - coarse[0], "left", left, flush=True)
    return {**case, **found, "error": abs(float(fine[0] - coarse[0]))}


def followed(case, periods=6, steps=16000, elements=1500):
    """The case with z, z' [m] and what the surface took [J] after each of some periods, from a surface as it was."""
    kind, p = numbers(case)
    lever = 0.5 / case["quality_factor"], case["free_amplitude"] / case["quality_factor"]
    runs = []
    for finer in (1, 2):
        dx, w = math.sqrt(case["deepest"]) / (elements * finer), np.zeros(elements * finer + 1)
        y, out, states = np.array(case["start"]), np.zeros(6), []
        for _ in range(periods):
            period(kind, p, lever, case["tip_offset"], dx, steps * finer, y, w, out)
            states.append([*y, out[3] * STIFFNESS])
        runs.append(np.array(states))
    moved = np.abs(runs[1] - runs[0])[:, :2].max() / case["free_amplitude"]
    print(case, "error", moved, flush=True)
    return {**case, "states": (runs[1] + (runs[1] - runs[0]) / 3.0).tolist(), "error": float(moved)}


def seen(time, relaxed=0.5, elements=4000, steps=40000):
    """Loss tangent that a prescribed tap d = A (cos tau - 1) + 3 nm, A = 40 nm, sees; time in 1/omega0."""
    p, dx = np.array([1.0, 1.0 - relaxed, time, 0.0, 1.0]), math.sqrt(3.2) / elements
    w, h, lost, virial = np.zeros(elements + 1), 2.0 * math.pi / steps, 0.0, 0.0
    x2 = (np.arange(elements + 1) * dx) ** 2
    for i in range(steps):
        tau = -math.pi + (i + 0.5) * h
        d, v = 3.0 + 40.0 * (math.cos(tau) - 1.0), -40.0 * math.sin(tau)
        if d < -1.0 and not w.any():
            continue
        rate = np.maximum(d - 0.5 * h * v - x2, p[1] * w) - w
        w_middle = w + 0.5 * h / time * rate
        w = w + h / time * (np.maximum(d - x2, p[1] * w_middle) - w_middle)
        f = spread(SOLID, p, dx, w_middle, 1.0, d, v)
        lost += h * f * v
        virial -= h * f * 40.0 * math.cos(tau)
    return -lost / virial


BASE = {
    "quality_factor": 400.0, "free_amplitude": 40e-9, "setpoint": 0.6, "modulus": 2e9, "adhesion": 0.0,
    "decay_length": None,
}  # fmt: skip
CASES = [
    *({**BASE, "relaxed_modulus": 1e9, "relaxation_time": time} for time in (10e-9, 100e-9, 1e-6)),
    {**BASE, "relaxed_modulus": 0.5e9, "relaxation_time": 100e-9, "adhesion": 0.06, "decay_length": 0.3e-9},
    {**BASE, "relaxed_modulus": 0.05e9, "relaxation_time": 100e-9},  # recovers in 4 us, more than a period
    {
        **BASE, "quality_factor": 10.0, "free_amplitude": 10e-9, "modulus": 2e9, "relaxed_modulus": 0.5e9,
        "relaxation_time": 300e-9, "setpoint": 0.8,
    },
    {**BASE, "modulus": 1e9, "viscosity": 20.0},
    {**BASE, "modulus": 0.2e9, "viscosity": 100.0, "adhesion": 0.06, "decay_length": 0.3e-9, "setpoint": 0.8},
    {**BASE, "modulus": 0.2e9, "viscosity": 1000.0},  # recovers in 4 us
]  # fmt: skip

LIQUID = {**BASE, "quality_factor": 10.0, "free_amplitude": 10e-9, "relaxed_modulus": 0.5e9, "relaxation_time": 300e-9}
HISTORIES = [
    {**LIQUID, "tip_offset": -3e-9, "start": [0.0, 1e-9], "deepest": 20e-9},  # pressed in, and never off
    {
        **LIQUID, "adhesion": 0.06, "decay_length": 0.3e-9, "tip_offset": -1e-9, "start": [-2e-9, 1e-9],
        "deepest": 20e-9,
    },
    {  # several taps in a period
        **LIQUID, "modulus": 20e9, "relaxed_modulus": 5e9, "relaxation_time": 100e-9, "tip_offset": 0.5e-9,
        "start": [-1e-9, 12e-9], "deepest": 8e-9,
    },
]  # fmt: skip


if __name__ == "__main__":
    for case, known in zip((10e-9, 30e-9, 100e-9, 300e-9, 1e-6), (0.0166, 0.0373, 0.0473, 0.0294, 0.0117), strict=True):
        assert abs(seen(case * 2.0 * math.pi * FREQUENCY) - known) < 5e-5  # the integrals of Ting
    found = {"orbits": [solved(case) for case in CASES], "histories": [followed(case) for case in HISTORIES]}
    DATA.write_text(json.dumps(found, indent=1) + "\n")
