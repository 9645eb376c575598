"""Makes tests/data/bimodal.json: two modes of a lever over a surface, by the equations of motion in time.

    python tests/reference/make_bimodal.py

    z1'' + z1'/Q1 + z1 + F/k1 = u1 cos(tau),   z2'' + (r/Q2) z2' + r^2 (z2 + F/k2) = r^2 u2 cos(W tau)

with tau = 2 pi f1 t, r = f2/f1, both modes driven at once, F of d = z1 + z2 - z0 and d'. The classical Runge-Kutta
method in equal steps that know nothing of contact (halving them changes no digit that is kept); lock-ins with a
Hann window over the last third. As a phase-locked loop does, W is changed until the second mode lags by 90 degrees;
as a feedback does, z0 until the first has its setpoint. Nothing is taken from phasemap. Lengths in nm, forces in nN.
"""

import json
import math
import pathlib

import numpy as np
from numba import njit

DATA = pathlib.Path(__file__).parent.parent / "data" / "bimodal.json"


@njit(cache=True)
def acceleration(tau, y, out, z0, k1, q1, u1, k2, q2, u2, r, w, contact, f0, d0, eta, radius):
    d, v = y[0] + y[2] - z0, y[1] + y[3]
    if d < 0.0:
        f = -f0 / (1.0 - d / d0) ** 2
    else:
        f = contact * math.sqrt(radius) * d**1.5 - f0 + eta * math.sqrt(radius * d) * v
    out[0], out[2] = y[1], y[3]
    out[1] = u1 * math.cos(tau) - y[0] - y[1] / q1 - f / k1
    out[3] = r * r * (u2 * math.cos(w * tau) - y[2] - f / k2) - r * y[3] / q2


@njit(cache=True)
def run(y, periods, steps, z0, k1, q1, u1, k2, q2, u2, r, w, contact, f0, d0, eta, radius):
    """Complex amplitudes of both modes."""
    a, b, c, d, x = np.empty(4), np.empty(4), np.empty(4), np.empty(4), np.empty(4)
    h = 2.0 * math.pi / steps
    first, last = periods * steps * 2 // 3, periods * steps
    s1r, s1i, s2r, s2i, whole, deepest = 0.0, 0.0, 0.0, 0.0, 0.0, -1e9
    for i in range(last):
        t = i * h
        acceleration(t, y, a, z0, k1, q1, u1, k2, q2, u2, r, w, contact, f0, d0, eta, radius)
        for j in range(4):
            x[j] = y[j] + 0.5 * h * a[j]
        acceleration(t + 0.5 * h, x, b, z0, k1, q1, u1, k2, q2, u2, r, w, contact, f0, d0, eta, radius)
        for j in range(4):
            x[j] = y[j] + 0.5 * h * b[j]
        acceleration(t + 0.5 * h, x, c, z0, k1, q1, u1, k2, q2, u2, r, w, contact, f0, d0, eta, radius)
        for j in range(4):
            x[j] = y[j] + h * c[j]
        acceleration(t + h, x, d, z0, k1, q1, u1, k2, q2, u2, r, w, contact, f0, d0, eta, radius)
        for j in range(4):
            y[j] += h / 6.0 * (a[j] + 2.0 * b[j] + 2.0 * c[j] + d[j])
        if i >= first:
            window = 1.0 - math.cos(2.0 * math.pi * (i + 1 - first) / (last - first))
            t = (i + 1) * h
            whole += window
            s1r += window * y[0] * math.cos(t)
            s1i -= window * y[0] * math.sin(t)
            s2r += window * y[2] * math.cos(w * t)
            s2i -= window * y[2] * math.sin(w * t)
            deepest = max(deepest, y[0] + y[2] - z0)
    return 2.0 * complex(s1r, s1i) / whole, 2.0 * complex(s2r, s2i) / whole, deepest


def record(c, periods=2400, steps=1500):
    k1, q1, k2, q2 = c["stiffness"], c["quality_factor"], c["second_stiffness"], c["second_quality_factor"]
    r, radius = c["second_frequency"] / c["resonance_frequency"], c["tip_radius"] * 1e9
    modulus = c["modulus"] / (1 - c["poisson_ratio"] ** 2)
    contact, f0 = 4 / 3 * modulus * 1e-9, 2 * math.pi * c["adhesion"] * radius
    eta = c["viscosity"] * 2 * math.pi * c["resonance_frequency"] * 1e-9
    u1, u2 = c["free_amplitude"] * 1e9 / q1, c["second_free_amplitude"] * 1e9 / q2
    target = c["setpoint"] * c["free_amplitude"] * 1e9
    z0, w = target - 2.0, r * (1 + 0.5 * 1.3 / k2)
    y = np.array([0.0, target, 0.0, u2 * q2 * r])
    before = None
    for turn in range(14):
        z1, z2, deepest = run(y, periods, steps, z0, k1, q1, u1, k2, q2, u2, r, w, contact, f0, 0.3, eta, radius)
        # The second mode as it answers: what its denominator is, and where its real part would be 0.
        denominator = u2 / z2
        stiff = denominator.real - (1 - (w / r) ** 2)
        miss = abs(z1) - target
        done = abs(miss) < 1e-4 and abs(denominator.real) < 2e-6
        if done:
            break
        step = 0.8 * miss if before is None else miss * (z0 - before[0]) / (miss - before[1])
        before = z0, miss
        z0 -= max(min(step, 0.5), -0.5)
        w = r * math.sqrt(1 + stiff)
        # The phase of the drives starts anew, so does the motion: both modes as they swing at the end.
        y = np.array([z1.real, -z1.imag, z2.real, -w * z2.imag])
    assert done, (miss, denominator)
    return {
        "phase": 90 + math.degrees(np.angle(z1)), "amplitude": abs(z1) * 1e-9, "tip_offset": z0 * 1e-9,
        "indentation": deepest * 1e-9, "frequency_shift": (math.sqrt(1 + stiff) - 1) * c["second_frequency"],
        "second_amplitude": abs(z2) * 1e-9,
    }  # fmt: skip


DEFAULTS = dict(
    stiffness=40.0, resonance_frequency=300e3, quality_factor=400.0, free_amplitude=40e-9, setpoint=0.6,
    second_stiffness=1600.0, second_frequency=1.8831e6, second_quality_factor=600.0, second_free_amplitude=0.1e-9,
    tip_radius=10e-9, modulus=1e9, poisson_ratio=0.35, adhesion=0.0, viscosity=0.0,
)  # fmt: skip
SOFT = dict(
    stiffness=3.0, resonance_frequency=70e3, quality_factor=150.0, second_stiffness=120.0, second_frequency=440e3,
    second_quality_factor=300.0,
)  # fmt: skip
CASES = [
    dict(),
    dict(adhesion=0.03, viscosity=10.0),
    dict(modulus=3e9, viscosity=5.0),
    dict(modulus=0.3e9, setpoint=0.8),
    dict(second_free_amplitude=0.5e-9),
    dict(second_free_amplitude=1.0e-9),
    dict(second_free_amplitude=2.0e-9),
    dict(second_free_amplitude=0.25e-9),
    dict(adhesion=0.06, viscosity=10.0, setpoint=0.8, second_free_amplitude=0.25e-9),
    dict(modulus=3e9, adhesion=0.05, viscosity=5.0),
    dict(modulus=10e9, second_free_amplitude=0.05e-9),
    dict(modulus=10e9, adhesion=0.05, viscosity=5.0, second_free_amplitude=0.05e-9),
    dict(modulus=30e9, second_free_amplitude=0.03e-9),
    dict(SOFT),
    dict(SOFT, modulus=0.1e9, second_free_amplitude=0.3e-9),
    # Drawn at random: where adhesion hides how hard the tap is from the virial.
    dict(
        free_amplitude=28.7e-9,
        setpoint=0.625,
        second_free_amplitude=0.102e-9,
        tip_radius=15.8e-9,
        modulus=0.4e9,
        adhesion=0.0587,
    ),
    dict(
        SOFT,
        free_amplitude=42.1e-9,
        setpoint=0.755,
        second_free_amplitude=0.111e-9,
        tip_radius=11.5e-9,
        modulus=0.251e9,
        adhesion=0.0414,
        viscosity=1.34,
    ),
    # Where the second mode answers harmonics of the taps: the first was found by an audit, the others are drawn.
    dict(
        stiffness=33.907,
        quality_factor=139.13,
        free_amplitude=2.3089e-08,
        setpoint=0.55,
        second_stiffness=1313.5,
        second_frequency=1867200.0,
        second_quality_factor=525.04,
        second_free_amplitude=4.3553e-11,
        tip_radius=1.0213e-08,
        modulus=3866500000.0,
        adhesion=0.056827,
        viscosity=29.304,
    ),
    dict(
        stiffness=47.781,
        quality_factor=147.41,
        free_amplitude=5.5877e-08,
        setpoint=0.76373,
        second_stiffness=1925.8,
        second_frequency=1864500.0,
        second_quality_factor=537.02,
        second_free_amplitude=4.02e-11,
        tip_radius=9.6775e-09,
        modulus=1571600000.0,
        adhesion=0.057939,
        viscosity=1.0861,
    ),
    dict(
        stiffness=31.94,
        quality_factor=351.48,
        free_amplitude=1.8414e-08,
        setpoint=0.52854,
        second_stiffness=1368.4,
        second_frequency=1944200.0,
        second_quality_factor=599.69,
        second_free_amplitude=5.9284e-11,
        tip_radius=1.7294e-08,
        modulus=4345200000.0,
        adhesion=0.055097,
        viscosity=1.7739,
    ),
    dict(
        stiffness=27.355,
        quality_factor=260.7,
        free_amplitude=1.9691e-08,
        setpoint=0.76709,
        second_stiffness=1137.5,
        second_frequency=1834300.0,
        second_quality_factor=320.43,
        second_free_amplitude=5.2717e-11,
        tip_radius=1.9942e-08,
        modulus=776850000.0,
        adhesion=0.017981,
    ),
    dict(
        stiffness=33.735,
        quality_factor=150.47,
        free_amplitude=5.614e-08,
        setpoint=0.54695,
        second_stiffness=1226.9,
        second_frequency=1841200.0,
        second_quality_factor=254.32,
        second_free_amplitude=6.8866e-11,
        tip_radius=7.3153e-09,
        modulus=2208600000.0,
        adhesion=0.01008,
    ),
    dict(
        stiffness=1.5148,
        quality_factor=144.56,
        free_amplitude=4.0693e-08,
        setpoint=0.55268,
        second_stiffness=60.377,
        second_frequency=1949200.0,
        second_quality_factor=339.64,
        second_free_amplitude=7.772e-11,
        tip_radius=1.7534e-08,
        modulus=232670000.0,
        adhesion=0.015065,
        viscosity=17.938,
    ),
]

if __name__ == "__main__":
    found = []
    for case in CASES:
        case = {**DEFAULTS, **case}
        found.append({**case, **record(case, steps=1500 if case["modulus"] < 9e9 else 2500)})
        one = found[-1]
        k1 = 2 * 0.5 * one["stiffness"] / one["quality_factor"] * one["free_amplitude"] / one["amplitude"]
        k1 *= math.sin(math.radians(one["phase"]))
        k2 = 2 * one["second_stiffness"] * one["frequency_shift"] / one["second_frequency"]
        modulus = math.sqrt(2) * k2**2 / (k1 * math.sqrt(one["tip_radius"] * one["amplitude"]))
        print(
            f"{one['frequency_shift']:10.2f} {k2:8.4f} {modulus / one['modulus'] * (1 - 0.35**2):8.4f}",
            one["indentation"],
            one["second_amplitude"],
            flush=True,
        )
    DATA.write_text(json.dumps(found, indent=1) + "\n")
