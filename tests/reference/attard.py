"""A sphere over a viscoelastic half-space that deforms under the full pressure between them, in time (after Attard).

The surface rises by u(r, t) under the pressure p of a Lennard-Jones sphere over the gap h,

    h(r, t) = h0(t) + r^2/2R - u ,   p(h) = A/(6 pi h^3) (z0^6/h^6 - 1) ,   w = A/(16 pi z0^2) ,
    E* u = - integral of k(r, s) p(s) s ds ,   k(r, s) = 4/(pi r) K(s/r) for s < r, and with s and r exchanged,

and a three-element solid creeps by 1/E(t) = 1/E_inf + (1/E_0 - 1/E_inf) exp(-t/tau), that is

    u' = - (u - u_inf)/tau - (1/E_0) integral of k p' s ds ,   u_inf = u of E_inf under the same p

(P. Attard, Phys. Rev. E 63, 061604 (2001); J. Phys.: Condens. Matter 19, 473201 (2007)). The papers themselves could not be
read again. A published program that cites them (a class `sim_rajabifar_1` after Rajabifar et al., 2018) has p, p_h, k and u'
as here, with tau the time of creep, not that of relaxation: tau = tau_relaxation E_0/E_inf. That u' follows from E(t), and w
from the integral of p, was derived anew. Different from the papers are

* rings of constant pressure, whose displacement is a difference of two discs (Johnson, Contact Mechanics, 3.4.2: elliptic
  integrals), in place of a sum over nodes with a term for the logarithm on the diagonal;
* implicit steps (two stages, second order, L-stable) in place of u' from a linear system, which is singular where a soft
  surface jumps to the tip. E_0 answers after `delay`, a time far below that of a contact, so that the jump takes a time.

The lever has one mode and is driven at its resonance. The amplitude is given, so that the harmonics of the force say
which force drives it, and the height of the tip is the root of one equation. Units: nm, ns, nN, GPa. Nothing of phasemap is used.

    python tests/reference/attard.py

makes tests/data/attard.json, in two minutes of processor time.
"""

from __future__ import annotations

import json
import math
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

Array = np.ndarray

STAGE = 1 - 1 / math.sqrt(2)  # of a step, of each stage: L-stable and of second order
HARMONICS = 8


def disc(a: Array, r: Array) -> Array:
    """E* times the displacement at r [nm] under the pressure 1 on a disc of radius a [nm]."""
    near, far = np.minimum(a, r), np.maximum(a, r)
    m = (near / far) ** 2
    outside = ellipe(m) - np.where(m < 1, (1 - m) * ellipk(np.minimum(m, 1 - 1e-15)), 0)
    return 4 / math.pi * far * np.where(r < a, ellipe(m), outside)


@dataclass
class Sample:
    """A half-space under a sphere. Moduli are E/(1 - nu^2) [GPa]; rings of `width` up to `fine`, then growing up to `reach`."""

    radius: float
    instant: float  # E_0
    relaxed: float  # E_inf
    creep: float  # tau [ns]
    work: float  # w [J/m^2]
    z0: float  # gap at which the pressure is 0 [nm]
    width: float
    fine: float
    reach: float = 60.0
    attraction: float = 1.0  # 0: the repulsive part of the pressure alone
    delay: float = 0.03  # [ns] of E_0: sound crosses the contact in it
    r: Array = field(init=False)
    area: Array = field(init=False)
    kernel: Array = field(init=False)

    def __post_init__(self) -> None:
        edges = list(np.arange(0, self.fine, self.width))
        while edges[-1] < self.reach:
            edges.append(edges[-1] + max(self.width, 0.15 * (edges[-1] - self.fine)))
        inner, outer = np.array(edges[:-1]), np.array(edges[1:])
        self.r, self.area = (inner + outer) / 2, math.pi * (outer**2 - inner**2)
        self.kernel = disc(outer[None], self.r[:, None])
        self.kernel[:, 1:] -= disc(inner[None, 1:], self.r[:, None])

    @property
    def compliance(self) -> Array:
        """1/E* of the two elements, that which answers at once and that which creeps [1/GPa]."""
        return np.array([1 / self.instant, 1 / self.relaxed - 1 / self.instant])

    def tap(self, motion: Array, period: float, parts: Array, tolerance: float = 1e-2, longest: float = 0.01) -> Array:
        """Columns t, F, u(0) and h(0) of one period, from where the tip is highest; `parts`, the state, is left at the end.

        h0 = Re sum of motion[n] exp(i n theta), theta = pi at the start. `tolerance`: of a step, in z0; `longest` in periods.
        """
        times = np.array([self.delay, self.creep])
        law = np.array([8 / 3 * self.work / self.z0, self.z0, self.attraction])
        return march(
            motion, period, parts, self.r**2 / 2 / self.radius, self.kernel, self.area, self.compliance, times, law,
            tolerance, longest,
        )  # fmt: skip


@njit(cache=True)
def settle(h: Array, gap: Array, c: float, kernel: Array, law: Array) -> bool:
    """Gap h under the pressure that it causes, h = gap + c kernel p(h), by Newton's method from the h given."""
    for _ in range(40):
        x = law[1] / h
        p = law[0] * (x**9 - law[2] * x**3)
        slope = -law[0] * (9 * x**9 - 3 * law[2] * x**3) / h
        change = gap + c * (kernel @ p) - h
        # Where pressure hardly depends on the gap, it is left to the next round.
        stiff = np.nonzero(c * np.diag(kernel) * np.abs(slope) > 1e-4)[0]
        columns = kernel[:, stiff] * (-c * slope[stiff])
        if len(stiff) > 0:
            moved = np.linalg.solve(columns[stiff] + np.eye(len(stiff)), change[stiff])
            change -= columns @ moved
        for i in range(len(h)):  # h^-9 lets no step shrink a gap much
            h[i] += min(max(change[i], -0.2 * h[i]), max(0.5 * h[i], 0.5 * law[1]))
        if np.max(np.abs(change)) < 1e-6 * law[1]:
            return True
    return False


@njit(cache=True)
def height(motion: Array, theta: float) -> float:
    h0 = 0.0
    for n in range(len(motion)):
        h0 += (motion[n] * np.exp(1j * n * theta)).real
    return h0


@njit(cache=True)
def march(
    motion: Array, period: float, parts: Array, shape: Array, kernel: Array, area: Array, compliance: Array, times: Array,
    law: Array, tolerance: float, longest: float,
) -> Array:  # fmt: skip
    """One period in steps; see `Sample.tap`. An element follows part' = (compliance E* u - part)/time."""
    rows = []
    t, dt, n = 0.0, 1e-4 * period, len(shape)
    h = height(motion, math.pi) + shape - parts[0] - parts[1]
    h_before, dt_before, h_new, new = h.copy(), dt, h.copy(), parts.copy()
    while t < period * (1 - 1e-12):
        dt = min(dt, longest * period, period - t)
        good = True
        rate = np.zeros((2, n))
        predicted = np.maximum(h + (h - h_before) * (dt / dt_before), 0.8 * h)
        for stage in range(2):
            at = t + (STAGE if stage == 0 else 1.0) * dt
            gap, c = height(motion, math.pi + 2 * math.pi * at / period) + shape, 0.0
            base = parts + (1 - STAGE) * dt * rate  # rate is 0 before the first stage
            for e in range(2):
                share = STAGE * dt / (STAGE * dt + times[e])
                gap = gap - base[e] * (1 - share)
                c += share * compliance[e]
            h_new = h + (predicted - h) * (STAGE if stage == 0 else 1.0)
            good = good and settle(h_new, gap, c, kernel, law)
            x = law[1] / h_new
            p = law[0] * (x**9 - law[2] * x**3)
            push = -(kernel @ p)
            for e in range(2):
                share = STAGE * dt / (STAGE * dt + times[e])
                new[e] = base[e] * (1 - share) + share * compliance[e] * push
                rate[e] = (new[e] - base[e]) / (STAGE * dt)
            if not good:
                break
        error = np.max(np.abs(h_new - predicted) / np.maximum(h_new, law[1])) if good else 1e9
        if error > 4 * tolerance and dt > 1e-7 * period:
            dt *= 0.4 if good else 0.25
            continue
        t += dt
        h_before, dt_before, h = h, dt, h_new.copy()
        parts[:] = new
        rows.append((t, area @ p, parts[0, 0] + parts[1, 0], h[0]))
        dt *= min(1.6, 0.9 * math.sqrt(tolerance / max(error, 1e-12)))
    return np.array(rows)


def harmonics(rows: Array, period: float) -> Array:
    """Complex amplitudes of the force, F = Re sum of F_n exp(i n theta); the mean is their first."""
    theta = math.pi + 2 * math.pi * np.append(0, rows[:, 0]) / period
    force = np.append(rows[-1, 1], rows[:, 1])
    n = np.arange(HARMONICS + 1)[:, None]
    found = np.trapezoid(force * np.exp(-1j * n * theta), theta, axis=1) / math.pi
    found[0] /= 2
    return found


@dataclass(frozen=True)
class Lever:
    """One mode, driven by a force at its resonance: stiffness [nN/nm], quality factor, free amplitude [nm], period [ns]."""

    stiffness: float
    quality: float
    free: float
    period: float

    def force_left(self, amplitude: float, force: Array) -> float:
        """Force that the amplitude takes beyond that of the drive [nN]; 0 on an orbit."""
        return (
            abs(1j * self.stiffness * amplitude / self.quality + force[1]) - self.stiffness * self.free / self.quality
        )

    def motion(self, height: float, amplitude: float, force: Array) -> Array:
        """h0 of a tip that moves by the amplitude and the answers of the lever to the other harmonics."""
        n = np.arange(HARMONICS + 1)
        n[1] = 0  # the amplitude is given
        moved = -force / (self.stiffness * (1 - n**2 + 1j * n / self.quality))
        moved[1] = amplitude
        return np.append(height, np.zeros(HARMONICS)) - moved


@dataclass
class Taps:
    """Taps on a sample at one amplitude; what a tap leaves in surface and lever the next one begins with."""

    sample: Sample
    lever: Lever
    amplitude: float
    tolerance: float = 1e-2
    count: int = 0
    rows: Array = field(init=False)

    def __post_init__(self) -> None:
        self.parts = np.zeros((2, len(self.sample.r)))
        self.force = np.zeros(HARMONICS + 1, complex)

    def at(self, height: float) -> float:
        """Force left where the tip's rest position is so high, once taps repeat; below 0 where attraction prevails."""
        for _ in range(200):
            before, force = self.parts.copy(), self.force
            motion = self.lever.motion(height, self.amplitude, force)
            self.rows = self.sample.tap(motion, self.lever.period, self.parts, self.tolerance)
            self.force = harmonics(self.rows, self.lever.period)
            self.count += 1
            left = 1 - math.exp(-self.lever.period / self.sample.creep)
            if np.max(np.abs(self.parts - before)) < 1e-3 * left * self.sample.z0 and (
                abs(self.force - force)[2:].max() < 1e-3 * max(abs(self.force[1]), 1e-3)
            ):
                break
        left = self.lever.force_left(self.amplitude, self.force)
        return left if self.force[1].real > 0 else -abs(left)

    def orbit(self, guess: float) -> dict[str, float]:
        """The orbit in the repulsive regime, sought from a height [nm] on: phase [degree], forces [nN], dissipation [eV]."""
        low = guess
        while self.at(low) < 0:
            low -= 2
        while self.at(low + 2) > 0:
            low += 2
        height = brentq(self.at, low, low + 2, xtol=2e-4)
        if abs(self.at(height)) > 1e-3 * self.lever.stiffness * self.lever.free / self.lever.quality:
            raise ValueError("no orbit in the repulsive regime")
        push = self.force[1]
        spent = self.lever.stiffness * self.amplitude / self.lever.quality + push.imag
        found = {
            "height": height,
            "phase": math.degrees(math.atan2(push.real, spent)),
            "dissipation": math.pi * self.amplitude * push.imag / 0.1602176634,
            "peak": self.rows[:, 1].max(),
            "lowest": self.rows[:, 1].min(),
            "rise": self.rows[:, 2].max(),
        }
        return {name: round(float(value), 5) for name, value in found.items()}


# SI units. `width` and `fine` are those of the rings, and z0 is the gap of the Lennard-Jones pressure, all in nm.
SCOPE = {"stiffness": 10.0, "frequency": 150e3, "quality_factor": 200.0, "free_amplitude": 60e-9, "radius": 10e-9}
SETPOINTS = (0.85, 0.7, 0.5)
MATERIALS: list[dict[str, Any]] = [
    {"modulus": 2e9, "adhesion": 0.05, "z0": 0.3, "width": 0.15, "fine": 6.0},
    {"modulus": 100e6, "adhesion": 0.05, "z0": 0.5, "width": 0.15, "fine": 12.0},
    {"modulus": 10e6, "adhesion": 0.07, "z0": 2.5, "width": 0.25, "fine": 24.0},
    {"modulus": 1e9, "relaxed_modulus": 0.5e9, "relaxation_time": 1e-6, "adhesion": 0.05, "z0": 0.4, "width": 0.15, "fine": 7.0},
    {"modulus": 1e9, "relaxed_modulus": 0.5e9, "relaxation_time": 10e-6, "adhesion": 0.05, "z0": 0.4, "width": 0.15, "fine": 7.0},
    {"modulus": 0.2e9, "relaxed_modulus": 0.05e9, "relaxation_time": 1e-6, "adhesion": 0.05, "z0": 0.7, "width": 0.2, "fine": 13.0},
]  # fmt: skip


def sample_of(material: dict[str, Any], coarser: float = 1.0) -> Sample:
    """Sample of a row of MATERIALS; Poisson's ratio is 1/2. An elastic one hardly creeps."""
    instant = material["modulus"] / 0.75e9
    relaxed = material.get("relaxed_modulus", (1 - 1e-9) * material["modulus"]) / 0.75e9
    creep = 1e9 * material.get("relaxation_time", 1e-9) * instant / relaxed
    return Sample(
        1e9 * SCOPE["radius"], instant, relaxed, creep, material["adhesion"], material["z0"],
        coarser * material["width"], material["fine"],
    )  # fmt: skip


def taps_on(material: dict[str, Any], setpoint: float, coarser: float = 1.0) -> tuple[Taps, float]:
    """Taps at a setpoint, and the height at which Hertz's force alone would hold it."""
    lever = Lever(SCOPE["stiffness"], SCOPE["quality_factor"], 1e9 * SCOPE["free_amplitude"], 1e9 / SCOPE["frequency"])
    amplitude, sample = setpoint * lever.free, sample_of(material, coarser)
    push = lever.stiffness / lever.quality * math.sqrt(lever.free**2 - amplitude**2)
    depth = math.sqrt(2 * push / sample.instant / math.sqrt(sample.radius) * math.sqrt(amplitude / 2))
    return Taps(sample, lever, amplitude, coarser * 3e-2), amplitude - depth


def main() -> None:
    found = []
    for material in MATERIALS:
        for setpoint in SETPOINTS:
            taps, guess = taps_on(material, setpoint)
            begun = time.process_time()
            orbit = {**material, "setpoint": setpoint, **taps.orbit(guess)}
            orbit |= {"taps": taps.count, "seconds": round(time.process_time() - begun, 1), "error": None}
            if setpoint == SETPOINTS[1]:  # by wider rings and longer steps, which err at least as much
                coarse = taps_on(material, setpoint, 1.5)[0].orbit(orbit["height"] - 1)
                orbit["error"] = round(abs(coarse["phase"] - orbit["phase"]), 5)
            print(orbit, flush=True)
            found.append(orbit)
    path = Path(__file__).parents[1] / "data" / "attard.json"
    path.write_text(json.dumps({"scope": SCOPE, "orbits": found}, indent=1) + "\n")


if __name__ == "__main__":
    main()
