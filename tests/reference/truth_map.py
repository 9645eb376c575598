"""One period of the tapping oscillator under any contact law, with its derivatives.  Shares nothing with phasemap.

    z'' + 2 (a0 + a_s(d)) z' + z + F/k = u0 cos(theta),   theta' = omega,   d = z - z0   (lengths in nm, forces as F/k
    in nm)

The tip is in one of three modes: 0 apart, 1 in contact with d >= 0, 2 in a neck (in contact with release < d < 0).  In
each the state is (theta, x, v), d = D(x), and the independent variable s runs with d tau = D'(x) ds, so that dx/ds = v:

    mode 0   x = d
    mode 1   x = sqrt(d) (hertz, dmt, spring, neck, maugis); JKR: sqrt(a) = sqrt(a at d = 0) + x^2; so d^1.5 and d^0.5
    are smooth mode 2   JKR: x = a; Maugis: x = -phi, cos(phi) = a/c (c and d are closed forms of phi); neck: x = d.
             At a fold of d(a), D' = 0 and nothing is singular.

Dormand and Prince's order 8 (coefficients from scipy).  Changes of mode are roots of the step length, also where the
tip turns back within a step.  The derivatives with respect to the state at the start (d, v), z0 and omega are those of
the variational equation in s, projected along the flow onto every event, hence with the jumps that changes of mode
bring (saltation).
"""

import math

import numpy as np
from numba import njit
from scipy.integrate._ivp import dop853_coefficients as _c
from scipy.optimize import brentq

A8, B8, E3, E5 = (np.ascontiguousarray(m) for m in (_c.A[:12, :12], _c.B, _c.E3[:12], _c.E5[:12]))
EPS0 = 8.8541878128e-12
LAW, U0, AL0, RT, AL1, KS, FA, FLR, D0, BE, BC, SP, KH, CJ = range(14)
KAP, B0, XR, X0, DREL, LAM, SD, SF, PHI0, SZ, XS1, XS2, ISDMT = range(14, 27)
HERTZ, SPRING, JKR, MAUGIS, NECK = range(5)
NT = 4  # derivatives: d, v, z0, omega
PLAIN, TANGENT, DIAG = 0, 1, 2
NDIAG = 24
NH = 6
MAXSEG = 400


def contact_constant(case):
    """Reduced modulus E* of a rigid tip."""
    return case["modulus"] / (1 - case.get("poisson_ratio", 0.35) ** 2)


def parameters(case):
    """Parameter vector of a case in SI, drive frequency ratio, and free amplitude at the drive [nm]."""
    p = np.zeros(27)
    k, q, w, r = case["stiffness"], case["quality_factor"], case.get("frequency_ratio", 1.0), case["tip_radius"] * 1e9
    es = contact_constant(case) / k * 1e-9  # 1/nm
    kh, wh, law = 4 / 3 * es, case["adhesion"] / k, case["law"]
    f0 = 2 * np.pi * wh * r if law != "hertz" else 0.0
    p[U0], p[AL0], p[RT], p[AL1] = case["free_amplitude"] / q * 1e9, 0.5 / q, r, case["damping"]
    p[KS], p[FA], p[SP], p[KH] = kh * np.sqrt(r), f0, 2 * es * r, kh
    d0 = case.get("decay_length")
    p[D0] = d0 * 1e9 if d0 else 1.0
    p[FLR] = f0 if d0 else 0.0
    v = case.get("bias") or 0.0
    p[BE] = np.pi * EPS0 * v * v / k * 1e9
    p[BC] = p[BE] * r * r / (p[D0] * (p[D0] + r))
    free = p[U0] / abs(complex(1 - w * w, w / q))
    p[SZ] = free
    p[XS1] = p[XS2] = math.sqrt(free)
    if law in ("hertz", "dmt"):
        p[LAW] = HERTZ
    elif law == "spring":
        p[LAW] = SPRING
    elif law == "neck":
        p[LAW], p[XR], p[X0], p[DREL], p[XS2] = NECK, -case["neck_length"] * 1e9, 0.0, -case["neck_length"] * 1e9, free
    elif law == "jkr":
        p[LAW], p[CJ], p[KAP] = JKR, math.sqrt(6 * np.pi * wh * kh), 2 / 3 * math.sqrt(6 * np.pi * wh / kh)
        p[B0] = (p[KAP] * r) ** (1 / 3)
        ac = (np.pi * wh * r * r / (8 * es)) ** (1 / 3)
        p[XR], p[X0], p[DREL] = ac, p[B0] ** 2, -3 * ac * ac / r
        p[XS1], p[XS2] = math.sqrt(p[B0]), p[B0] ** 2
    elif law == "maugis":
        p[LAW], p[LAM] = MAUGIS, 2 * wh / p[D0] * (r / (np.pi * wh * kh * kh)) ** (1 / 3)
        p[SD], p[SF] = (np.pi**2 * wh**2 * r / kh**2) ** (1 / 3), np.pi * wh * r
        p[PHI0] = brentq(lambda f: maugis(f, p[LAM])[0], 1e-3, np.pi / 2, xtol=1e-15)
        fs = np.linspace(p[PHI0], np.pi / 2 - 1e-6, 4001)
        slope = np.array([maugis(f, p[LAM])[1] for f in fs])
        up = np.nonzero(slope > 0)[0]
        fold = (
            np.pi / 2 if len(up) == 0 else brentq(lambda f: maugis(f, p[LAM])[1], fs[up[0] - 1], fs[up[0]], xtol=1e-15)
        )
        p[XR], p[X0], p[DREL] = -fold, -p[PHI0], maugis(fold, p[LAM])[0] * p[SD]
        p[XS1], p[XS2] = math.sqrt(free), 1.0
    else:
        raise ValueError(law)
    return p, w, free


@njit(cache=True)
def maugis(f, lam):
    """D, dD, d2D, Fbar, dFbar by phi; m = c/a = 1/cos(phi); the equation for c is a quadratic."""
    s, c = np.sin(f), np.cos(f)
    s2, c2 = np.sin(2 * f), np.cos(2 * f)
    al, al1, al2 = 0.5 * lam * (0.5 * s2 - f * c2), lam * f * s2, lam * (s2 + 2 * f * c2)
    bk = 4.0 / 3.0 * lam * lam
    be, be1, be2 = bk * (f * s - 2 * np.sin(0.5 * f) ** 2), bk * f * c, bk * (c - f * s)
    if f < 0.05:
        al = 0.5 * lam * f**3 * (4.0 / 3.0 - 8.0 / 15.0 * f * f + 8.0 / 105.0 * f**4)
        be = bk * f * f * (0.5 - f * f / 8.0 + f**4 / 144.0)
    r = 2.0 / (be + np.sqrt(be * be + 4 * al))
    den = 2 * al * r + be
    r1 = -(al1 * r * r + be1 * r) / den
    r2 = -(al2 * r * r + 4 * al1 * r * r1 + be2 * r + 2 * be1 * r1 + 2 * al * r1 * r1) / den
    a, a1, a2 = r * c, r1 * c - r * s, r2 * c - 2 * r1 * s - r * c
    b, b1, b2 = r * s, r1 * s + r * c, r2 * s + 2 * r1 * c - r * s
    k = 4.0 / 3.0 * lam
    t = 0.5 * s2 + f
    fb = a**3 - lam * r * r * t
    fb1 = 3 * a * a * a1 - lam * (2 * r * r1 * t + r * r * (c2 + 1))
    return a * a - k * b, 2 * a * a1 - k * b1, 2 * (a1 * a1 + a * a2) - k * b2, fb, fb1


@njit(cache=True)
def maugis_phi(d, lam, phi0):
    """phi at D = d >= 0: Newton within a bracket."""
    lo, hi = 0.0, phi0 + 1e-9
    f = phi0 / (1.0 + d)
    for _ in range(100):
        m = maugis(f, lam)
        g = m[0] - d
        if g > 0:
            lo = f
        else:
            hi = f
        n = f - g / m[1]
        if not (lo < n < hi):
            n = 0.5 * (lo + hi)
        if abs(n - f) < 4e-16 * f:
            return n
        f = n
    return f


@njit(cache=True)
def law(mode, x, p):
    """d, D', D'', F, dF/dx, a_s, da_s/dx."""
    kind = int(p[LAW])
    if mode == 0:
        y = min(x, 0.5 * p[D0])
        g = 1.0 - y / p[D0]
        f = -p[FLR] / (g * g)
        f1 = -2.0 * p[FLR] / (g * g * g * p[D0])
        if p[BE] != 0.0:
            gap = p[D0] * g
            b = p[BE] * p[RT] ** 2 / (gap * (gap + p[RT]))
            f -= b
            f1 -= b * (2 * gap + p[RT]) / (gap * (gap + p[RT]))
        return x, 1.0, 0.0, f, f1, 0.0, 0.0
    if mode == 1:
        if kind == JKR:
            b, b0 = p[B0] + x * x, p[B0]
            g = b * (b * b + b * b0 + b0 * b0) / p[RT]
            g1 = (3 * b * b + 2 * b * b0 + b0 * b0) / p[RT]
            d, j = x * x * g, 2 * x * (g + x * x * g1)
            g2 = (6 * b + 2 * b0) / p[RT]
            jj = 2 * g + 10 * x * x * g1 + 4 * x**4 * g2
            b3 = b * b * b
            f = p[KH] * b3 * b3 / p[RT] - p[CJ] * b3 - p[BC]
            f1 = (6 * p[KH] * b3 * b * b / p[RT] - 3 * p[CJ] * b * b) * 2 * x
            h = np.sqrt(g / p[RT])
            return d, j, jj, f, f1, p[AL1] * x * h, p[AL1] * (h + x * g1 * x / (h * p[RT]))
        d, j, jj = x * x, 2 * x, 2.0
        if kind in (HERTZ, NECK):
            f, f1 = p[KS] * x * x * x - p[FA], 3 * p[KS] * x * x
        elif kind == SPRING:
            f, f1 = p[SP] * d - p[FA], p[SP] * j
        else:
            phi = maugis_phi(d / p[SD], p[LAM], p[PHI0])
            m = maugis(phi, p[LAM])
            f, f1 = p[SF] * m[3], p[SF] * m[4] / (m[1] * p[SD]) * j
        h = p[AL1] / np.sqrt(p[RT])
        return d, j, jj, f - p[BC], f1, h * x, h
    if kind == JKR:
        a = max(x, 0.1 * p[XR])
        r = np.sqrt(a)
        d, j, jj = a * a / p[RT] - p[KAP] * r, 2 * a / p[RT] - 0.5 * p[KAP] / r, 2 / p[RT] + 0.25 * p[KAP] / (r * a)
        return (
            d,
            j,
            jj,
            p[KH] * a**3 / p[RT] - p[CJ] * a * r - p[BC],
            3 * p[KH] * a * a / p[RT] - 1.5 * p[CJ] * r,
            0.0,
            0.0,
        )
    if kind == MAUGIS:
        m = maugis(-x, p[LAM])
        return p[SD] * m[0], -p[SD] * m[1], p[SD] * m[2], p[SF] * m[3] - p[BC], -p[SF] * m[4], 0.0, 0.0
    return x, 1.0, 0.0, -p[FA] - p[BC], 0.0, 0.0, 0.0


@njit(cache=True)
def rhs(kind, mode, y, p, z0, om, f):
    x, v = y[1], y[2]
    d, j, jx, fc, fx, al, ax = law(mode, x, p)
    c, s = np.cos(y[0]), np.sin(y[0])
    z = z0 + d
    damp = 2.0 * (p[AL0] + al)
    acc = p[U0] * c - damp * v - z - fc
    f[0], f[1], f[2] = j * om, v, j * acc
    if kind == DIAG:
        w = j * om / np.pi
        cn, sn = c, s
        for n in range(NH):
            f[3 + 2 * n], f[4 + 2 * n] = w * z * cn, w * z * sn
            cn, sn = cn * c - sn * s, sn * c + cn * s
        f[15], f[16], f[17] = 0.5 * w * z, 0.5 * w * fc, 0.5 * w * fc * z
        f[18], f[19], f[20] = j * v * v, 2 * j * al * v * v, j * fc * v
        f[21], f[22] = 0.5 * w * z * z, (0.5 * w if mode > 0 else 0.0)
        f[23] = damp * j
        return
    e = om / np.pi
    f[3], f[4] = e * j * z * c, e * j * z * s
    if kind == TANGENT:
        vx = jx * acc - j * (2 * ax * v + j + fx)
        zx = jx * z + j * j
        for m in range(NT):
            i = 5 + 5 * m
            t, q, u = y[i], y[i + 1], y[i + 2]
            f[i], f[i + 1] = jx * om * q, u
            f[i + 2] = -j * p[U0] * s * t + vx * q - j * damp * u
            f[i + 3] = e * (zx * c * q - j * z * s * t)
            f[i + 4] = e * (zx * s * q + j * z * c * t)
            if m == 2:
                f[i + 2] -= j
                f[i + 3] += e * j * c
                f[i + 4] += e * j * s
            elif m == 3:
                f[i] += j
                f[i + 3] += j * z * c / np.pi
                f[i + 4] += j * z * s / np.pi


@njit(cache=True, fastmath={"reassoc", "contract"})
def step(kind, n, mode, y, h, p, z0, om, k, yn, tol):
    """One step of length h from y to yn (k[:, 0] holds the slope at y); the error over the tolerance."""
    for i in range(1, 12):
        for a in range(n):
            t = 0.0
            for b in range(i):
                t += A8[i, b] * k[a, b]
            yn[a] = y[a] + h * t
        rhs(kind, mode, yn, p, z0, om, k[:, i])
    e3 = e5 = 0.0
    for a in range(n):
        t = 0.0
        for b in range(12):
            t += B8[b] * k[a, b]
        yn[a] = y[a] + h * t
    for a in (1, 2):
        u3 = u5 = 0.0
        for b in range(12):
            u3 += E3[b] * k[a, b]
            u5 += E5[b] * k[a, b]
        scale = tol * (p[SZ] if a == 2 or mode == 0 else (p[XS1] if mode == 1 else p[XS2]))
        e3 += (u3 / scale) ** 2
        e5 += (u5 / scale) ** 2
    if e3 == 0.0 and e5 == 0.0:
        return 0.0
    return abs(h) * e5 / np.sqrt((e5 + 0.01 * e3) * 2.0)


@njit(cache=True)
def locate(what, at, kind, n, mode, y, hi, p, z0, om, k, yn):
    """Step length in (0, hi] at which y[what] = at; yn holds the state there.  Newton inside a bracket."""
    lo, flo = 0.0, y[what] - at
    step(kind, n, mode, y, hi, p, z0, om, k, yn, 1.0)
    fhi = yn[what] - at
    up = fhi > 0.0
    h = hi * (flo / (flo - fhi)) if flo != fhi and (flo > 0.0) != up else 0.5 * hi
    top = hi
    g = np.empty(n)
    for _ in range(100):
        step(kind, n, mode, y, h, p, z0, om, k, yn, 1.0)
        f = yn[what] - at
        if (f > 0.0) == up:
            hi = h
        else:
            lo = h
        rhs(kind, mode, yn, p, z0, om, g)
        if abs(f) <= 2e-15 * top * abs(g[what]):
            break
        new = h - f / g[what] if g[what] != 0.0 else 0.5 * (lo + hi)
        if not (lo < new < hi):
            new = 0.5 * (lo + hi)
        if abs(new - h) <= 2e-16 * top or hi - lo <= 2e-16 * top:
            break
        h = new
    return h


@njit(cache=True)
def project(kind, y, what, f):
    """Derivatives at fixed independent variable -> derivatives on the event y[what] = const; f is the slope there."""
    if kind == TANGENT:
        for m in range(NT):
            i = 5 + 5 * m
            c = y[i + what] / f[what]
            for a in range(5):
                y[i + a] -= c * f[a]
            y[i + what] = 0.0


@njit(cache=True)
def x_of(mode, d, p):
    """The variable x at d in a mode."""
    kind = int(p[LAW])
    if mode == 0:
        return d
    if mode == 1 and kind != JKR:
        return np.sqrt(max(d, 0.0))
    if mode == 2 and kind == NECK:
        return d
    lo, hi = (0.0, 10.0 * p[XS1] + 10.0) if mode == 1 else (p[XR], p[X0])
    for _ in range(200):
        x = 0.5 * (lo + hi)
        if law(mode, x, p)[0] > d:
            hi = x
        else:
            lo = x
        if hi - lo < 1e-16 * abs(hi):
            break
    x = 0.5 * (lo + hi)
    for _ in range(3):
        m = law(mode, x, p)
        if m[1] > 1e-6:
            x -= (m[0] - d) / m[1]
    return x


@njit(cache=True)
def note(mode, x, seen):
    seen[mode, 0] = min(seen[mode, 0], x)
    seen[mode, 1] = max(seen[mode, 1], x)


@njit(cache=True)
def period(kind, mode, d, v, begin, p, z0, om, tol, y, seen):
    """One drive period from theta = begin.  y receives (theta, d, v, harmonic cos, sin, derivatives ...) and seen the ranges of x
    in each mode.  Returns the mode at the end, and how often contact was made; mode -1: failed."""
    n = 5 if kind == PLAIN else (5 + 5 * NT if kind == TANGENT else NDIAG)
    y[:] = 0.0
    x = x_of(mode, d, p)
    y[0], y[1], y[2] = begin, x, v
    if kind == TANGENT:
        y[5 + 1] = 1.0 / law(mode, x, p)[1]
        y[5 + 5 + 2] = 1.0
    end = begin + 2.0 * np.pi
    k = np.zeros((n, 12))
    yn, yt = np.empty(n), np.empty(n)
    neck = p[LAW] >= JKR
    h = 0.01
    touched = 0
    seen[:, 0], seen[:, 1] = np.inf, -np.inf
    note(mode, x, seen)
    rhs(kind, mode, y, p, z0, om, k[:, 0])
    for _ in range(200000):
        if mode == 0:
            h = min(h, 0.3)
        err = step(kind, n, mode, y, h, p, z0, om, k, yn, tol)
        if not np.isfinite(err) or err > 1.0:
            h *= max(0.2, 0.9 * err ** (-0.125)) if np.isfinite(err) else 0.1
            if h < 1e-14:
                return -1, touched
            continue
        grow = min(4.0, 0.9 * err ** (-0.125)) if err > 0.0 else 4.0
        # what ends the step: 0 nothing, 1 down across lower bound, 2 up across upper bound, 3 the period
        lower = p[XR] if mode == 2 else (0.0 if mode == 1 else -np.inf)
        upper = 0.0 if mode == 0 else (p[X0] if mode == 2 else np.inf)
        if law(mode, yn[1], p)[1] < 0.0 and mode != 1:  # beyond the fold: the end is certainly passed
            yn[1] = min(yn[1], lower - 1e-30)
        what, hh = 0, h
        if yn[1] < lower:
            what = 1
        elif yn[1] > upper:
            what = 2
        if y[2] * yn[2] < 0.0 and (what == 0 or kind == DIAG):
            ht = locate(2, 0.0, kind, n, mode, y, h, p, z0, om, k, yt)
            if what == 0 and yt[1] < lower:
                what, hh = 1, ht
            elif what == 0 and yt[1] > upper:
                what, hh = 2, ht
            elif lower <= yt[1] <= upper:
                note(mode, yt[1], seen)
        if what > 0:
            hh = locate(1, lower if what == 1 else upper, kind, n, mode, y, hh, p, z0, om, k, yn)
        if yn[0] > end:
            locate(0, end, kind, n, mode, y, hh, p, z0, om, k, yn)
            what = 3
        y[:] = yn
        if what == 0:
            note(mode, y[1], seen)
            h *= grow
            rhs(kind, mode, y, p, z0, om, k[:, 0])
            continue
        if what == 3:
            rhs(kind, mode, y, p, z0, om, k[:, 0])
            project(kind, y, 0, k[:, 0])
            note(mode, y[1], seen)
            m = law(mode, y[1], p)
            y[0], y[1] = end, m[0]
            if kind == TANGENT:
                for i in range(NT):
                    y[5 + 5 * i + 1] *= m[1]
            return mode, touched
        y[1] = lower if what == 1 else upper
        note(mode, y[1], seen)
        rhs(kind, mode, y, p, z0, om, k[:, 0])
        project(kind, y, 1, k[:, 0])
        v = abs(y[2]) + 1e-12 * p[SZ]
        if mode == 0:
            mode, touched = 1, touched + 1
            y[1] = 0.0
            h = 0.02 * p[XS1] / v * (p[XS1] if p[LAW] == JKR else 1.0)
        elif mode == 1:
            mode = 2 if neck else 0
            y[1] = p[X0] if neck else 0.0
            h = 0.01 * p[D0] / v if mode == 0 else 0.02 * (p[X0] - p[XR]) / v
        else:
            if what == 1:
                mode, y[1], h = 0, p[DREL], 0.02 * p[D0] / v
            else:
                mode, y[1], h = 1, 0.0, 0.02 * p[XS1] / v * (p[XS1] if p[LAW] == JKR else 1.0)
        h = max(h, 1e-8)
        note(mode, y[1], seen)
        rhs(kind, mode, y, p, z0, om, k[:, 0])
    return -1, touched


@njit(cache=True)
def march(mode, d, v, begin, p, z0, om, tol, periods, trail):
    """Let periods pass; trail receives d, v, cos, sin at the end of each.  Returns the last mode, d, v."""
    y, seen = np.empty(5), np.empty((3, 2))
    for i in range(periods):
        mode, _ = period(0, mode, d, v, begin, p, z0, om, tol, y, seen)
        if mode < 0:
            return mode, d, v
        d, v = y[1], y[2]
        trail[i, 0], trail[i, 1], trail[i, 2], trail[i, 3] = d, v, y[3], y[4]
    return mode, d, v
