"""Makes tests/data/prony.json: orbits over generalised Maxwell solids, by the hereditary integral.

    python tests/reference/prony.py

None of the package's methods is used. The surface under a sphere is, exactly, a row of independent elements (see
make_memory.py): at x it is pushed in by w(x, t), and answers with the hereditary integral over all of its history

    f(x, t) = int E(t - s)/E(0) dw(x, s),  E(t) = E_inf + sum_i E_i exp(-t/tau_i),  F = (3/2) K sqrt(R) int f dx - pull .

As f grows with w, contact is w = max(d - x^2, the w for which f = 0): Ting's rule for all histories. The integral is
summed over equal steps in which w is linear, without further approximation, however short tau_i is. The attraction
outside contact is that over w(0, t).

The motion is periodic: at a prescribed amplitude and tip offset all other harmonics come from those of the force, by
passes; the tip offset is the one at which the force has the harmonic that the drive of the lever leaves over. Grids in
x and in time are made finer together, by halves; the last two are extrapolated, as errors are of second order, and
`error` is what the two last extrapolations differ by [degree]. `check` compares a prescribed tap with Ting's integrals
of 1966 as they stand, which know neither elements nor w.
"""

from __future__ import annotations

import json
import math
import pathlib

import numpy as np
from numba import njit

DATA = pathlib.Path(__file__).parent.parent / "data" / "prony.json"
POISSON = 0.35


@njit(cache=True, error_model="numpy")
def period(d, dx, stiff, shares, keep, gain, y, w, f, centre):
    """March the elements over a period of depths d; f: integral over x at each time, centre: w(0, t).

    `stiff`: of all elements up to each x, over what one has on a half-space per length; there it is x.
    `y` (arms, x): int (1 - exp(-(t - s)/tau_i)) dw, what each dashpot has crept; `keep`, `gain`: of it and of the new w.
    """
    instant = 1.0 - np.sum(shares * gain)  # of a step of w on f
    for n in range(len(d)):
        total, before = 0.0, 0.0
        for i in range(len(w)):
            crept = 0.0
            for a in range(len(shares)):
                y[a, i] = keep[a] * y[a, i] + (1.0 - keep[a] - gain[a]) * w[i]
                crept += shares[a] * y[a, i]
            free = crept / instant
            pushed = d[n] - (i * dx) ** 2
            new = max(pushed, free)
            for a in range(len(shares)):
                y[a, i] += gain[a] * new
            w[i] = new
            force = max(instant * pushed - crept, 0.0)
            if force == 0.0 and before > 0.0:  # the edge, where the line through the last two is 0
                total -= 0.5 * before * (stiff[i] - stiff[i - 1]) * (1.0 - before / (before - instant * pushed + crept))
            if i > 0:
                total += 0.5 * (before + force) * (stiff[i] - stiff[i - 1])
            before = force
        if before > 0.0:
            total = math.nan  # the grid is too small
        f[n], centre[n] = total, w[0]


class Surface:
    """Elements of a material under the tip, with what is left in them of all earlier taps."""

    def __init__(self, one: dict, steps: int, deepest: float) -> None:
        self.one, self.steps = one, steps
        equilibrium, moduli = one["equilibrium"], np.array(one["moduli"])
        first = equilibrium + moduli.sum()
        self.stiffness = 4 / 3 * first / (1 - POISSON**2)
        self.shares = moduli / first
        h = 1 / (one["drive_frequency"] * steps) / np.array(one["times"])
        self.keep = np.exp(-h)
        self.gain = 1 + np.expm1(-h) / h  # of an end value of w that is linear in the step
        self.dx = math.sqrt(1.3 * deepest) / (steps // 10)
        count = steps // 10 + 2
        self.y, self.w = np.zeros((len(moduli), count)), np.zeros(count)
        self.stiff = one.get("stiff", lambda x: x)(self.dx * np.arange(count))

    def force(self, d: np.ndarray) -> np.ndarray:
        """Periodic force [N] under a periodic depth [m], once the elements repeat themselves."""
        f, centre, last = np.empty(len(d)), np.empty(len(d)), np.full(len(d), np.inf)
        for _ in range(3000):
            period(d, self.dx, self.stiff, self.shares, self.keep, self.gain, self.y, self.w, f, centre)
            if np.abs(f - last).max() < 1e-9 * np.abs(f).max() + 1e-30:
                break
            last = f.copy()
        else:
            raise RuntimeError("dents do not come to rest")
        radius = self.one["radius"]
        pull = 2 * math.pi * self.one["adhesion"] * radius
        gap = np.maximum(centre - d, 0.0)
        attraction = -pull / (1 + gap / self.one["decay_length"]) ** 2
        if "neck" in self.one:
            attraction += self.one["neck"](gap)
        return 1.5 * self.stiffness * math.sqrt(radius) * f + attraction


def turned(depth: np.ndarray, force: np.ndarray, one: dict) -> tuple[np.ndarray, complex]:
    """Depth less amplitude and offset that this force makes, and its first harmonic over k."""
    n = np.fft.rfftfreq(len(force), 1 / len(force))
    harmonics = np.fft.rfft(force) / len(force) / one["stiffness"]
    w = one["drive_frequency"] / one["frequency"]
    motion = harmonics / (1 - (n * w) ** 2 + 1j * n * w / one["quality_factor"])
    motion[1] = 0.0
    return -np.fft.irfft(motion * len(force), len(force)), 2 * harmonics[1]


def orbit(one: dict, steps: int, start: tuple[float, float]) -> dict:
    """Orbit of a tip whose offset is near `start`, two offsets [m]."""
    amplitude = one["setpoint"] * one["free_amplitude"]
    w = one["drive_frequency"] / one["frequency"]
    drive = one["free_amplitude"] * abs(1 - w * w + 1j * w / one["quality_factor"])
    theta = 2 * math.pi * np.arange(steps) / steps
    harmonic = amplitude * np.cos(theta)
    surface = Surface(one, steps, one["deepest"])
    beyond = np.zeros(steps)

    def look(z0: float) -> tuple[float, complex, np.ndarray, np.ndarray]:
        nonlocal beyond
        for _ in range(200):
            d = -(z0 + harmonic) + beyond
            force = surface.force(d)
            new, first = turned(d, force, one)
            change, beyond = np.abs(new - beyond).max(), 0.5 * (new + beyond) if one["halved"] else new
            if change < 1e-10 * amplitude:
                break
        else:
            raise RuntimeError("passes do not converge")
        driven = amplitude * (1 - w * w + 1j * w / one["quality_factor"]) - first
        return abs(driven) / drive - 1, driven, d, force

    a, b = start
    fa, fb = look(a)[0], look(b)[0]
    for _ in range(40):
        c = b - fb * (b - a) / (fb - fa)
        a, fa, b = b, fb, c
        fb, driven, d, force = look(b)
        if abs(fb) < 1e-9:
            break
    else:
        raise RuntimeError("no tip offset found")
    rate = -(np.roll(d, -1) - np.roll(d, 1)) / 2
    return {
        "phase": 90 - math.degrees(math.atan2(driven.imag, driven.real)), "tip_offset": b,
        "dissipation": float(-(force * rate).sum()), "indentation": float(d.max()), "peak_force": float(force.max()),
    }  # fmt: skip


def begin(one: dict) -> tuple[float, float]:
    """Two tip offsets [m] that hold the largest one with repulsion: from below, by a harmonic motion."""
    amplitude, steps = one["setpoint"] * one["free_amplitude"], 500
    w = one["drive_frequency"] / one["frequency"]
    drive = one["free_amplitude"] * abs(1 - w * w + 1j * w / one["quality_factor"])
    harmonic = amplitude * np.cos(2 * math.pi * np.arange(steps) / steps)
    last = math.nan
    for depth in np.geomspace(0.5 * amplitude, 1e-3 * amplitude, 60):
        z0 = amplitude - depth
        first = turned(harmonic, Surface(one, steps, depth).force(-z0 - harmonic), one)[1]
        if abs(amplitude * (1 - w * w + 1j * w / one["quality_factor"]) - first) < drive:
            one["deepest"] = 2.5 * (amplitude - last)
            return last, z0
        last = z0
    raise RuntimeError("no orbit that is repulsive")


def solve(one: dict, finest: int = 4000) -> dict:
    """One orbit, extrapolated."""
    start = begin(one)
    rows: list[dict] = []
    steps = finest // 4
    while steps <= finest:
        rows.append(orbit(one, steps, start))
        z0 = rows[-1]["tip_offset"]
        start = (z0, z0 + 1e-3 * rows[-1]["indentation"])
        steps *= 2
    finer = [{name: (4 * b[name] - a[name]) / 3 for name in b} for a, b in zip(rows, rows[1:], strict=False)]
    return {**finer[-1], "error": abs(finer[-1]["phase"] - finer[-2]["phase"])}


def drawn(rng: np.random.Generator) -> dict:
    """A material of 2 to 8 arms and a lever that taps on it."""
    arms = int(rng.integers(2, 9))
    first = 10 ** rng.uniform(8, 9.7)
    weights = rng.dirichlet(np.ones(arms + 1)) * 0.95 + 0.05 / (arms + 1)
    frequency = float(rng.choice([70e3, 150e3, 300e3]))
    return {
        "equilibrium": float(first * weights[0]), "moduli": (first * weights[1:]).tolist(),
        "times": np.sort(10 ** rng.uniform(-9, -5, arms)).tolist(),
        "adhesion": float(rng.choice([0.0, rng.uniform(0.01, 0.1)])), "decay_length": 0.3e-9,
        "radius": float(rng.uniform(5e-9, 20e-9)), "stiffness": float(10 ** rng.uniform(0.3, 1.8)),
        "frequency": frequency, "drive_frequency": frequency, "quality_factor": float(rng.uniform(100, 500)),
        "free_amplitude": float(rng.uniform(20e-9, 80e-9)), "setpoint": float(rng.uniform(0.4, 0.9)),
        "halved": True,
    }  # fmt: skip


def ting(one: dict, amplitude: float, deepest: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] and force [N] of a first contact d = amplitude (cos - 1) + deepest, by Ting's integrals (1966)."""
    omega = 2 * math.pi * one["drive_frequency"]
    last = math.acos(1 - deepest / amplitude) / omega
    t = np.linspace(-last, last, count)
    d = np.maximum(amplitude * (np.cos(omega * t) - 1) + deepest, 0.0)
    h, lags = t[1] - t[0], np.arange(count)
    relaxed = np.full(count, one["equilibrium"])  # E over the interval that ends so many steps before
    for modulus, time in zip(one["moduli"], one["times"], strict=True):
        relaxed += modulus * time / h * -np.expm1(-h / time) * np.exp(-lags * h / time)
    steps, force = np.diff(d), np.zeros(count)
    volumes = np.diff(one.get("elastic", lambda depth: depth**1.5)(d))
    for i in range(1, count):
        kernel = relaxed[i - 1 :: -1]
        pressed, end = i, 1.0
        if t[i] > 0:  # the contact has the radius that it had at t1: int from t1 to t of E(t - s) d' = 0
            since = np.cumsum((kernel * steps[:i])[::-1])[::-1]
            later = np.flatnonzero(since < 0)
            if later[0] == 0:
                break  # the contact has ended
            pressed = later[0]
            end = since[pressed - 1] / (since[pressed - 1] - since[pressed])
        force[i] = kernel[: pressed - 1] @ volumes[: pressed - 1] + end * kernel[pressed - 1] * volumes[pressed - 1]
    return t, 4 / 3 * math.sqrt(one["radius"]) / (1 - POISSON**2) * force


def check(one: dict) -> float:
    """Largest difference between elements and Ting's integrals, over the largest force."""
    amplitude, deepest, steps = 30e-9, 2e-9, 16000
    surface = Surface(one, steps, deepest)
    theta = 2 * math.pi * (np.arange(steps) / steps - 0.5)
    f, centre = np.empty(steps), np.empty(steps)
    d = amplitude * (np.cos(theta) - 1) + deepest
    period(d, surface.dx, surface.stiff, surface.shares, surface.keep, surface.gain, surface.y, surface.w, f, centre)
    t, exact = ting(one, amplitude, deepest, 3001)
    found = np.interp(
        t * 2 * math.pi * one["drive_frequency"], theta, 1.5 * surface.stiffness * math.sqrt(one["radius"]) * f
    )
    return float(np.abs(found - exact).max() / exact.max())


if __name__ == "__main__":
    rng, found = np.random.default_rng(38), []
    while len(found) < 20:
        one = drawn(rng)
        try:
            answer = solve(one)
        except RuntimeError as error:
            print(error)
            continue
        print(f"{len(found)}: {len(one['times'])} arms, Ting {check(one):.1e}", answer)
        found.append({**one, **answer})
    DATA.write_text(json.dumps(found, indent=1) + "\n")
