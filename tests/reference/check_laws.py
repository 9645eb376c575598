"""Are the orbits of laws.json orbits?  Another integrator (scipy's DOP853 in z, z' and tau, solve_ivp events, the formulas of the laws
written again in SI by bracketing a or m) goes once round from `start`; prints how far it comes back, and phase and
amplitude.

    python tests/reference/check_laws.py [how many orbits]
"""

import json
import math
import pathlib
import sys

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

HERE = pathlib.Path(__file__).parent
DATA = HERE.parent / "data" if (HERE.parent / "data").is_dir() else HERE


def force(c):
    """F(d, touching) [N], release depth [m], in SI and by root finding."""
    R, w, V = c["tip_radius"], c["adhesion"], c["bias"] or 0.0
    E = c["modulus"] / (1 - c["poisson_ratio"] ** 2)
    K, d0, f0 = 4 / 3 * E, c["decay_length"], 2 * math.pi * w * R * (c["law"] != "hertz")

    def bias(d):
        if not V:
            return 0.0
        g = d0 - min(d, 0.0)
        return -math.pi * 8.8541878128e-12 * V * V * R * R / (g * (g + R))

    def away(d):
        return (-f0 / (1 - d / d0) ** 2 if d0 else 0.0) + bias(d)

    law, release = c["law"], 0.0
    if law in ("hertz", "dmt", "neck"):
        release = -c["neck_length"] if law == "neck" else 0.0
        touch = lambda d: K * math.sqrt(R) * max(d, 0) ** 1.5 - f0  # noqa: E731
    elif law == "spring":
        touch = lambda d: 2 * E * R * d - f0  # noqa: E731
    elif law == "jkr":
        ac = (math.pi * w * R * R / (8 * E)) ** (1 / 3)
        release = -3 * ac * ac / R
        D = lambda a: a * a / R - 2 / 3 * math.sqrt(6 * math.pi * w * a / K)  # noqa: E731

        def touch(d):
            if d <= release:
                return K * ac**3 / R - math.sqrt(6 * math.pi * w * K * ac**3)
            a = brentq(lambda a: D(a) - d, ac, 10 * ac + 3 * math.sqrt(R * abs(d)), xtol=1e-25, rtol=1e-15)
            return K * a**3 / R - math.sqrt(6 * math.pi * w * K * a**3)
    else:  # m from A by bracketing, A from d along the branch of large A
        lam = 2 * (w / d0) * (R / (math.pi * w * K * K)) ** (1 / 3)
        sd = (math.pi**2 * w**2 * R / K**2) ** (1 / 3)

        def t_of(A):  # t = sqrt(m^2 - 1)
            def eq(t):
                m, at = math.hypot(1, t), math.atan(t)
                return lam * A * A / 2 * (t + (m * m - 2) * at) + 4 * lam * lam * A / 3 * (t * at - m + 1) - 1

            hi = 1.0
            while eq(hi) < 0:
                hi *= 2
            return brentq(eq, 0, hi, xtol=1e-15, rtol=1e-15)

        def D(A):
            return A * A - 4 / 3 * lam * A * t_of(A)

        As = np.linspace(1e-4, 3, 3000)
        Ds = np.array([D(A) for A in As])
        i = int(np.argmin(Ds))
        if 0 < i:
            lo, hi = As[i - 1], As[i + 1]
            for _ in range(80):
                a, b = lo + 0.382 * (hi - lo), lo + 0.618 * (hi - lo)
                lo, hi = (lo, b) if D(a) < D(b) else (a, hi)
            least = 0.5 * (lo + hi)
        else:
            least = 1e-6
        release = D(least) * sd

        def touch(d):
            A = (
                brentq(lambda A: D(A) - d / sd, least, 3 + 2 * math.sqrt(abs(d) / sd), xtol=1e-15, rtol=1e-15)
                if d > release
                else least
            )
            t = t_of(A)
            m = math.hypot(1, t)
            return math.pi * w * R * (A**3 - lam * A * A * (t + m * m * math.atan(t)))

    return away, lambda d: touch(d) + bias(0.0), release


def round_trip(c, o):
    away, touch, release = force(c)
    k, w, nm = c["stiffness"], c["frequency_ratio"], 1e-9
    a0, u0, z0 = 0.5 / c["quality_factor"], c["free_amplitude"] / c["quality_factor"], o["tip_offset"]
    s = o["start"]
    t, y, mode = s["drive_angle"] / w, [(s["deformation"] + z0) / nm, s["velocity"] / nm, 0.0, 0.0, 0.0], s["mode"] > 0
    y0, end = list(y), t + 2 * math.pi / w
    down = lambda t, y: y[0] * nm - z0 - (release if mode else 0.0)  # noqa: E731
    down.terminal = True
    n = 0
    while t < end - 1e-13:
        down.direction = -1.0 if mode else 1.0

        def rate(t, y):
            d = y[0] * nm - z0
            f = touch(d) if mode else away(min(d, 0.0))
            al = c["damping"] * math.sqrt(max(d, 0.0) / c["tip_radius"]) if mode else 0.0
            cs, sn = math.cos(w * t), math.sin(w * t)
            acc = u0 * cs / nm - 2 * (a0 + al) * y[1] - y[0] - f / k / nm
            return [y[1], acc, y[0] * cs * w / math.pi, y[0] * sn * w / math.pi, (f / k / nm + 2 * al * y[1]) * y[1]]

        r = solve_ivp(rate, (t, end), y, method="DOP853", rtol=2e-12, atol=1e-12, events=down, max_step=0.05)
        t, y = r.t[-1], list(r.y[:, -1])
        if t < end:
            mode = not mode
            n += 1
            if mode:
                y[0] = z0 / nm + 1e-14
        if n > 20:
            break
    back = math.hypot(y[0] - y0[0], y[1] - y0[1]) / (o["amplitude"] / nm)
    h = complex(y[2], y[3])
    return (
        back,
        abs(h) * nm / o["amplitude"] - 1,
        90 - math.degrees(math.atan2(h.imag, h.real)) - o["phase"],
        y[4] * k * nm * nm - o["dissipation"],
    )


if __name__ == "__main__":
    most = int(sys.argv[1]) if len(sys.argv) > 1 else 10**6
    for c in json.loads((DATA / "laws.json").read_text())[::-1]:
        for o in c["orbits"]:
            if most <= 0:
                break
            most -= 1
            b, a, f, e = round_trip(c, o)
            print(
                f"{c['name']:45s} back {b:.0e} amplitude {a:+.0e} phase {f:+.0e} deg dissipation {e:+.0e} J", flush=True
            )
