"""Where to look for orbits of a given amplitude: first-order averaging with the loop, and states marched in time.  Starts only."""

import math

import numpy as np
from numba import njit
from truth_map import AL0, DREL, JKR, LAW, SZ, U0, law, march, x_of


@njit(cache=True)
def averages(p, om, a, depth, n):
    """First harmonic (cos, sin) and mean of F + 2 a_s z' along z = a cos(theta) with max d = depth."""
    gc = gs = gm = 0.0
    neck = p[LAW] >= JKR and depth > 0.0
    for i in range(n):
        s = (i + 0.5) / n  # theta = pi s^3, mirrored; weight 3 pi s^2 / n
        th, wt = math.pi * s**3, 3.0 * math.pi * s * s / n
        d = depth - 2.0 * a * math.sin(0.5 * th) ** 2
        for side in (-1, 1):
            mode = 1 if d >= 0.0 else (2 if neck and side > 0 and d > p[DREL] else 0)
            m = law(mode, x_of(mode, d, p), p)
            sn = side * math.sin(th)
            g = m[3] - 2.0 * m[5] * om * a * sn
            gc += wt * g * math.cos(th)
            gs += wt * g * sn
            gm += wt * m[3]
    return gc / math.pi, gs / math.pi, gm / (2.0 * math.pi)


@njit(cache=True)
def excess(p, om, a, depth, n):
    gc, gs, gm = averages(p, om, a, depth, n)
    x, y = a * (1.0 - om * om) + gc, 2.0 * p[AL0] * om * a - gs
    return x * x + y * y - p[U0] ** 2, math.atan2(y, x), gm


def averaged(p, om, a, deepest=None, n=1200):
    """[(tip offset, lag, mean deflection)] by averaging."""
    deep = deepest or 1.2 * a
    grid = np.concatenate([-np.geomspace(30 + a, 1e-3, 160), np.geomspace(1e-4, deep, 240)])
    vals = [excess(p, om, a, g, n)[0] for g in grid]
    out = []
    for lo, hi, f, g in zip(grid, grid[1:], vals, vals[1:]):
        if (f > 0) == (g > 0):
            continue
        if lo < 0 < hi:
            pass
        for _ in range(60):
            mid = 0.5 * (lo + hi)
            if (excess(p, om, a, mid, n)[0] > 0) == (f > 0):
                lo = mid
            else:
                hi = mid
        if abs(lo) < 1e-9:
            continue
        _, lag, mean = excess(p, om, a, lo, n)
        out.append((a - lo - mean, lag, -mean))
    return out


def settled(p, om, z0, state, begin, tol=1e-9, most=None):
    """March until the state repeats; returns (mode, d, v), H, periods, whether it repeats."""
    mode, d, v = state
    q = 0.5 / p[AL0]
    block = int(max(6, q / 4))
    most = most or int(40 * q + 300)
    trail, spent = np.empty((block, 4)), 0
    while spent < most:
        mode, d, v = march(mode, d, v, begin, p, z0, om, tol, block, trail)
        if mode < 0:
            raise ArithmeticError("integration failed")
        spent += block
        spread = np.ptp(trail[-6:], axis=0).max()
        if spread * max(1, q / math.pi) < 1e-6 * p[SZ]:
            return (mode, d, v), complex(trail[-1, 2], trail[-1, 3]), spent, True
    return (mode, d, v), complex(trail[-1, 2], trail[-1, 3]), spent, False


def free_state(p, om, z0, begin):
    h = p[U0] / complex(1 - om**2, 2 * p[AL0] * om)  # z = Re(h e^{i theta})
    e = complex(math.cos(begin), math.sin(begin))
    return 0, (h * e).real - z0, (1j * om * h * e).real


def swept(p, om, a, far, near, steps, begin=-0.5 * math.pi, tol=1e-8):
    """States on either side of amplitude a, in time, down and up: [(mode, d, v, tip offset)]."""
    out, path = [], list(np.linspace(far, near, steps))
    state, last = free_state(p, om, far, begin), None
    previous = far
    for z0 in path + path[::-1]:
        state = (state[0], state[1] + previous - z0, state[2])
        if state[0] == 0 and state[1] > 0:
            state = (1, *state[1:])
        elif state[0] > 0 and state[1] <= p[DREL]:
            state = (0, *state[1:])
        elif state[0] > 0:
            state = (1 if state[1] >= 0 else 2, *state[1:])
        previous = z0
        try:
            state, h, n, ok = settled(p, om, z0, state, begin, tol)
        except ArithmeticError:
            break
        if last is not None and ok and (abs(h) > a) != (last > a):
            out.append((*state, z0))
        last = abs(h) if ok else None
    return out
