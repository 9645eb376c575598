"""Periodic taps of a lever with several eigenmodes: integrated in time, made periodic by shooting; nothing of phasemap is used.

Time in 1/omega_1, lengths in nm, forces over k_1 (so in nm). With w the drive over the first resonance, and of mode i:
r = omega_i/omega_1, Q, kappa = k_i/k_1, participation B, and x its displacement at the tip relative to the base,

    x'' + (r/Q) (x' + B Y') + r^2 x = (r^2/kappa) (f - F) - B Y'',     z = Y + sum of x,   d = z - z0,

direct: f = u cos(w t), Y = 0, u = A0/Q_1.       base: f = 0, Y = (A0/(Q_1 B_1)) cos(w t).
F = K sqrt(R) d^(3/2) - f0 + 2 alpha_1 (d/R)^n z'  (d > 0),   F = -f0/(1 - d/d0)^2  (d <= 0),   f0 = 2 pi w R.

The detector sees S = sum of s_i x_i, s the slopes of the modes at the tip over that of the first ("slope"), or 1 ("tip").
From the first harmonic x = Re(X exp(i w t)): its phase is arg(S/S_free), S_free of the free lever at w = 1, and the
setpoint is |S| over that of the free lever at w.

In contact d = q^2 and the independent variable is sigma, dt = 2 q dsigma, so that dq/dsigma = z': no half power is left
in the equations, and the order of the method (8, Dormand and Prince) holds through first touch and release, which are
roots of the step size.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.integrate._ivp import dop853_coefficients as _c

A8, B8, E3, E5 = (np.ascontiguousarray(m) for m in (_c.A[:12, :12], _c.B, _c.E3[:12], _c.E5[:12]))


# A uniform beam, clamped at its base: frequency, participation and slope of the first three modes.
UNIFORM = dict(
    frequency=(1.0, 6.266893, 17.547482), participation=(1.565984, -0.867872, 0.508851),
    slope=(1.0, 3.473127, 5.701878),
)  # fmt: skip


class Lever(NamedTuple):
    """Arrays have one entry for each mode, the rest are numbers; units as above."""

    r: np.ndarray
    damping: np.ndarray  # r/Q
    inverse_mass: np.ndarray  # r^2/kappa
    force_cos: np.ndarray  # what shakes each mode at w
    force_sin: np.ndarray
    w: float
    base: float  # Y
    hertz: float  # K sqrt(R)/k_1
    f0: float
    d0: float
    alpha: float  # 2 alpha_1/R^n
    exponent: float  # n
    scale: float  # length on which the tolerance is based


@njit(cache=True)
def tip(y, n, t, p):
    """Height and speed of the tip."""
    z, v = p.base * math.cos(p.w * t), -p.base * p.w * math.sin(p.w * t)
    for i in range(n):
        z += y[i]
        v += y[n + i]
    return z, v


@njit(cache=True)
def rhs(contact, y, z0, p, f):
    """States: x, x', q, t; integrals: x cos and x sin of each mode, -F x' and x'^2 of each mode, alpha_s z'^2."""
    n = len(p.r)
    t = y[2 * n + 1]
    z, v = tip(y, n, t, p)
    loss = 0.0
    if contact:
        q = y[2 * n]
        j, dq = 2.0 * q, v
        if p.alpha != 0.0:
            loss = p.alpha * (abs(q) if p.exponent == 0.5 else abs(q) ** (2.0 * p.exponent))
        force = p.hertz * q**3 - p.f0 + loss * v
    else:
        j, dq, force = 1.0, 0.0, 0.0
        if p.f0 > 0.0:
            force = -p.f0 / (1.0 - min(z - z0, 0.5 * p.d0) / p.d0) ** 2
    c, s = math.cos(p.w * t), math.sin(p.w * t)
    f[2 * n] = dq
    f[2 * n + 1] = j
    for i in range(n):
        x, u = y[i], y[n + i]
        f[i] = j * u
        f[n + i] = j * (
            p.force_cos[i] * c + p.force_sin[i] * s - p.damping[i] * u - p.r[i] ** 2 * x - p.inverse_mass[i] * force
        )
        f[2 * n + 2 + i] = j * x * c
        f[3 * n + 2 + i] = j * x * s
        f[4 * n + 2 + i] = -j * force * u
        f[5 * n + 2 + i] = j * u * u
    f[6 * n + 2] = j * loss * v * v


@njit(cache=True)
def step(contact, y, h, z0, p, k, yn, tol):
    """One step of size h from y to yn; returns the error in units of the tolerance."""
    n = len(p.r)
    for i in range(12):
        for m in range(len(y)):
            a = 0.0
            for g in range(i):
                a += A8[i, g] * k[g, m]
            yn[m] = y[m] + h * a
        rhs(contact, yn, z0, p, k[i])
    e3 = e5 = 0.0
    for m in range(len(y)):
        a = a3 = a5 = 0.0
        for g in range(12):
            a += B8[g] * k[g, m]
            a3 += E3[g] * k[g, m]
            a5 += E5[g] * k[g, m]
        yn[m] = y[m] + h * a
        if m < 2 * n:
            scale = tol * p.scale * (1.0 if m < n else p.r[m - n])
            e3 += (a3 / scale) ** 2
            e5 += (a5 / scale) ** 2
    if e5 == 0.0:
        return 0.0
    return abs(h) * e5 / math.sqrt((e5 + 0.01 * e3) * 2 * n)


TOUCH, RELEASE, TURN, END = range(4)


@njit(cache=True)
def value(what, y, z0, end, p):
    n = len(p.r)
    t = y[2 * n + 1]
    if what == TOUCH:
        return tip(y, n, t, p)[0] - z0
    if what == RELEASE:
        return y[2 * n]
    if what == TURN:
        return tip(y, n, t, p)[1]
    return t - end


@njit(cache=True)
def root(what, contact, y, h, z0, end, p, k, yn, tol):
    """Step size in (0, h) at which value(what) is zero (Illinois); yn holds the state there."""
    lo, hi, below, above = 0.0, h, value(what, y, z0, end, p), value(what, yn, z0, end, p)
    x = h
    for _ in range(80):
        x = (lo * above - hi * below) / (above - below)
        if not (min(lo, hi) < x < max(lo, hi)):
            x = 0.5 * (lo + hi)
        step(contact, y, x, z0, p, k, yn, tol)
        f = value(what, yn, z0, end, p)
        if abs(f) < 1e-15 * max(1.0, p.scale) or abs(hi - lo) < 1e-15 * h:
            break
        if (f > 0.0) == (above > 0.0):
            below *= 0.5
        else:
            lo, below = hi, above
        hi, above = x, f
    return x


@njit(cache=True)
def integrate(state, z0, end, p, tol):
    """State and integrals at time `end`, number of first touches, and largest d; touches < 0: the integration failed."""
    n = len(p.r)
    y, yn, ym, k = np.zeros(6 * n + 3), np.zeros(6 * n + 3), np.zeros(6 * n + 3), np.zeros((12, 6 * n + 3))
    y[: 2 * n] = state
    d, v = tip(y, n, 0.0, p)
    d -= z0
    contact = d > 0.0 or (d == 0.0 and v > 0.0)
    y[2 * n] = math.sqrt(max(d, 0.0))
    peak, touches, count = d, 0, 0
    # No step is longer than an eighth of the fastest mode's period: the tip turns at most once in it.
    longest = 0.25 * math.pi / max(p.r.max(), p.w)
    sizes = np.array([0.1 * longest, 0.1 * math.sqrt(longest / (1.0 + p.scale))])
    while y[2 * n + 1] < end * (1.0 - 1e-15):
        count += 1
        if count > 200000:
            return y, -1, peak
        h = sizes[1 if contact else 0]
        left = end - y[2 * n + 1]
        if not contact:
            h = min(h, longest, left)
        elif 2.0 * y[2 * n] * h > longest:
            h = longest / (2.0 * y[2 * n])
        error = step(contact, y, h, z0, p, k, yn, tol)
        if not error <= 1.0:
            sizes[1 if contact else 0] = h * (max(0.2, 0.9 * error**-0.125) if math.isfinite(error) else 0.2)
            if h < 1e-14:
                return y, -2, peak
            continue
        grow = min(5.0, 0.9 * error**-0.125) if error > 0.0 else 5.0
        before, after = value(TURN, y, z0, end, p), value(TURN, yn, z0, end, p)
        outside = RELEASE if contact else TOUCH
        sign = 1.0 if contact else -1.0
        room = sign * value(outside, yn, z0, end, p)  # negative: the boundary was crossed
        crossed = room < 0.0
        away = sign * before > 0.0
        if crossed and away and value(outside, y, z0, end, p) * sign < 1e-9 and before * after < 0.0:
            sizes[1 if contact else 0] = 0.4 * h  # left the boundary and came back to it
            if h < 1e-14:
                return y, -3, peak
            continue
        if before * after < 0.0:
            ym[:] = yn
            turn = root(TURN, contact, y, h, z0, end, p, k, ym, tol)
            extreme = value(outside, ym, z0, end, p)
            if before > 0.0:
                peak = max(peak, extreme * extreme if contact else extreme)
            if not crossed and sign * extreme < 0.0:
                h, crossed = turn, True
                yn[:] = ym
        if crossed:
            root(outside, contact, y, h, z0, end, p, k, yn, tol)
            yn[2 * n] = 0.0
        if yn[2 * n + 1] > end:  # in contact, where the step is not one of time
            if crossed:
                step(contact, y, h, z0, p, k, yn, tol)
            root(END, contact, y, h, z0, end, p, k, yn, tol)
            y[:] = yn
            break
        if crossed:
            contact = not contact
            touches += contact
        elif h >= 0.999 * sizes[1 if contact else 0] or grow < 1.0:
            sizes[1 if contact else 0] = h * grow
        y[:] = yn
    d = tip(y, n, y[2 * n + 1], p)[0] - z0
    return y, touches, max(peak, d)


class Orbit(NamedTuple):
    """A periodic orbit: lengths in nm, energies in k_1 nm^2 for one period of the drive, one entry for each mode."""

    state: np.ndarray
    z0: float
    harmonics: np.ndarray  # X
    seen: complex  # S
    peak: float
    touches: int
    given: np.ndarray  # -integral of F x': what the taps give to each mode
    lost: np.ndarray  # integral of (kappa/r Q) x'^2
    dissipated: float  # integral of 2 alpha_s z'^2
    radius: float | None  # spectral radius of the monodromy matrix


class Problem:
    """One case in SI units, and its orbits over `periods` periods of the drive."""

    def __init__(self, case, periods=1, tol=1e-13):
        c = dict(
            participation=UNIFORM["participation"], slope_ratio=UNIFORM["slope"], stiffness_ratio=None,
            frequency_ratio=(1.0,), drive_ratio=1.0, adhesion=0.0, decay_length=None, damping=0.0, damping_exponent=0.5,
            tip_modulus=130e9, tip_poisson_ratio=0.27, poisson_ratio=0.3, tip_radius=10e-9,
        ) | case  # fmt: skip
        n = len(c["quality_factor"])
        r, quality = np.array(c["frequency_ratio"][:n], float), np.array(c["quality_factor"], float)
        stiffness = np.array(c["stiffness_ratio"] or np.square(UNIFORM["frequency"][:n]), float)
        b = np.array(c["participation"][:n], float)
        k, radius, w = c["stiffness"], c["tip_radius"] * 1e9, c["drive_ratio"]
        soft = (1 - c["poisson_ratio"] ** 2) / c["modulus"] + (1 - c["tip_poisson_ratio"] ** 2) / c["tip_modulus"]
        u = c["free_amplitude"] * 1e9 / quality[0]
        direct = c["excitation"] == "direct"
        base = 0.0 if direct else u / b[0]
        f0 = 2 * math.pi * c["adhesion"] * radius / k
        if f0 > 0 and c["decay_length"] is None:
            raise ValueError("adhesion without a decay length: the force would jump")
        self.n, self.periods, self.tol, self.k = n, periods, tol, k
        self.weights = np.array(c["slope_ratio"][:n] if c["detector"] == "slope" else np.ones(n), float)
        self.ratio, self.quality, self.stiffness = r, quality, stiffness
        self.p = Lever(
            r, r / quality, r**2 / stiffness,
            r**2 / stiffness * u if direct else b * base * w**2,
            np.zeros(n) if direct else b * base * w * r / quality,
            w, base, 4 / 3 / soft * math.sqrt(radius) * 1e-9 / k, f0, (c["decay_length"] or 0.3e-9) * 1e9,
            2 * c["damping"] / radius ** c["damping_exponent"], c["damping_exponent"], c["free_amplitude"] * 1e9,
        )  # fmt: skip
        self.end = 2 * math.pi / w * periods
        # The free lever, at the drive frequency and at resonance (where a base's acceleration is other than at w).
        self.free_modes = self.free(w, direct, b, u)
        self.free_seen = self.weights @ self.free_modes
        self.zero = np.angle(self.weights @ self.free(1.0, direct, b, u))
        self.target = c["setpoint"] * abs(self.free_seen)

    def free(self, w, direct, b, u):
        """X of the free lever."""
        r, q = self.ratio, self.quality
        push = r**2 / self.stiffness * u if direct else b * (u / b[0]) * (w**2 - 1j * w * r / q)
        return push / (r**2 - w**2 + 1j * w * r / q)

    def free_state(self):
        x = self.free_modes
        return np.concatenate([x.real, (1j * self.p.w * x).real])

    def run(self, state, z0):
        y, touches, peak = integrate(np.asarray(state, float), float(z0), self.end, self.p, self.tol)
        if touches < 0 or not np.isfinite(y).all():
            raise ArithmeticError(f"integration failed at {z0}: {touches}")
        return y, touches, peak

    def modes(self, y):
        n = self.n
        return (y[2 * n + 2 : 3 * n + 2] - 1j * y[3 * n + 2 : 4 * n + 2]) * 2 / self.end

    def residual(self, u):
        """Change of the state over the period, and detected amplitude less the setpoint's; u: state and z0."""
        y, _, _ = self.run(u[:-1], u[-1])
        return np.append(y[: 2 * self.n] - u[:-1], abs(self.weights @ self.modes(y)) - self.target)

    def jacobian(self, u, h=1e-5):
        columns = []
        for i in range(len(u)):
            e = np.zeros(len(u))
            e[i] = h * (self.ratio[i - self.n] if self.n <= i < 2 * self.n else 1.0)
            columns.append((self.residual(u + e) - self.residual(u - e)) / (2 * e[i]))
        return np.array(columns).T

    def newton(self, state, z0, hold=False, turns=25):
        """State and z0 of a periodic orbit: at this z0, or (`hold`) at the setpoint, from a guess nearby."""
        goal = max(1e-9, 1e4 * self.tol)  # the last change; rounding of a period's motion is Q times as large
        u = np.append(state, z0)
        size = np.concatenate([np.ones(self.n), self.ratio, [1.0]])
        for _ in range(turns):
            r, jac = self.residual(u), self.jacobian(u)
            free = slice(None) if hold else slice(0, -1)
            change = np.zeros(len(u))
            change[free] = np.linalg.solve(jac[free, free], -r[free])
            big = np.max(np.abs(change / size))
            # Far from the orbit: at most a share of the amplitude, so that it stays the orbit that is near.
            u = u + change * min(1.0, 0.1 * self.p.scale / max(big, goal))
            if big < goal:
                return u[:-1], u[-1]
        raise ArithmeticError("no convergence")

    def settle(self, state, z0, change=1e-9, turns=6000):
        """State after so many periods that it comes back: the orbit that time leads to."""
        for _ in range(turns):
            y, _, _ = self.run(state, z0)
            new = y[: 2 * self.n]
            if np.max(np.abs(new - state)) < change * self.p.scale:
                return new
            state = new
        raise ArithmeticError("not periodic")

    def orbit(self, state, z0, stability=True):
        n = self.n
        y, touches, peak = self.run(state, z0)
        radius = None
        if stability:
            jac = self.jacobian(np.append(state, z0))[:-1, :-1] + np.eye(2 * n)
            radius = float(np.max(np.abs(np.linalg.eigvals(jac))))
        x, m = self.modes(y), self.periods
        return Orbit(
            np.array(state), float(z0), x, self.weights @ x, peak, touches, y[4 * n + 2 : 5 * n + 2] / m,
            y[5 * n + 2 : 6 * n + 2] * self.stiffness / (self.ratio * self.quality) / m, y[6 * n + 2] / m, radius,
        )  # fmt: skip

    def phase(self, orbit):
        """Degrees over the free lever at resonance, at the detector."""
        turn = np.degrees(np.angle(orbit.seen) - self.zero)
        return float((turn + 180) % 360 - 180)

    def share(self, orbit):
        """Detected amplitude over that of the free lever."""
        return abs(orbit.seen) / abs(self.free_seen)
