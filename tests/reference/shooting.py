"""Exact periodic orbits of the tapping-mode oscillator, independent of phasemap.

    z'' + 2 (a0 + a_s(d)) z' + z + F(d)/k = u0 cos(w tau),   d = z - z0   (lengths in nm here)

The orbit is followed in the phase theta of its own first harmonic: z = a cos(theta) + b sin(theta), with a and b slow
variables kept as a reference plus a small change, so that nothing is lost to rounding at high quality factors.  In
contact d = q^2 and the independent variable is sigma, d(theta) = 2 q d(sigma), so dq/d(sigma) = z' and every power of d
is smooth: no kink and no square root is left.  Contact and loss of contact are roots of the step size.  8th-order
Dormand-Prince.
"""

import numpy as np
from numba import njit
from scipy.integrate._ivp import dop853_coefficients as _c

A8, B8, E3, E5 = (np.ascontiguousarray(m) for m in (_c.A[:12, :12], _c.B, _c.E3[:12], _c.E5[:12]))
Z0, AR, BR, UC, US, W, AL0, KC, FA, D0, AL1, RT, EX, SC = range(14)  # places in the parameter vector
N = 10  # theta, q, da, db, harmonic cos and sin, mean, integral z'^2, integral a_s z'^2, integral a_s


@njit(cache=True)
def rhs(contact, y, p, f):
    c, s = np.cos(y[0]), np.sin(y[0])
    dz = y[2] * c + y[3] * s
    z = p[AR] * c + p[BR] * s + dz
    v = -(p[AR] + y[2]) * s + (p[BR] + y[3]) * c
    als = 0.0
    if contact:
        q = y[1]
        force = p[KC] * q**3 - p[FA]
        if p[AL1] != 0.0:
            # |q|^(2n): q^(2n) for the whole powers used here, continued smoothly just below zero
            als = p[AL1] * q ** int(round(2 * p[EX])) / p[RT] ** p[EX]
        j = 2.0 * q
    else:
        j, force = 1.0, 0.0
        if p[D0] > 0.0:
            force = -p[FA] / (1.0 - min(z - p[Z0], 0.5 * p[D0]) / p[D0]) ** 2
    w = p[W]
    h = (p[UC] * c + p[US] * s - 2.0 * (p[AL0] + als) * w * v - (1.0 - w * w) * z - force) / (w * w)
    f[0] = j
    f[1] = v if contact else 0.0
    f[2] = -j * s * h
    f[3] = j * c * h
    f[4] = j * dz * c / np.pi
    f[5] = j * dz * s / np.pi
    f[6] = j * dz / (2.0 * np.pi)
    f[7] = j * v * v
    f[8] = j * als * v * v
    f[9] = j * als


@njit(cache=True)
def step(contact, y, h, p, k, yn, tol):
    """One step of size h from y to yn; returns the error in units of the tolerance."""
    for i in range(12):
        for n in range(N):
            t = 0.0
            for m in range(i):
                t += A8[i, m] * k[m, n]
            yn[n] = y[n] + h * t
        rhs(contact, yn, p, k[i])
    e3 = e5 = 0.0
    for n in range(N):
        t = u3 = u5 = 0.0
        for m in range(12):
            t += B8[m] * k[m, n]
            u3 += E3[m] * k[m, n]
            u5 += E5[m] * k[m, n]
        yn[n] = y[n] + h * t
        if n < 4:
            scale = 1.0 if n < 2 else p[SC] + max(abs(y[n]), abs(yn[n]))
            e3 += (u3 / (tol * scale)) ** 2
            e5 += (u5 / (tol * scale)) ** 2
    if e3 == 0.0 and e5 == 0.0:
        return 0.0
    return abs(h) * e5 / np.sqrt((e5 + 0.01 * e3) * 4.0)


@njit(cache=True)
def speed(y, p):
    return -(p[AR] + y[2]) * np.sin(y[0]) + (p[BR] + y[3]) * np.cos(y[0])


@njit(cache=True)
def depth(y, p):
    return (p[AR] + y[2]) * np.cos(y[0]) + (p[BR] + y[3]) * np.sin(y[0]) - p[Z0]


@njit(cache=True)
def value(what, y, p):
    if what == 0:
        return depth(y, p)
    if what == 1:
        return y[1]
    if what == 2:
        return speed(y, p)
    return y[0] - np.pi


@njit(cache=True)
def root(what, contact, y, h, p, k, yn, tol):
    """Step size in (0, h) at which value(what) is zero (Illinois); yn holds the state there."""
    lo, hi, flo, fhi = 0.0, h, value(what, y, p), value(what, yn, p)
    x = h
    for it in range(60):
        x = (lo * fhi - hi * flo) / (fhi - flo)
        if not (min(lo, hi) < x < max(lo, hi)):
            x = 0.5 * (lo + hi)
        step(contact, y, x, p, k, yn, tol)
        f = value(what, yn, p)
        if abs(f) < 1e-15 or abs(hi - lo) < 1e-15 * h:
            break
        if (f > 0.0) == (fhi > 0.0):
            hi, fhi = x, f
            flo *= 0.5
        else:
            lo, flo = hi, fhi
            hi, fhi = x, f
    return x


@njit(cache=True)
def period(p, tol, y):
    """Integrates theta from -pi to pi; y receives the end state. Returns (contacts, peak depth, steps), contacts < 0: failed.
    Contacts counts the entries into contact; 0 with a positive peak is permanent contact."""
    y[:] = 0.0
    y[0] = -np.pi
    k, yn, ym = np.zeros((12, N)), np.zeros(N), np.zeros(N)
    d = depth(y, p)
    contact = d > 0.0
    peak = d
    if contact:
        y[1] = np.sqrt(d)
    hs = np.array([0.05, 0.02 / (1.0 + abs(p[AR]))])
    contacts, n = 0, 0
    while y[0] < np.pi - 1e-15:
        n += 1
        if n > 20000:
            return -1, peak, n
        m = 1 if contact else 0
        h = hs[m]
        if not contact:
            h = min(h, np.pi - y[0])
        err = step(contact, y, h, p, k, yn, tol)
        if not (err <= 1.0):
            if h < 1e-13:
                return -2, peak, n
            hs[m] = h * (max(0.2, 0.9 * err ** (-1.0 / 8.0)) if np.isfinite(err) else 0.2)
            continue
        grow = min(6.0, 0.9 * err ** (-1.0 / 8.0)) if err > 0.0 else 6.0
        v0, v1 = speed(y, p), speed(yn, p)
        g = yn[1] if contact else -depth(yn, p)  # negative: the step crossed the contact boundary
        start = h > 1e-12 and ((contact and v0 > 0.0) or (not contact and v0 < 0.0))
        if g < 0.0 and start:  # left and came back: take a shorter step first
            hs[m] = 0.4 * h
            continue
        if v0 * v1 < 0.0:  # turning point inside the step: a peak, or a crossing that would be missed
            ym[:] = yn
            hh = root(2, contact, y, h, p, k, ym, tol)
            dm = ym[1] if contact else -depth(ym, p)
            if v0 > 0.0:
                peak = max(peak, dm * dm if contact else -dm)
            if g >= 0.0 and dm < 0.0 and not start:
                h = hh
                yn[:] = ym
                g = dm
        if g < 0.0:
            root(1 if contact else 0, contact, y, h, p, k, yn, tol)
            if contact and yn[0] > np.pi:  # the period ends before contact does
                root(3, contact, y, h, p, k, yn, tol)
                y[:] = yn
                break
            y[:] = yn
            y[1] = 0.0
            contact = not contact
            contacts += contact
            hs[m] = max(h, hs[m])
            continue
        if contact and yn[0] > np.pi:
            root(3, contact, y, h, p, k, yn, tol)
            y[:] = yn
            break
        y[:] = yn
        hs[m] = h * grow if h >= hs[m] * 0.999 else hs[m]
    return contacts, peak, n


class Oscillator:
    """One case of the data file, in nm; x = (a, b, uc, us, z0) describes a trial orbit: position and minus velocity at
    theta = -pi, drive in the frame of the first harmonic, tip offset."""

    def __init__(self, case):
        c = {
            "frequency_ratio": 1.0,
            "tip_modulus": None,
            "tip_poisson_ratio": 0.0,
            "damping_exponent": 0.5,
            "contact": "dmt",
        } | case
        k, rt = c["stiffness"], c["tip_radius"]
        if c["modulus"] > 0:
            soft = (1 - c["poisson_ratio"] ** 2) / c["modulus"]
            if c["tip_modulus"] is not None:
                soft += (1 - c["tip_poisson_ratio"] ** 2) / c["tip_modulus"]
            stiff = 4 / 3 / soft
        else:
            stiff = 0.0
        self.k, self.q, self.w = k, c["quality_factor"], c["frequency_ratio"]
        f0 = 0.0 if c["contact"] == "hertz" else 2 * np.pi * c["adhesion"] * rt
        self.u0 = c["free_amplitude"] / self.q * 1e9
        self.free = self.u0 / np.hypot(1 - self.w**2, self.w / self.q)
        self.amp = c["setpoint"] * self.free
        self.far = c["decay_length"] is not None and f0 > 0
        self.p = np.zeros(14)
        self.p[[W, AL0, KC, FA]] = self.w, 0.5 / self.q, stiff * np.sqrt(rt * 1e-9) / k, f0 / k * 1e9
        self.p[[D0, AL1, RT, EX]] = (
            c["decay_length"] * 1e9 if self.far else -1.0,
            c["damping"],
            rt * 1e9,
            c["damping_exponent"],
        )
        self.p[SC] = self.amp * min(0.3, 3 / self.q)
        if round(2 * c["damping_exponent"]) != 2 * c["damping_exponent"]:
            raise ValueError("damping exponents in halves only")
        self.u_scale = max(self.u0, 1e-12)

    def run(self, x, tol=1e-12):
        """(residuals, end state, contacts, peak): change of a and b over the period, first harmonic less (amp, 0)."""
        p, y = self.p.copy(), np.empty(N)
        p[[AR, BR, UC, US, Z0]] = x
        contacts, peak, _ = period(p, tol, y)
        if contacts < 0:
            raise ArithmeticError("integration failed")
        return np.array([y[2], y[3], x[0] + y[4] - self.amp, x[1] + y[5]]), y, contacts, peak

    def jacobian(self, x, r=None, tol=1e-12, h=1e-6):
        """4 x 5, forward differences from r or, without r, central ones."""
        jac = np.empty((4, 5))
        for i in range(5):
            e = np.zeros(5)
            e[i] = h * (self.u_scale if i in (2, 3) else 1.0)
            up = self.run(x + e, tol)[0]
            jac[:, i] = (up - r) / e[i] if r is not None else (up - self.run(x - e, tol)[0]) / (2 * e[i])
        return jac

    def start(self, z0):
        """The free orbit at amplitude amp."""
        return np.array([self.amp, 0.0, self.amp * (1 - self.w**2), -self.amp * self.w / self.q, z0])

    def newton(self, x, last, tol=1e-12, goal=1e-10, iterations=12, h=1e-6):
        """Solves the four residuals and last(x) = (value, gradient) together; returns (x, iterations used)."""
        scale = np.array([1, 1, self.u_scale, self.u_scale, 1.0])
        for it in range(iterations):
            r = self.run(x, tol)[0]
            v, g = last(x)
            full = np.append(r, v)
            jac = np.vstack([self.jacobian(x, r, tol, h), g])
            dx = -scale * np.linalg.solve(jac * scale, full)
            big = np.max(np.abs(dx / scale)[:2])
            if big > 1.0:
                dx /= big
            x = x + dx
            if np.max(np.abs(dx / scale)) < goal:
                return x, it + 1
        raise ArithmeticError("Newton did not converge")

    def drive_equation(self, x):
        """|u| = u0, divided by u0."""
        u = np.hypot(x[2], x[3])
        return u / self.u0 - 1, np.array([0, 0, x[2] / u, x[3] / u, 0]) / self.u0

    def curve(self, wiggle=1.0):
        """Points (x) along the orbits of amplitude amp, from far to deep contact, and True if the curve was followed without a
        gap. A force that jumps at contact makes the curve start anew at grazing, like the square root of the depth:
        then it is followed from shallow contact both ways, up to a depth where the drive is still nearly the free one."""
        if not self.far and self.p[FA] > 0:
            for depth in (0.002, 0.01, 0.05, 0.2):
                try:
                    x = self.at(self.amp - depth)
                    break
                except (ArithmeticError, np.linalg.LinAlgError):
                    continue
            else:
                raise ArithmeticError("no contact orbit to start from")
            up, _ = self.trace(x, 1.0, wiggle)
            down, whole = self.trace(x, -1.0, wiggle)
            last = up[-1]
            grazed = (
                self.run(last)[3] < 1e-5 and np.hypot(last[2], last[3]) < 0.5 * (1 + self.amp / self.free) * self.u0
            )
            return np.vstack([up[:0:-1], down]), whole and grazed
        gap = 300.0 if self.far else 0.5
        return self.trace(self.at(self.amp + gap), -1.0, wiggle)

    def at(self, z0):
        e = np.eye(5)[4]
        return self.newton(self.start(z0), lambda x: (x[4] - z0, e), goal=1e-8, iterations=30)[0]

    def trace(self, x, direction, wiggle, max_points=4000):
        """Pseudo-arclength continuation in z0 and drive, through folds. Returns points and True if there was no gap. Upwards it
        ends near grazing."""
        scale = np.array([1, 1, self.u_scale, self.u_scale, 1.0])
        points, whole, size, tangent, beyond = [x], True, 0.01 if direction > 0 else 1.0, direction * np.eye(5)[4], 0
        while len(points) < max_points:
            r, _, contacts, peak = self.run(x)
            if direction > 0 and peak < 3e-6:
                return np.array(points), True
            h = 1e-6 if self.far or self.p[FA] == 0 else max(1e-9, min(1e-6, 0.003 * abs(peak)))
            jac = self.jacobian(x, r, h=h) * scale
            null = np.linalg.svd(jac)[2][-1]
            tangent = null if null @ tangent > 0 else -null
            # longest step allowed: a share of the gap or depth in z0, a share of u0 in the drive
            room = (0.01 if h == 1e-6 else 0.0) + 0.12 * abs(peak) + (0.05 * abs(x[4]) if x[4] < 0 else 0)
            u = np.hypot(x[2], x[3])
            limit = wiggle * min(
                room / (abs(tangent[4]) + 1e-30),
                0.5 * room / (np.hypot(*tangent[:2]) + 1e-30),
                0.1 * max(1, u / self.u0) / (np.hypot(*tangent[2:4]) + 1e-30),
            )
            ds = min(limit, size)
            while ds > 1e-9:
                guess = x + ds * tangent * scale
                try:
                    new, its = self.newton(
                        guess,
                        lambda y: (tangent @ ((y - guess) / scale), tangent / scale),
                        goal=1e-7,
                        iterations=6,
                        h=h,
                    )
                    if np.linalg.norm((new - guess) / scale) > 0.5 * ds + 1e-9:
                        raise ArithmeticError("far from prediction")
                    break
                except (ArithmeticError, np.linalg.LinAlgError):
                    ds *= 0.4
            else:  # cannot follow: natural step down
                if direction > 0:
                    return np.array(points), False
                whole = False
                for hop in (0.002, 0.01, 0.05, 0.2):
                    try:
                        new, its = self.newton(
                            x - hop * np.eye(5)[4],
                            lambda y: (y[4] - x[4] + hop, np.eye(5)[4]),
                            goal=1e-7,
                            iterations=20,
                        )
                        break
                    except (ArithmeticError, np.linalg.LinAlgError):
                        continue
                else:
                    return np.array(points), False
                ds, tangent = 1e-3, -np.eye(5)[4]
            size = ds * (2.0 if its <= 3 else 1.2 if its <= 4 else 0.7)
            x = new
            points.append(x)
            repulsive = x[2] > self.amp * (1 - self.w**2)
            u = np.hypot(x[2], x[3])
            deep = x[4] < -(2 * self.amp + 20)
            beyond = beyond + 1 if u > 4 * self.u0 and (repulsive or deep) and peak > 0 else 0
            if beyond > 8 or x[4] < -(6 * self.amp + 100):
                return np.array(points), whole
        return np.array(points), False

    def orbits(self, wiggle=1.0):
        """(orbits as dicts in SI, complete)."""
        points, whole = self.curve(wiggle)
        level = np.hypot(points[:, 2], points[:, 3]) / self.u0 - 1
        found, failed = [], 0
        for i in range(len(points) - 1):
            step = points[i + 1] - points[i]
            crossing = level[i] * level[i + 1] < 0
            if (
                crossing
            ):  # next to a fold the neighbour may catch Newton: other starts until one ends between the points
                guesses = [
                    points[i] + t * step for t in (level[i] / (level[i] - level[i + 1]), 0.5, 0.2, 0.8, 0.0, 1.0)
                ]
                ends = sorted(points[i : i + 2, 4])
                room = 0.05 * (ends[1] - ends[0]) + 1e-6
            elif i > 0 and (level[i] - level[i - 1]) * (level[i + 1] - level[i]) < 0 and abs(level[i]) < 0.03:
                # an extremum close to u0: try both sides of it
                guesses = [points[i] + t * (points[j] - points[i]) for j in (i - 1, i + 1) for t in (0.3, 0.6)]
            else:
                continue
            inside = lambda: any(ends[0] - room < f["x"][4] < ends[1] + room for f in found)
            for guess in guesses:
                try:
                    new = self.polish(guess)
                except (ArithmeticError, np.linalg.LinAlgError):
                    continue
                if abs(new["x"][4] - guess[4]) > 0.5 + 0.1 * abs(guess[4] - self.amp):
                    continue
                if all(np.max(np.abs(new["x"] - f["x"])) > 1e-7 for f in found):
                    found.append(new)
                if crossing and inside():
                    break
            failed += crossing and not inside()
        found.sort(key=lambda f: -f["tip_offset"])
        return found, whole and not failed

    def polish(self, x):
        """Newton to the limit of double precision, then everything reported."""
        x, _ = self.newton(x, self.drive_equation, goal=1e-8)
        # rounding limits the last steps at the highest quality factors: accept the best of a few
        best, best_r = None, np.inf
        for _ in range(4):
            r, v = self.run(x, 1e-13)[0], self.drive_equation(x)
            size = max(np.max(np.abs(r)), abs(v[0]) * self.amp)
            if size < best_r:
                best, best_r = x, size
            jac = np.vstack([self.jacobian(x, None, 1e-13), v[1]])
            x = x - np.linalg.solve(jac, np.append(r, v[0]))
        if best_r > 1e-9:
            raise ArithmeticError("not converged")
        return self.describe(best)

    def describe(self, x):
        r, y, contacts, peak = self.run(x, 1e-13)
        change = self.jacobian(x, None, 1e-13)[:2, :2]  # drive and tip offset held: the monodromy matrix less one
        multipliers = 1 + np.linalg.eigvals(change)
        det = np.linalg.det(np.eye(2) + change)
        expected = np.exp(-2 / self.w * (2 * np.pi * self.p[AL0] + y[9]))
        work = -np.pi * x[3] * self.amp
        closure = (work - 2 * self.p[AL0] * self.w * y[7] - 2 * self.w * y[8]) / work
        jac = np.vstack([self.jacobian(x, None, 1e-13), self.drive_equation(x)[1]])
        sens = np.linalg.solve(jac, np.append(r, self.drive_equation(x)[0]))  # what one more Newton step would change
        return {
            "x": x,
            "det_error": abs(det - expected),
            "closure": closure,
            "multipliers": multipliers,
            "z0_error_pm": abs(sens[4]) * 1e3,
            "phase_error": np.degrees(np.hypot(sens[2], sens[3]) / self.u0),
            "tip_offset": x[4] * 1e-9,
            "mean_deflection": y[6] * 1e-9,
            "phase": 90.0 - np.degrees(np.arctan2(-x[3], x[2])),
            "amplitude": self.amp * 1e-9,
            "floquet": float(np.max(np.abs(multipliers))),
            "slope": 1 / np.linalg.solve(jac, [0, 0, 1, 0, 0])[4],  # dA/dz0 at constant drive
            "residual": max(np.max(np.abs(r)), abs(self.drive_equation(x)[0]) * self.amp) * 1e-9,
            "dissipation": 2 * self.w * self.k * y[8] * 1e-18,
            "peak_indentation": peak * 1e-9,
            "contacts": contacts,
        }
