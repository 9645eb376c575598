"""Checks tests/data/feedback.json with other numerics: runs chosen cases with none of truth_scan.py.

    python tests/reference/check_feedback.py [word]

The equation in (z, z') by the classical Runge-Kutta method in equal steps that know nothing of contact; the lock-in by
the trapezoidal rule; the filter by the matrix exponential of its state space; position and surface from the speed and
the acceleration, period by period.  The tip starts on an orbit guessed from the amplitude and phase in the file and
settles standing still.  Prints the largest difference from the file for two numbers of steps a period.
"""

import json
import math
import pathlib
import sys

import numpy as np
from numba import njit
from scipy.linalg import expm

HERE = pathlib.Path(__file__).parent
DATA = HERE.parent / "data" if (HERE.parent / "data").is_dir() else HERE


@njit(cache=True)
def acceleration(tau, z, v, z0, om, k, q, u0, r, contact, f0, damping, d0):
    """Lengths in nm, k in nN/nm, forces in nN."""
    d = z - z0
    if d < 0.0:
        return u0 * math.cos(om * tau) - z - v / q + f0 / (1.0 - d / d0) ** 2 / k
    force = contact * math.sqrt(r) * d**1.5 - f0
    return u0 * math.cos(om * tau) - z - v / q - 2.0 * damping * math.sqrt(d / r) * v - force / k


@njit(cache=True)
def one_period(z, v, z0, n, om, k, q, u0, r, contact, f0, damping, d0):
    h = 2.0 * math.pi / om / n
    re, im = 0.5 * z, 0.0
    for i in range(n):
        t = i * h
        a1 = acceleration(t, z, v, z0, om, k, q, u0, r, contact, f0, damping, d0)
        v2 = v + 0.5 * h * a1
        a2 = acceleration(t + 0.5 * h, z + 0.5 * h * v, v2, z0, om, k, q, u0, r, contact, f0, damping, d0)
        v3 = v + 0.5 * h * a2
        a3 = acceleration(t + 0.5 * h, z + 0.5 * h * v2, v3, z0, om, k, q, u0, r, contact, f0, damping, d0)
        v4 = v + h * a3
        a4 = acceleration(t + h, z + h * v3, v4, z0, om, k, q, u0, r, contact, f0, damping, d0)
        z += h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4)
        v += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
        w = 0.5 if i == n - 1 else 1.0
        re += w * z * math.cos(2.0 * math.pi * (i + 1) / n)
        im -= w * z * math.sin(2.0 * math.pi * (i + 1) / n)
    return z, v, complex(re, im) * 2.0 / n


def scan(case, n, standing=4000):
    """Line means {direction: (nx, 4)} of height, error, phase and amplitude [nm, degree]."""
    f, nx, o = case["resonance_frequency"] * case["frequency_ratio"], len(case["labels"]), case["overscan"]
    om, k, q, r = case["frequency_ratio"], case["stiffness"], case["quality_factor"], case["tip_radius"] * 1e9
    u0 = case["free_amplitude"] * 1e9 / q
    goal = case["setpoint"] * u0 / math.hypot(1 - om**2, om / q)
    stuff = []
    for m in case["materials"]:
        # Pa to nN/nm2: 1e-9; J/m2 to nN/nm: 1
        contact = 4 / 3 * m["modulus"] / (1 - m["poisson_ratio"] ** 2) * 1e-9
        stuff.append(
            (om, k, q, u0, r, contact, 2 * math.pi * m["adhesion"] * r, m["damping"], case["decay_length"] * 1e9)
        )
    order = case["order"]
    tau_f = math.sqrt(2 ** (1 / order) - 1) / (2 * math.pi * case["bandwidth"])
    held = expm(np.diag([-1.0] * order) / (tau_f * f) + np.diag([1.0] * (order - 1), -1) / (tau_f * f))
    pushed = (np.eye(order) - held) @ np.ones(order)  # the steady state of an input of 1 is 1 everywhere
    lag = math.radians(90 - case["engaged"]["phase"])
    z, v = goal * math.cos(lag), om * goal * math.sin(lag)
    x = np.full(order, goal * np.exp(-1j * lag))
    heights = np.array(case["topography"]) * 1e9
    start = case["engaged"]["tip_offset"] * 1e9 + heights[0]
    offset, integral = start, 0.0
    dwell = 1 / (case["line_rate"] * 2 * (1 + 4 * o) * nx)
    speed, half = 1 / dwell, 2 * o * nx * dwell
    push = speed / half
    sums = {"trace": np.zeros((nx, 5)), "retrace": np.zeros((nx, 5))}
    for i in range(-standing, math.ceil(f / case["line_rate"])):
        t = (max(i, 0) + 0.5) / f  # the middle of the period
        if i < 0:
            at = -o * nx
        elif t < half:
            at = -o * nx + push * t**2 / 2
        elif t < half + nx * dwell:
            at = speed * (t - half)
        elif t < 3 * half + nx * dwell:
            at = (1 + o) * nx - push * (t - 2 * half - nx * dwell) ** 2 / 2
        elif t < 3 * half + 2 * nx * dwell:
            at = nx - speed * (t - 3 * half - nx * dwell)
        else:
            at = -o * nx + push * (4 * half + 2 * nx * dwell - t) ** 2 / 2
        here = min(max(math.floor(at), 0), nx - 1)
        c = min(max(at - 0.5, 0.0), nx - 1.0)
        left = min(int(c), nx - 2)
        surface = heights[left] + (c - left) * (heights[left + 1] - heights[left])
        z, v, a = one_period(z, v, offset - surface, n, *stuff[case["labels"][here]])
        before = x[-1]
        x = held @ x + pushed * a
        e = abs(x[-1]) - goal
        size = (abs(before) + abs(x[-1])) / 2
        phase = math.degrees(np.angle(1j * before) + np.angle(1j * x[-1])) / 2
        found = np.array([offset - goal, size - goal, phase, size, 1.0])
        for name, begin in (("trace", half), ("retrace", 3 * half + nx * dwell)):
            done = math.floor((t - begin) / dwell)  # pixels of this pass that are behind
            for pixel in (done, done + 1):
                # A period counts in the pixel of its middle and in the next, as long as it lasts there.
                time = min(t + 0.5 / f, begin + (pixel + 1) * dwell) - max(t - 0.5 / f, begin + pixel * dwell)
                if i >= 0 and 0 <= pixel < nx and time > 0:
                    sums[name][pixel if name == "trace" else nx - 1 - pixel] += found * time
        integral += case["integral_gain"] * e / f
        offset = start - case["proportional_gain"] * e - integral
    return {way: s[:, :4] / s[:, 4:] for way, s in sums.items()}


def main(word=""):
    for case in json.loads((DATA / "feedback.json").read_text())["cases"]:
        if word not in case["name"]:
            continue
        for n in (2000, 8000):
            found = scan(case, n)
            worst = [
                max(np.max(np.abs(found[way][:, j] - np.array(case[way][key]) * unit)) for way in found)
                for j, (key, unit) in enumerate(
                    (("height", 1e9), ("amplitude_error", 1e9), ("phase", 1.0), ("amplitude", 1e9))
                )
            ]
            print(
                f"{case['name']:36s} {n:5d} steps: {worst[0]:.1e} nm, {worst[1]:.1e} nm, {worst[2]:.1e} degree",
                flush=True,
            )


if __name__ == "__main__":
    main(*sys.argv[1:])
