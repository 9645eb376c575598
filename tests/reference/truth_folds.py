"""Curves of periodic orbits and their folds, in tip offset (free=2) or drive frequency (free=3).

A curve is followed by pseudo-arclength.  A fold is the root of (change over a period, det(I - M)) in (d, v, parameter),
M from the variational equation; and, as a check of another kind, the extremum of a polynomial through the parameter at
Chebyshev nodes in the amplitude.
"""

import math

import numpy as np
from truth_map import SZ
from truth_orbits import TOL, Lost, drive_period

BEGIN = -0.5 * math.pi


class Curve:
    """Orbits of a case; x = (d, v, parameter), parameter = tip offset [nm] or frequency ratio."""

    def __init__(self, p, free, other, begin=BEGIN, mode=0):
        self.p, self.free, self.other, self.begin, self.mode = p, free, other, begin, mode
        self.unit = np.array([p[SZ], p[SZ], p[SZ] if free == 2 else 0.1])

    def at(self, x, tol=TOL):
        z0, om = (x[2], self.other) if self.free == 2 else (self.other, x[2])
        r, h, m, dh, n = drive_period(self.p, self.mode, self.begin, x[:2], z0, om, tol)
        j = np.column_stack([m[:, 0], m[:, 1], m[:, self.free]])
        j[0, 0] -= 1
        j[1, 1] -= 1
        a = abs(h)
        self.harmonic_gradient = dh[[0, 1, self.free]]
        return r, j, h, (np.conj(h) * dh[[0, 1, self.free]]).real / a, n

    def det(self, x, tol=TOL):
        j = self.at(x, tol)[1]
        return j[0, 0] * j[1, 1] - j[0, 1] * j[1, 0]

    def solve(self, x, row, value, tol=TOL, enough=1e-10, limit=25):
        """Newton with the extra equation row(x) = (value, gradient)."""
        x = x.copy()
        still = 0
        for it in range(limit):
            r, j, h, da, _ = self.at(x, tol)
            f, g = row(x, h, da)
            move = -np.linalg.solve(np.vstack([j, g]), np.array([*r, f - value]))
            size = np.max(np.abs(move / self.unit))
            if not np.isfinite(size) or size > 0.3:
                raise Lost("far")
            x += move
            if size < enough:
                if enough > 1e-12 or still > 1:
                    return x
                still += 1
        if size > 100 * enough and size > 1e-11:
            raise Lost(f"slow {size:.0e}")
        return x

    def at_phase(self, x, angle, tol=TOL):
        """The orbit near x whose first harmonic has this argument."""

        def row(x, h, da):
            psi = np.angle(h * np.exp(-1j * angle)) + angle
            j = self.harmonic_gradient
            return psi, (np.conj(h) * j).imag / abs(h) ** 2

        return self.solve(x, row, angle, tol, 1e-14, 15)

    def follow(self, x, direction, step=2e-3, biggest=0.02, points=3000, stop=lambda x, h: False):
        """Points (x, H, det) of the curve from an orbit x; direction is the sign of the parameter's change at first."""
        out, t0, gone = [], None, 0.0
        self.end = "points"
        u = self.unit
        while len(out) < points:
            r, j, h, da, n = self.at(x)
            out.append((x.copy(), h, j[0, 0] * j[1, 1] - j[0, 1] * j[1, 0], n))
            if stop(x, h):
                self.end = "range"
                return out
            if len(out) > 20 and gone > 0.1 and np.linalg.norm((x - out[0][0]) / u) < 1.5 * step:
                self.end = "closed"
                return out
            gone = max(gone, np.linalg.norm((x - out[0][0]) / u))
            t = np.cross(j[0] * u, j[1] * u)
            t /= np.linalg.norm(t)
            if t0 is None:
                t *= direction * np.sign(t[2])
            elif t @ t0 < 0:
                t = -t
            t0 = t
            while True:
                guess = x + step * u * t
                try:
                    new = self.solve(guess, lambda y, h, da: ((t / u) @ (y - guess), t / u), 0.0, 1e-11, 1e-8, 8)
                    rr, jj, *_ = self.at(new)
                    if np.max(np.abs(rr)) > 1e-8 * self.p[SZ]:  # fell off the curve: a law that jumps
                        raise Lost("off")
                    tn = np.cross(jj[0] * u, jj[1] * u)
                    tn /= np.linalg.norm(tn)
                    if abs(tn @ t) > 0.97 and np.linalg.norm((new - guess) / u) < 0.3 * step:
                        break
                except (Lost, np.linalg.LinAlgError):
                    pass
                step *= 0.5
                if step < 1e-9:
                    self.end = "stops"
                    return out
            x = new
            step = min(step * 1.4, biggest)
        return out

    def fold(self, x, tol=TOL):
        """The fold near x; returns x and the size of the last step (relative)."""
        x, last = x.copy(), np.inf
        for it in range(30):
            r, j, *_ = self.at(x, tol)
            e = 2e-6 * self.unit
            g = np.array([(self.det(x + e * o, tol) - self.det(x - e * o, tol)) / (2 * e @ o) for o in np.eye(3)])
            f = j[0, 0] * j[1, 1] - j[0, 1] * j[1, 0]
            move = -np.linalg.solve(np.vstack([j, g]), np.array([*r, f]))
            size = np.max(np.abs(move / self.unit))
            if not size < 0.2:
                raise Lost("fold: far")
            x += move
            if it > 3 and (size > 0.5 * last or size < 1e-14) and size < 1e-9:
                return x, size
            last = size
        raise Lost(f"fold: {size:.0e}")

    def chebyshev(self, x, width, nodes=15, degree=10, of_amplitude=False):
        """The same fold from the parameter as a polynomial of the phase: (parameter, amplitude, misfit).

        Or, of_amplitude, where the amplitude is largest or smallest.
        """

        def height(y):
            return abs(self.at(y)[2]) if of_amplitude else y[2]

        angle, base = float(np.angle(self.at(x)[2])), height(x)
        s = np.cos(np.pi * (np.arange(nodes) + 0.5) / nodes)
        order = np.argsort(s)
        values = np.empty(nodes)
        for side in (order[nodes // 2 :], order[: nodes // 2][::-1]):
            points = [(angle, x.copy())]
            for i in side:
                want = angle + width * s[i]
                guess = points[-1][1]
                if len(points) > 1:
                    (a, u), (b, v) = points[-2:]
                    guess = v + (v - u) * (want - b) / (b - a) if b != a else v
                y = self.at_phase(guess, want)
                points.append((want, y))
                values[i] = height(y) - base
        poly = np.polynomial.Chebyshev.fit(s, values, degree, domain=[-1, 1])
        roots = poly.deriv().roots()
        roots = roots[abs(roots.imag) < 1e-9].real
        s0 = float(roots[np.argmin(abs(roots))])
        y = self.at_phase(x, angle + width * s0)
        misfit = np.max(abs(poly(s) - values)) / np.ptp(values)
        top = base + float(poly(s0))
        return (y[2], top, float(misfit)) if of_amplitude else (top, abs(self.at(y)[2]), float(misfit))
