"""Makes tests/data/irregular.json: what a slow engagement in time holds where a tip sticks to a soft sample.

    python tests/reference/make_irregular.py named|random|near

Nothing here is shared with phasemap or with the other references but the equation of motion and the contact laws.

Method.  z = (steady free oscillation) + e^(-alpha0 tau) (a cos(nu tau) + b sin(nu tau)): the free lever is exact, and a
and b change by the surface's forces only.  8th-order Dormand-Prince with step control.  Three regions, joined at events
that are roots of the step size: out of contact (independent variable tau); contact, d = q^2 >= 0 (d tau = 2 q d sigma,
so that the powers of d and the square root in the damping are smooth; s, the square root of the contact radius, is
carried along by its own equation); neck, d_c < d < 0 (s - s_c is the coordinate, d tau = d'(s) d sigma, so that the
square root at release is smooth).  Contacts shorter than a step are found at the extrema of z.  The first harmonic of
each drive period follows from the forces' integrals.

Engagement.  The free lever, far away, comes down by `RAMP` A0 per ring-down time (Q/pi periods), from the start in
small steps each period (4 and 16 times as fast while more than 99.5 and 99.99 % of the amplitude are left).  Where the
mean phasor over `BLOCK` ring-down times first falls to a setpoint the state is kept, and the descent goes on for the
lower setpoints.  From each kept state a slow integral feedback (time constant 20 ring-down times, on the phasor behind
a low-pass of one ring-down time) holds the amplitude; then the tip offset stays constant while the motion settles.
* Periodic (state repeats after n <= 64 periods): Newton on (a, b, z0) for the n-period map and |mean phasor| =
  setpoint; it counts only if the Floquet multipliers lie inside the unit circle and the orbit is the one that time
  settled on.
* Otherwise the tip offset is constant for longer and longer runs, corrected by the mean amplitude after each, until
  standard errors (the largest from blocks of 4, 8, ... ring-down times, at least 16 of them) are 2 pm and 0.01 degree
  or `MOST` periods are spent.
* "held": false where feedback does not come to rest, or the motion at a constant tip offset leaves for another
  amplitude, in each of five attempts: the amplitude jumps across the setpoint, down on approach and up on retraction.

Fields of each setpoint: tip_offset [m], phase [degree] = 90 - lag of the mean phasor, mean_deflection [m],
amplitude_spread [m] and phase_spread [degree] (standard deviation behind exp(-2 pi/100) per period), indentation [m]
(largest), dissipation [J] into the surface per cycle, contact_share (share of periods with contact), period (drive
periods; 0: not periodic), tip_offset_error, phase_error (standard errors; 0 where periodic, good to 1e-7 degree and
1e-16 m), met (tip offset at which the descent first met the setpoint).  near: tip offset, phase and period of what
feedback holds from two other states near by: where windows of different periods lie side by side, the answer is defined
only to that.  stretches: tip offsets [from, to] where the approach was not of period one. Seven of the sixty polymers
that were drawn are left out of the file: their neck would break within reach of the long-range force, so that a loop
would create energy, and phasemap refuses them.
"""

import json
import math
import pathlib
import sys
import time

import numpy as np
from numba import njit
from scipy.integrate._ivp import dop853_coefficients as _c

OUT = pathlib.Path(__file__).parent.parent / "data" / "irregular.json"
RAMP, BLOCK, MOST = 4.8e-4, 10, 250_000
SETPOINTS = (0.9, 0.75, 0.6)
A8, B8, E3, E5 = (np.ascontiguousarray(m) for m in (_c.A[:12, :12], _c.B, _c.E3[:12], _c.E5[:12]))

# parameters (nm): free amplitude, Q, omega, F0/k, decay length (0: none), contact stiffness, s_c, R, damping, jkr?,
# alpha0, nu
AF, QQ, OM, F0, D0, KK, SC, RR, AL, JK, A0, NU, ZC, ZS = range(14)
N = 9  # a, b, coordinate (q or s - s_c), tau, Ic, Is, I0, work, s
OUTSIDE, CONTACT, NECK = 0, 1, 2
S0 = 4.0 ** (1.0 / 3.0)  # s at d = 0 in units of s_c


@njit(cache=True)
def motion(a, b, tau, p):
    e = math.exp(-p[A0] * tau)
    cn, sn = math.cos(p[NU] * tau), math.sin(p[NU] * tau)
    c, s = math.cos(p[OM] * tau), math.sin(p[OM] * tau)
    y = e * (a * cn + b * sn)
    z = p[ZC] * c + p[ZS] * s + y
    v = p[OM] * (p[ZS] * c - p[ZC] * s) + e * p[NU] * (b * cn - a * sn) - p[A0] * y
    return z, v, c, s, cn / e, sn / e


@njit(cache=True)
def rhs(region, y, z0, p, f):
    z, v, c, s, cn, sn = motion(y[0], y[1], y[3], p)
    f[2] = v
    f[8] = 0.0
    if region == OUTSIDE:
        j, f[2] = 1.0, 0.0
        g = 0.0
        if p[D0] > 0.0:
            r = 1.0 - min(z - z0, 0.5 * p[D0]) / p[D0]
            g = -p[F0] / (r * r)
    elif region == CONTACT:
        q = y[2]
        j = 2.0 * q
        if p[JK] > 0.0:
            r, sc3 = y[8] ** 3, p[SC] ** 3
            g = p[KK] / p[RR] * r * (r - 6.0 * sc3)
            f[8] = v * j * p[RR] / (4.0 * (r - sc3))
        else:
            g = p[KK] * math.sqrt(p[RR]) * q**3 - p[F0]
        g += 2.0 * p[AL] / math.sqrt(p[RR]) * q * v
    else:
        t = y[2]
        r, sc3 = (p[SC] + t) ** 3, p[SC] ** 3
        j = 4.0 * t * (t * t + 3.0 * p[SC] * t + 3.0 * p[SC] ** 2) / p[RR]
        g = p[KK] / p[RR] * r * (r - 6.0 * sc3)
    g *= j
    f[0] = g * sn / p[NU]
    f[1] = -g * cn / p[NU]
    f[3] = j
    f[4] = g * c
    f[5] = g * s
    f[6] = g
    f[7] = g * v


@njit(cache=True)
def step(region, y, h, z0, p, k, yn, tol):
    """One step of size h from y to yn, k[0] known; returns the error in units of the tolerance."""
    if region == OUTSIDE and p[D0] == 0.0:
        yn[:] = y
        yn[3] += h
        return 0.0
    for i in range(1, 12):
        yn[:] = y
        for m in range(i):
            w = h * A8[i, m]
            if w != 0.0:
                for n in range(N):
                    yn[n] += w * k[m, n]
        rhs(region, yn, z0, p, k[i])
    yn[:] = y
    for m in range(12):
        w = h * B8[m]
        if w != 0.0:
            for n in range(N):
                yn[n] += w * k[m, n]
    e3 = e5 = 0.0
    for n in range(4):
        u3 = u5 = 0.0
        for m in range(12):
            u3 += E3[m] * k[m, n]
            u5 += E5[m] * k[m, n]
        scale = tol * (p[AF] if n < 2 else 1.0)
        e3 += (u3 / scale) ** 2
        e5 += (u5 / scale) ** 2
    if e3 == 0.0 and e5 == 0.0:
        return 0.0
    return abs(h) * e5 / math.sqrt((e5 + 0.01 * e3) * 4.0)


TAU, EDGE, TOP, SPEED = 0, 1, 2, 3


@njit(cache=True)
def value(what, region, y, z0, p, end):
    """Positive beyond the event."""
    if what == TAU:
        return y[3] - end
    if what == TOP:  # the neck grows into contact
        return y[2] - (S0 - 1.0) * p[SC]
    if what == EDGE and region != OUTSIDE:
        return -y[2]
    z, v, _, _, _, _ = motion(y[0], y[1], y[3], p)
    return v if what == SPEED else z - z0


@njit(cache=True)
def root(what, region, y, lo, hi, flo, fhi, z0, p, end, k, yn, tol):
    """Step size in (lo, hi) at which the event happens (Newton with the velocity, or Illinois); yn holds the state there."""
    x, side = -1.0, 0
    if what in (EDGE, TOP):  # Newton's start: the coordinate's rate is the velocity
        x = lo + (hi - lo) * flo / (flo - fhi)
    for _ in range(80):
        if not lo < x < hi:
            x = (lo * fhi - hi * flo) / (fhi - flo)
            if not lo < x < hi:
                x = 0.5 * (lo + hi)
        step(region, y, x, z0, p, k, yn, tol)
        f = value(what, region, yn, z0, p, end)
        if abs(f) < 1e-14 or hi - lo < 1e-15 * hi:
            break
        if (f > 0.0) == (fhi > 0.0):
            hi, fhi = x, f
            if side == 1:
                flo *= 0.5
            side = 1
        else:
            lo, flo = x, f
            if side == -1:
                fhi *= 0.5
            side = -1
        if what in (EDGE, TOP):
            v = motion(yn[0], yn[1], yn[3], p)[1]
            change = f / v if what == TOP or region == OUTSIDE else -f / v
            if abs(change) < 1e-15 * hi:
                break
            x -= change
        else:
            x = -1.0
    return x


@njit(cache=True)
def place(d, p):
    """s on the stable branch at depth d >= d_c, by Newton from above."""
    s = p[SC] * 2.0 + math.sqrt(math.sqrt(max(p[RR] * d, 0.0)))
    for _ in range(60):
        ds = (s**4 - 4.0 * p[SC] ** 3 * s - p[RR] * d) / (4.0 * (s**3 - p[SC] ** 3))
        s -= ds
        if abs(ds) < 1e-15 * s:
            break
    return max(s, p[SC])


@njit(cache=True)
def seat(y, region, z0, p):
    """Region and coordinates after the tip offset has changed."""
    d = motion(y[0], y[1], y[3], p)[0] - z0
    least = -3.0 * p[SC] ** 4 / p[RR] if p[JK] > 0.0 else 0.0
    if region != OUTSIDE and d < least:
        region = OUTSIDE
    elif region == OUTSIDE and d >= 0.0:
        region = CONTACT
    if region != OUTSIDE:
        region = CONTACT if d >= 0.0 else NECK
        if p[JK] > 0.0:
            y[8] = place(d, p)
        y[2] = math.sqrt(d) if region == CONTACT else y[8] - p[SC]
    return region


@njit(cache=True)
def period(y, region, z0, p, hs, tol, peak, k, yn, ym):
    """One drive period; y[3] runs from 0 to the end.  Returns region, whether there was contact, largest indentation."""
    end = 2.0 * math.pi / p[OM]
    touched = region == CONTACT
    deepest = -1e300
    for _ in range(100000):
        left = end - y[3]
        if left < 1e-13:
            break
        rhs(region, y, z0, p, k[0])
        most = 0.8 if region == OUTSIDE else 1e3
        h = min(hs[region], most)
        if region == OUTSIDE and h > left:
            h = left
        clipped = h < hs[region]
        while True:
            e = step(region, y, h, z0, p, k, yn, tol)
            if e <= 1.0:
                break
            h *= max(0.2, 0.9 * e ** (-0.125))
            clipped = False
            if h < 1e-13:
                break
        if not clipped or region == OUTSIDE and p[D0] == 0.0:
            hs[region] = min(max(h * min(5.0, 0.9 * e ** (-0.125) if e > 0.0 else 5.0), 1e-9), 1e3)
        v0, v1 = 0.0, 0.0
        z, v0, _, _, _, _ = motion(y[0], y[1], y[3], p)
        d0 = z - z0
        z, v1, _, _, _, _ = motion(yn[0], yn[1], yn[3], p)
        d1 = z - z0
        # the event that comes first: at most two are tested, in order of the coordinate's motion
        what = -1
        lo, hi = 0.0, h
        edge0 = value(EDGE, region, y, z0, p, end)
        edge1 = value(EDGE, region, yn, z0, p, end)
        if edge1 > 0.0:
            what = EDGE
        elif region == NECK and value(TOP, region, yn, z0, p, end) > 0.0:
            what = TOP
        elif v0 * v1 < 0.0:
            toward = v0 > 0.0
            near = (region == OUTSIDE and toward and max(d0, d1) > -0.5 * h * (v0 - v1) - 0.02 * p[AF]) or (
                region != OUTSIDE and (not toward or region == NECK)
            )
            if near or (peak and toward):
                # extremum of d inside the step
                x = root(SPEED, region, y, 0.0, h, v0, v1, z0, p, end, k, ym, tol)
                d = motion(ym[0], ym[1], ym[3], p)[0] - z0
                if region == OUTSIDE:
                    deepest = max(deepest, d)
                elif region == CONTACT:
                    deepest = max(deepest, ym[2] ** 2)
                if value(EDGE, region, ym, z0, p, end) > 0.0:
                    what, hi, edge1 = EDGE, x, value(EDGE, region, ym, z0, p, end)
                elif region == NECK and value(TOP, region, ym, z0, p, end) > 0.0:
                    what, hi = TOP, x
        if what == EDGE:
            h = root(EDGE, region, y, lo, hi, min(edge0, -1e-15), edge1, z0, p, end, k, yn, tol)
        elif what == TOP:
            step(region, y, hi, z0, p, k, yn, tol)
            f1 = value(TOP, region, yn, z0, p, end)
            f0 = min(value(TOP, region, y, z0, p, end), -1e-15)
            h = root(TOP, region, y, lo, hi, f0, f1, z0, p, end, k, yn, tol)
        if region != OUTSIDE and yn[3] > end:
            h = root(TAU, region, y, 0.0, h, y[3] - end, yn[3] - end, z0, p, end, k, yn, tol)
            what = TAU
        y[:] = yn
        if what == TAU:
            y[3] = end
            break
        if what == EDGE:
            if region == OUTSIDE:
                region, touched = CONTACT, True
                y[2], y[8] = 0.0, S0 * p[SC]
            elif region == CONTACT and p[JK] > 0.0:
                region = NECK
                y[2] = (S0 - 1.0) * p[SC]
            else:
                region = OUTSIDE
                y[2] = 0.0
        elif what == TOP:
            region, touched = CONTACT, True
            y[2], y[8] = 0.0, S0 * p[SC]
    return region, touched, deepest


@njit(cache=True)
def run(state, p, hs, n, ramp, gain, goal, tol, peak, rec):
    """n drive periods from `state` (a, b, region, z0, coordinate, s, low-passed phasor); both are changed.

    rec: phasor (2), mean, work, contact, largest indentation, z0, a, b of each period.
    """
    k = np.empty((12, N))
    y, yn, ym = np.zeros(N), np.zeros(N), np.zeros(N)
    al, om = p[A0], p[OM]
    end = 2.0 * math.pi / om
    cn, sn, e = math.cos(p[NU] * end), math.sin(p[NU] * end), math.exp(-al * end)
    forget = math.pi / p[QQ]
    for i in range(n):
        a, b = state[0], state[1]
        region, z0 = int(state[2]), state[3]
        y[:] = 0.0
        y[0], y[1], y[2], y[8] = a, b, state[4], state[5]
        region, touched, deepest = period(y, region, z0, p, hs, tol, peak, k, yn, ym)
        a1, b1 = e * (y[0] * cn + y[1] * sn), e * (y[1] * cn - y[0] * sn)
        jump = a1 - a
        jumpv = p[NU] * (b1 - b) - al * jump
        # first harmonic and mean of the change of z from the integrals of the forces
        top = complex(-y[4] - jumpv - 2.0 * al * jump, -y[5] + om * jump)
        first = top / complex(1.0 - om * om, -2.0 * al * om) * om / math.pi
        re, im = p[ZC] + first.real, p[ZS] + first.imag
        rec[i, 0], rec[i, 1] = re, im
        rec[i, 2] = (-y[6] - jumpv - 2.0 * al * jump) / end
        rec[i, 3] = y[7]
        rec[i, 4] = 1.0 if touched else 0.0
        rec[i, 5] = deepest
        rec[i, 6] = z0
        rec[i, 7], rec[i, 8] = a1, b1
        state[6] += forget * (re - state[6])
        state[7] += forget * (im - state[7])
        y[0], y[1], y[3] = a1, b1, 0.0
        change = ramp
        if gain > 0.0:
            miss = math.sqrt(state[6] ** 2 + state[7] ** 2) - goal
            change -= gain * max(-0.05 * p[AF], min(miss, 0.05 * p[AF]))
        if change != 0.0:
            z0 += change
            region = seat(y, region, z0, p)
        state[0], state[1], state[2], state[3], state[4], state[5] = a1, b1, region, z0, y[2], y[8]


def parameters(c):
    """The vector p (nm) of a case (SI)."""
    al = 0.5 / c["quality_factor"]
    om = c.get("frequency_ratio", 1.0)
    contact = 4.0 / 3.0 * c["modulus"] / (1.0 - c.get("poisson_ratio", 0.35) ** 2)
    radius, k, w = c["tip_radius"] * 1e9, c["stiffness"], c["adhesion"]
    u0 = c["free_amplitude"] * 1e9 / c["quality_factor"]
    free = u0 / complex(1.0 - om * om, -2.0 * al * om)
    p = np.zeros(14)
    p[AF], p[QQ], p[OM] = abs(free), c["quality_factor"], om
    p[F0], p[D0] = 2 * math.pi * w * radius / k, (c["decay_length"] or 0.0) * 1e9
    p[KK], p[RR], p[AL] = contact * 1e-9 / k, radius, c["damping"]
    p[JK] = 1.0 if c["contact"] == "jkr" else 0.0
    p[SC] = (math.pi * w / contact * 1e9 * radius**2 / 6.0) ** (1 / 6) if c["contact"] == "jkr" else 0.0
    p[A0], p[NU] = al, math.sqrt(1.0 - al * al)
    p[ZC], p[ZS] = free.real, free.imag
    return p


class Tip:
    """A tip that moves: parameters, state, step sizes, number of periods so far."""

    def __init__(self, case):
        self.p = parameters(case)
        self.state = np.zeros(8)
        self.state[6:] = self.p[ZC], self.p[ZS]
        self.hs = np.array([0.1, 0.01, 0.01])
        self.periods = 0
        self.ring = case["quality_factor"] / math.pi

    def go(self, n, ramp=0.0, gain=0.0, goal=0.0, tol=1e-9, peak=False):
        n = int(n)
        rec = np.empty((n, 9))
        run(self.state, self.p, self.hs, n, ramp, gain, goal, tol, peak, rec)
        self.periods += n
        return rec

    def at(self, state):
        self.state[:] = state
        return self


def phasor(rec):
    return complex(rec[:, 0].mean(), rec[:, 1].mean())


def error_of_mean(x, least):
    """Standard error of the mean of x: blocks of `least` and more periods, the largest of the levels with 16 blocks or more."""
    worst, size = math.nan, int(least)
    while len(x) // size >= 16:
        n = len(x) // size
        m = x[: n * size].reshape(n, size).mean(axis=1)
        worst = np.fmax(worst, m.std(ddof=1) / math.sqrt(n))
        size *= 2
    return worst


def spread(rec):
    """Standard deviations of amplitude and phase behind the lock-in's low-pass."""
    r = math.exp(-2 * math.pi / 100)
    from scipy.signal import lfilter

    z = rec[:, 0] + 1j * rec[:, 1]
    low = lfilter([1 - r], [1, -r], z, zi=[r * z.mean()])[0][min(500, len(z) // 4) :]
    return np.abs(low).std(), np.degrees(np.angle(low / z.mean())).std()


def descend(case, setpoints):
    """Lowers the tip from far; returns what was met at each setpoint and the stretches that were not of period one."""
    tip = Tip(case)
    af = tip.p[AF]
    tip.state[3] = 1.02 * af + 2.0 + 20.0 * tip.p[D0] + tip.p[F0] * (tip.p[D0] > 0.0) / 441.0
    n = max(int(BLOCK * tip.ring), 40)
    tip.go(n)
    met, odd, trail = {}, [], []
    amplitude = af
    while len(met) < len(setpoints) and tip.state[3] > -0.2 * af:
        rate = RAMP * af / tip.ring * (16.0 if amplitude > 0.9999 * af else 4.0 if amplitude > 0.995 * af else 1.0)
        top = tip.state[3]
        rec = tip.go(n, ramp=-rate)
        amplitude = abs(phasor(rec))
        z = rec[:, 0] + 1j * rec[:, 1]
        rough = np.sqrt(np.mean(np.abs(np.diff(z, 2)) ** 2)) * tip.p[QQ] / af
        share = rec[:, 4].mean()
        trail.append((tip.state[3], amplitude, rough, share))
        if rough > 0.02:
            odd.append((top, tip.state[3]))
        for s in setpoints:
            if s not in met and amplitude <= s * af:
                met[s] = tip.state.copy()
    stretches = []
    for a, b in odd:
        if stretches and abs(stretches[-1][1] - a) < 1e-9:
            stretches[-1][1] = b
        else:
            stretches.append([a, b])
    return met, [x for x in stretches if x[0] - x[1] > 1.5 * n * RAMP * af / tip.ring], trail, tip.periods


def newton(tip, state, n, goal, tol=1e-13):
    """Orbit of n drive periods that holds the goal, near a state; (state, multipliers, rec) or None."""

    def started(x):
        tip.at(state)
        tip.state[0], tip.state[1], tip.state[3] = x
        tip.state[2] = seat_now(tip)
        return tip.state.copy()

    def cycle(x):
        rec = tip.at(started(x)).go(n, tol=tol)
        if (tip.state[2] == OUTSIDE) != (state[2] == OUTSIDE):
            raise ArithmeticError
        return np.array([tip.state[0] - x[0], tip.state[1] - x[1], abs(phasor(rec)) - goal])

    x = np.array([state[0], state[1], state[3]])
    start = x.copy()
    try:
        r = cycle(x)
        for _ in range(25):
            jac = np.empty((3, 3))
            for i in range(3):
                dx = np.zeros(3)
                dx[i] = 2e-6 * tip.p[AF]
                jac[:, i] = (cycle(x + dx) - cycle(x - dx)) / (2 * dx[i])
            change = np.linalg.solve(jac, -r)
            if not np.all(np.isfinite(change)) or np.abs(x + change - start).max() > 0.1 * tip.p[AF]:
                return None
            x = x + change
            r = cycle(x)
            if np.abs(change).max() < 1e-9 * tip.p[AF]:
                break
        else:
            return None
    except (ArithmeticError, np.linalg.LinAlgError):
        return None
    multipliers = np.linalg.eigvals(jac[:2, :2] + np.eye(2))
    return started(x), multipliers


def repeats(rec, af):
    """Candidates n for the period, best first."""
    x = rec[-400:, 7] + 1j * rec[-400:, 8]
    found = []
    for n in range(1, 65):
        d = np.sqrt(np.mean(np.abs(x[n:] - x[:-n]) ** 2)) / af
        if d < 2e-3 and not any(n % m == 0 and d > 0.3 * e for m, e in found):
            found.append((n, d))
    return [n for n, _ in found][:4]


def record(tip, rec, goal, z0, phase, period_, errors):
    """What is written, SI; forces times lengths in nm^2 k become J."""
    k = tip.k
    z = phasor(rec)
    da, dp = spread(rec) if period_ != 1 else (0.0, 0.0)
    return dict(
        held=True,
        tip_offset=z0 * 1e-9,
        phase=phase,
        amplitude=abs(z) * 1e-9,
        mean_deflection=rec[:, 2].mean() * 1e-9,
        amplitude_spread=da * 1e-9,
        phase_spread=dp,
        indentation=rec[:, 5].max() * 1e-9,
        dissipation=rec[:, 3].mean() * k * 1e-18,
        contact_share=rec[:, 4].mean(),
        period=period_,
        tip_offset_error=errors[0] * 1e-9,
        phase_error=errors[1],
    )


def hold(tip, state, goal, most=None):
    """Holds the amplitude from a state that first met it."""
    most = most or MOST
    af, ring = tip.p[AF], tip.ring
    start = tip.periods
    tip.at(state)
    notes = []
    long = 20 * ring
    for attempt in range(5):
        tip.go(60 * ring, gain=1.0 / long, goal=goal)
        rec = tip.go(160 * ring, gain=1.0 / long, goal=goal)
        blocks = np.array_split(rec, 10)
        amps = np.array([abs(phasor(b)) for b in blocks])
        offs = np.array([b[:, 6].mean() for b in blocks])
        if np.abs(amps - goal).max() > 0.05 * goal or np.ptp(offs) > 0.1 * af:
            notes.append(
                f"feedback {attempt}: amplitude/goal {amps.min() / goal:.4f}..{amps.max() / goal:.4f}, "
                f"z0 {offs.min():.4f}..{offs.max():.4f} nm"
            )
            continue
        z0 = offs[5:].mean()
        tip.state[3] = z0
        tip.state[2] = seat_now(tip)
        # motion at a constant tip offset
        rec = tip.go(max(60 * ring, 400))
        kept = tip.state.copy()
        for n in repeats(rec, af):
            found = newton(tip, kept, n, goal)
            if found is None:
                continue
            state2, multipliers = found
            if np.abs(multipliers).max() >= 1.0:
                notes.append(f"period {n} unstable: multipliers {np.abs(multipliers).max():.4f}")
                continue
            rec1 = tip.at(state2).go(n, tol=1e-12, peak=True)
            rec2 = tip.at(kept).go(
                100 * ring
            )  # does the state in time stay at that orbit's amplitude (slope 1 at most)?
            away = abs(phasor(rec2[-n * max(1, int(ring) // n) :]) - phasor(rec1))
            if away > 3 * abs(state2[3] - z0) + 0.003 * af:
                notes.append(f"period {n}: motion in time is {away / af:.2e} A0 away")
                continue
            z = phasor(rec1)
            many = np.tile(rec1, (max(1, 3000 // n), 1))
            out = record(tip, many, goal, state2[3], 90 - np.degrees(np.angle(z)), n, (0.0, 0.0))
            out["multiplier"] = float(np.abs(multipliers).max())
            return out, notes, tip.periods - start
        out = dwell(tip, kept, goal, most, notes)
        if out is not None:
            return out, notes, tip.periods - start
        if tip.periods - start > 4 * most:
            break
    return dict(held=False), notes, tip.periods - start


def seat_now(tip):
    y = np.zeros(N)
    y[0], y[1], y[2], y[8] = tip.state[0], tip.state[1], tip.state[4], tip.state[5]
    region = seat(y, int(tip.state[2]), tip.state[3], tip.p)
    tip.state[4], tip.state[5] = y[2], y[8]
    return region


def dwell(tip, state, goal, most, notes):
    """Mean of irregular motion at constant tip offsets; None where it leaves."""
    ring = tip.ring
    tip.at(state)
    spent, n = 0, int(160 * ring)
    past = []  # z0, amplitude, phase, weight
    slope, turn = 1.0, 0.0
    while True:
        tip.go(20 * ring)
        z0 = tip.state[3]
        rec = tip.go(n, peak=True)
        spent += n
        block = int(40 * ring)
        amps = np.array([abs(phasor(b)) for b in np.array_split(rec, max(4, n // block))])
        if np.abs(amps - goal).max() > 0.15 * goal or (abs(amps[-2:].mean() - goal) > 0.08 * goal):
            notes.append(f"left at {z0:.4f} nm: amplitude/goal {amps.min() / goal:.4f}..{amps.max() / goal:.4f}")
            return None
        z = phasor(rec)
        u = (rec[:, 0] + 1j * rec[:, 1]) / z
        ea, ep = error_of_mean(u.real, 4 * ring) * abs(z), np.degrees(error_of_mean(u.imag, 4 * ring))
        phase = 90 - np.degrees(np.angle(z))
        past.append((z0, abs(z), phase, n))
        if len(past) > 2:
            w = np.sqrt([x[3] for x in past[1:]])
            x, a, f = (np.array([q[i] for q in past[1:]]) for i in range(3))
            if np.ptp(x) > 5 * ea:
                slope = min(max(np.polyfit(x, a, 1, w=w)[0], 0.3), 3.0)
                turn = np.polyfit(x, f, 1, w=w)[0]
        miss = abs(z) - goal
        good = abs(miss) / slope < max(3 * ea, 0.002)
        done = (good and ea / slope < 0.002 and ep < 0.01) or spent > most
        if done:
            z1 = z0 - miss / slope
            turn = turn if abs(turn) < 60.0 else 0.0
            return record(tip, rec, goal, z1, phase - turn * miss / slope, 0, (ea / slope, ep)) | dict(
                periods_of_mean=n, moved=-miss / slope * 1e-9
            )
        tip.state[3] = z0 - miss / slope
        tip.state[2] = seat_now(tip)
        if good:
            n = int(min(n * min(max(1.2 * max(ea / slope / 0.002, ep / 0.01) ** 2, 1.5), 6.0), max(most - spent, n)))


def engage(case, setpoints):
    tip = Tip(case)
    tip.k = case["stiffness"]
    met, stretches, trail, periods = descend(case, setpoints)
    held = []
    for s in setpoints:
        if s not in met:
            held.append(dict(setpoint=s, held=False, notes=["never met on approach"]))
            continue
        out, notes, n = hold(tip, met[s].copy(), s * tip.p[AF])
        periods += n
        held.append(dict(setpoint=s, met=met[s][3] * 1e-9, notes=notes) | out)
    return dict(stretches=[[a * 1e-9, b * 1e-9] for a, b in stretches], periods=periods, setpoints=held), trail


def case(name, k, f0, q, r, a, e, w, al, decay, contact="jkr"):
    return dict(
        name=name, contact=contact, stiffness=k, resonance_frequency=f0, quality_factor=q, tip_radius=r, free_amplitude=a,
        modulus=e, poisson_ratio=0.35, adhesion=w, damping=al, damping_exponent=0.5, decay_length=decay,
    )  # fmt: skip


NAMED = [
    (case("rubber", 3.0, 3e5, 200.0, 10e-9, 40e-9, 30e6, 0.05, 0.01, 0.3e-9), (0.9, 0.75, 0.6)),
    (case("glass beside it", 3.0, 3e5, 200.0, 10e-9, 40e-9, 3e9, 0.05, 0.01, 0.3e-9), (0.9, 0.75, 0.6)),
    (case("no long-range force", 3.0, 3e5, 200.0, 10e-9, 40e-9, 200e6, 0.06, 0.02, None), (0.9, 0.75, 0.6)),
    (
        case("stiff lever, small amplitude", 40.0, 3e5, 400.0, 10e-9, 15e-9, 30e6, 0.05, 0.01, 0.3e-9),
        (0.95, 0.9, 0.8, 0.7),
    ),
    (case("PDMS", 40.0, 3e5, 400.0, 10e-9, 40e-9, 2.5e6, 0.05, 0.01, 0.3e-9), (0.9, 0.75, 0.6)),
]


def drawn():
    """Five DMT cases that stick without a long-range force, and 60 polymers under ordinary levers."""
    rng = np.random.default_rng(14)

    def between(low, high):
        return float(f"{math.exp(rng.uniform(math.log(low), math.log(high))):.3g}")

    cases = []
    for i in range(65):
        dmt = i < 5
        decay = None if dmt or rng.random() < 0.3 else between(0.2e-9, 5e-9)
        cases.append((case(
            f"DMT {i}" if dmt else f"polymer {i - 5}", between(1.0, 50.0), between(70e3, 350e3), between(100.0, 600.0),
            between(5e-9, 25e-9), between(10e-9, 60e-9), between(20e6, 1e9), between(0.06 if dmt else 0.02, 0.1),
            between(0.002, 0.05), decay, "dmt" if dmt else "jkr",
        ), SETPOINTS))  # fmt: skip
    return cases


def main(what):
    data = json.loads(OUT.read_text()) if OUT.exists() else []
    todo = NAMED if what == "named" else drawn()
    for c, setpoints in todo:
        if any(d["name"] == c["name"] for d in data):
            continue
        start = time.time()
        found, _ = engage(c, setpoints)
        data.append(c | found)
        OUT.write_text(json.dumps(data, indent=1))
        print(c["name"], f"{time.time() - start:.1f} s, {found['periods']} periods", flush=True)
        for s in found["setpoints"]:
            if s["held"]:
                print(
                    f"   {s['setpoint']}: {s['phase']:.4f} +- {s['phase_error']:.4f} at {s['tip_offset'] * 1e9:.5f} +- "
                    f"{s['tip_offset_error'] * 1e9:.5f} nm, period {s['period']}, spread {s['amplitude_spread'] * 1e9:.4f} nm "
                    f"{s['phase_spread']:.3f} deg, contact {s['contact_share']:.2f}",
                    flush=True,
                )
            else:
                print(f"   {s['setpoint']}: not held", s["notes"], flush=True)


def near(c, s, draws=2):
    """[tip offset, phase, period] of what is held from other states near the one that engagement met."""
    tip = Tip(c)
    tip.k, rng, found = c["stiffness"], np.random.default_rng(3), []
    for _ in range(draws):
        size = s["amplitude"] * 1e9 * (1.0 + rng.uniform(-0.01, 0.01))
        lag = math.radians(90.0 - s["phase"] + rng.uniform(-2.0, 2.0))
        y, v = size * math.cos(lag) - tip.p[ZC], size * math.sin(lag) - tip.p[OM] * tip.p[ZS]
        z0 = s["tip_offset"] * 1e9 + 0.02 * tip.p[AF]
        low = math.cos(lag) * size, math.sin(lag) * size
        tip.at([y, (v + tip.p[A0] * y) / tip.p[NU], OUTSIDE, z0, 0.0, 0.0, *low])
        out, _, _ = hold(tip, tip.state.copy(), s["amplitude"] * 1e9, most=60_000)
        if out["held"]:
            found.append([out["tip_offset"], out["phase"], out["period"]])
    return found


def neighbours():
    """Adds `near` to each setpoint whose motion is not of period one."""
    data = json.loads(OUT.read_text())
    for c in data:
        for s in c["setpoints"]:
            if s["held"] and s["period"] != 1 and "near" not in s:
                s["near"] = near(c, s)
                shifts = [(1e12 * (z - s["tip_offset"]), f - s["phase"], n) for z, f, n in s["near"]]
                print(
                    c["name"],
                    s["setpoint"],
                    s["period"],
                    *(f"{z:+.2f} pm {f:+.4f} deg ({n})" for z, f, n in shifts),
                    flush=True,
                )
                OUT.write_text(json.dumps(data, indent=1))


if __name__ == "__main__":
    if sys.argv[1:] == ["near"]:
        sys.exit(neighbours())
    main(sys.argv[1] if len(sys.argv) > 1 else "named")
