"""One period of the tapping-mode oscillator in time, for hard cases; independent of phasemap and of shooting.py.

    z'' + 2 (a0 + a_s(d)) z' + z + F(d)/k = u0 cos(w tau),   d = z - z0   (lengths in nm here)

Dormand and Prince's method of order 8 with its error estimate (coefficients from scipy) on (tau, x, z', integral z cos,
integral z sin). Before contact x = d and the independent variable is tau; no step is longer than a quarter radian, so
that no visit to the surface is stepped over.  In contact x = q, d = q^2, dtau = 2 q ds: then d^(3/2) and d^(1/2) are
smooth.  Contact and loss of contact are roots of the step's length, also where the tip turns back within a step.

Every length of time lies in `budget` steps; a period that needs more fails.
"""

import numpy as np
from numba import njit
from scipy.integrate._ivp import dop853_coefficients as _c

A8, B8, E3, E5 = (np.ascontiguousarray(m) for m in (_c.A[:12, :12], _c.B, _c.E3[:12], _c.E5[:12]))
U0, W, AL0, KC, FA, D0, AL1, RT, SC, NUM = range(10)  # places in the parameter vector
N = 5
LONGEST = 0.25


def parameters(case):
    """The parameter vector of a case in SI, and its free amplitude at the drive frequency [nm]."""
    c = {"frequency_ratio": 1.0, "poisson_ratio": 0.35, "contact": "dmt"} | case
    k, q, w, r = c["stiffness"], c["quality_factor"], c["frequency_ratio"], c["tip_radius"]
    p = np.zeros(NUM)
    p[U0], p[W], p[AL0] = c["free_amplitude"] / q * 1e9, w, 0.5 / q
    free = p[U0] / np.hypot(1 - w**2, w / q)
    p[KC] = 4 / 3 * c["modulus"] / (1 - c["poisson_ratio"] ** 2) * np.sqrt(r * 1e-9) / k
    p[FA] = 0.0 if c["contact"] == "hertz" else 2 * np.pi * c["adhesion"] * r / k * 1e9
    p[D0] = c["decay_length"] * 1e9 if c["decay_length"] is not None and p[FA] > 0 else -1.0
    p[AL1], p[RT] = c["damping"], r * 1e9
    p[SC] = free
    return p, free


@njit(cache=True)
def rhs(contact, y, p, z0, f):
    x, v = y[1], y[2]
    a, j = p[AL0], 1.0
    if contact:
        d, j = x * x, 2.0 * x
        force = p[KC] * x * x * x - p[FA]
        if p[AL1] != 0.0:
            a += p[AL1] * x / np.sqrt(p[RT])
    else:
        d, force = x, 0.0
        if p[D0] > 0.0:
            force = -p[FA] / (1.0 - min(x, 0.5 * p[D0]) / p[D0]) ** 2
    z = z0 + d
    c, s = np.cos(p[W] * y[0]), np.sin(p[W] * y[0])
    f[0], f[1] = j, v
    f[2] = j * (p[U0] * c - 2.0 * a * v - z - force)
    f[3], f[4] = j * z * c, j * z * s


@njit(cache=True)
def step(contact, y, h, p, z0, k, yn, tol, noise):
    """One step from y to yn; returns the error in units of the tolerance."""
    for i in range(12):
        for n in range(N):
            t = 0.0
            for m in range(i):
                t += A8[i, m] * k[m, n]
            yn[n] = y[n] + h * t
        rhs(contact, yn, p, z0, k[i])
    e3 = e5 = 0.0
    for n in range(N):
        t = u3 = u5 = 0.0
        for m in range(12):
            t += B8[m] * k[m, n]
            u3 += E3[m] * k[m, n]
            u5 += E5[m] * k[m, n]
        yn[n] = y[n] + h * t
        if n == 1 or n == 2:
            scale = tol * (noise if n == 2 or not contact else noise / max(abs(y[1]), np.sqrt(1e-6 * noise)))
            e3 += (u3 / scale) ** 2
            e5 += (u5 / scale) ** 2
    if e3 == 0.0 and e5 == 0.0:
        return 0.0
    return abs(h) * e5 / np.sqrt((e5 + 0.01 * e3) * 2.0)


@njit(cache=True)
def value(what, y, end):
    return y[1] if what == 0 else y[2] if what == 1 else y[0] - end


@njit(cache=True)
def root(what, contact, y, h, p, z0, k, yn, end, lo):
    """Step length in (lo, h) at which value(what) is zero (Illinois); yn holds the state there."""
    hi, fhi = h, value(what, yn, end)
    if lo > 0.0:
        step(contact, y, lo, p, z0, k, yn, 1.0, 1.0)
        flo = value(what, yn, end)
    else:
        flo = value(what, y, end)
    if (flo > 0.0) == (fhi > 0.0):
        flo = -0.0 * fhi
        lo = 0.0
    x = h
    for _ in range(80):
        x = (lo * fhi - hi * flo) / (fhi - flo) if fhi != flo else 0.5 * (lo + hi)
        if not (min(lo, hi) < x < max(lo, hi)):
            x = 0.5 * (lo + hi)
        step(contact, y, x, p, z0, k, yn, 1.0, 1.0)
        f = value(what, yn, end)
        if f == 0.0 or abs(hi - lo) < 1e-15 * h:
            break
        if (f > 0.0) == (fhi > 0.0):
            hi, fhi = x, f
            flo *= 0.5
        else:
            lo, flo = x, f
            fhi *= 0.5
    return x


@njit(cache=True)
def period(p, z0, s, tol, out, budget=200_000):
    """Let one drive period pass from drive phase 0.

    s = (z, z') is advanced in place.  out = first harmonic (cos, sin), deepest d, contacts (entries; -1: never out of
    contact), steps.  False: more than `budget` steps, or not finite.
    """
    k, y, yn, ym = np.zeros((12, N)), np.zeros(N), np.zeros(N), np.zeros(N)
    end = 2.0 * np.pi / p[W]
    d = s[0] - z0
    contact = d > 0.0 or (d == 0.0 and s[1] > 0.0)
    y[1], y[2] = (np.sqrt(d) if contact else d), s[1]
    # lengths are judged against the amplitude of this state
    noise = max(np.hypot(s[0], s[1] / p[W]), 1e-3 * p[SC])
    hs = np.array([0.02, 0.02])
    deepest, entries, away = d, 0, not contact
    n = 0
    while y[0] < end:
        n += 1
        if n > budget:
            return False
        m = 1 if contact else 0
        h = hs[m] if contact else min(hs[m], min(LONGEST, end - y[0]))
        err = step(contact, y, h, p, z0, k, yn, tol, noise)
        if not (err <= 1.0):
            if h < 1e-14:
                return False
            hs[m] = h * (max(0.2, 0.9 * err ** (-0.125)) if np.isfinite(err) else 0.2)
            continue
        grow = min(4.0, 0.9 * err ** (-0.125)) if err > 0.0 else 4.0
        v0, v1 = y[2], yn[2]
        side = 1.0 if contact else -1.0  # side * x > 0 on this side
        crossed = side * yn[1] < 0.0
        lo = 0.0
        if v0 * v1 < 0.0:  # turns within the step
            ym[:] = yn
            hh = root(1, contact, y, h, p, z0, k, ym, end, 0.0)
            dm = ym[1] * ym[1] if contact else ym[1]
            if v0 > 0.0:
                deepest = max(deepest, dm)
            if side * ym[1] < 0.0 and side * v0 < 0.0:  # over the surface at the turn, seen on the way there
                h, crossed = hh, True
                yn[:] = ym
            elif side * v0 > 0.0 and crossed:  # first away from the surface, then over it
                lo = hh
        if crossed:
            if side * v0 > 0.0 and v0 * v1 > 0.0:  # leaves just where it came in
                hs[m] = 0.3 * h
                continue
            root(0, contact, y, h, p, z0, k, yn, end, lo)
            if contact and yn[0] > end:
                root(2, contact, y, h, p, z0, k, yn, end, 0.0)
                y[:] = yn
                break
            y[:] = yn
            y[1] = 0.0
            if contact and y[2] >= 0.0:  # rounding at a turn on the surface
                y[2] = -1e-300
            contact = not contact
            away = True
            entries += contact
            continue
        if contact and yn[0] > end:
            root(2, contact, y, h, p, z0, k, yn, end, 0.0)
            y[:] = yn
            break
        y[:] = yn
        hs[m] = h * grow if h >= 0.999 * hs[m] else max(hs[m], h)
    d = y[1] * y[1] if contact else y[1]
    s[0], s[1] = z0 + d, y[2]
    out[0], out[1] = y[3] * p[W] / np.pi, y[4] * p[W] / np.pi
    out[2], out[3], out[4] = max(deepest, d), (entries if away else -1), n
    return np.isfinite(s[0]) and np.isfinite(s[1])


@njit(cache=True)
def wait(p, z0, s, count, tol, trail):
    """Let count periods pass; trail[i] = change of s in period i, and its first harmonic."""
    out = np.empty(5)
    for i in range(count):
        a, b = s[0], s[1]
        if not period(p, z0, s, tol, out):
            return False
        trail[i, 0], trail[i, 1], trail[i, 2], trail[i, 3] = s[0] - a, s[1] - b, out[0], out[1]
    return True


@njit(cache=True)
def change(p, u, tol, out, r):
    """r = change of (z, z') over a period from u = (z, z', z0), and amplitude."""
    s = u[:2].copy()
    if not period(p, u[2], s, tol, out):
        return False
    r[0], r[1], r[2] = s[0] - u[0], s[1] - u[1], np.hypot(out[0], out[1])
    return True


@njit(cache=True)
def differentiate(p, u, size, tol, jac):
    """Derivatives of `change` by (z, z', z0), central differences."""
    out, up, down = np.empty(5), np.empty(3), np.empty(3)
    for j in range(3):
        t = u.copy()
        t[j] = u[j] + size
        if not change(p, t, tol, out, up):
            return False
        t[j] = u[j] - size
        if not change(p, t, tol, out, down):
            return False
        for i in range(3):
            jac[i, j] = (up[i] - down[i]) / (2.0 * size)
    return True
