"""Periodic orbits by Newton shooting on truth_map.period, folds of curves of them, and everything that is recorded of an orbit."""

import math

import numpy as np
from truth_map import AL0, DIAG, NDIAG, NH, SZ, TANGENT, U0, law, parameters, period

TOL = 1e-14


class Lost(ArithmeticError):
    """No orbit found."""


def drive_period(p, mode, begin, u, z0, om, tol=TOL):
    """End of a period: change of (d, v), harmonic (complex, z = Re(conj(H) e^{i theta})), monodromy 2 x 4, dH 4, contacts."""
    y, seen = np.empty(25), np.empty((3, 2))
    try:
        end, touched = period(TANGENT, mode, u[0], u[1], begin, p, z0, om, tol, y, seen)
    except ZeroDivisionError:
        raise Lost("integration failed") from None
    if end != mode or not np.all(np.isfinite(y)):
        raise Lost("the period does not end in the mode it began in" if end >= 0 else "integration failed")
    t = y[5:].reshape(4, 5)
    return np.array([y[1] - u[0], y[2] - u[1]]), complex(y[3], y[4]), t[:, 1:3].T, t[:, 3] + 1j * t[:, 4], touched


def shoot(p, om, mode, begin, u, z0, target=None, tol=TOL, limit=60, enough=None):
    """Newton's method; target: amplitude wanted (z0 unknown) or None (z0 given).  Returns (u, z0), last step, monodromy."""
    n = 2 if target is None else 3
    x = np.array([u[0], u[1], z0], float)
    enough = enough or 3e-13 * p[SZ]

    def residual(x):
        r, hm, m, dh, _ = drive_period(p, mode, begin, x[:2], x[2], om, tol)
        j = np.zeros((3, 3))
        j[:2, :3] = m[:, :3]
        j[0, 0] -= 1
        j[1, 1] -= 1
        a = abs(hm)
        j[2] = (np.conj(hm) * dh[:3]).real / a
        return np.array([*r, a - (target or a)]), j, m

    r, j, m = residual(x)
    last, worse = np.inf, 0
    for it in range(limit):
        move = -np.linalg.solve(j[:n, :n], r[:n])
        size = float(np.max(np.abs(move)))
        if not np.isfinite(size):
            raise Lost("singular")
        if size < enough or (size < 1e-9 * p[SZ] and size > 0.5 * last and it > 2):
            worse += 1
            if worse > 1:
                break
        f = min(1.0, 0.1 * p[SZ] / size)
        norm = np.linalg.norm(r[:n])
        while True:
            new = x.copy()
            new[:n] += f * move
            try:
                got = residual(new)
                if np.linalg.norm(got[0][:n]) < norm or norm < 1e-10 * p[SZ]:
                    break
            except Lost:
                if f < 1e-3:
                    raise
            f *= 0.5
            if f < 1e-4:
                raise Lost("no progress")
        x, last = new, size
        r, j, m = got
    else:
        raise Lost("no convergence")
    return x, size, m[:, :2], float(np.max(np.abs(r[:n]))), j


def facts(p, case, om, mode, begin, x, tol=TOL):
    """Everything recorded of an orbit, SI."""
    y, seen = np.empty(NDIAG), np.empty((3, 2))
    z0, nm, k = x[2], 1e-9, case["stiffness"]
    end, touched = period(DIAG, mode, x[0], x[1], begin, p, z0, om, tol, y, seen)
    if end != mode:
        raise Lost("mode")
    har = np.array([complex(y[3 + 2 * n], y[4 + 2 * n]) for n in range(NH)])
    lag = math.atan2(har[0].imag, har[0].real)
    dmax = max(law(m, seen[m, 1], p)[0] for m in range(3) if np.isfinite(seen[m, 1]))
    dmin = min(law(m, seen[m, 0], p)[0] for m in range(3) if np.isfinite(seen[m, 0]))
    low, high = np.inf, -np.inf
    for m in range(3):
        if np.isfinite(seen[m, 0]):
            lo, hi = seen[m]
            xs = np.linspace(lo, hi, 4001)
            fs = np.array([law(m, s, p)[3] for s in xs])
            for sign in (1, -1):
                i = int(np.argmin(sign * fs))
                best = fs[i]
                if 0 < i < 4000:  # golden section round an interior extremum
                    a, b = xs[i - 1], xs[i + 1]
                    for _ in range(60):
                        c, e = b - 0.618033988749895 * (b - a), a + 0.618033988749895 * (b - a)
                        fc, fe = law(m, c, p)[3], law(m, e, p)[3]
                        a, b = (a, e) if sign * fc < sign * fe else (c, b)
                    best = law(m, 0.5 * (a + b), p)[3]
                low, high = min(low, best), max(high, best)
    a1, u0, q = abs(har[0]), p[U0], 0.5 / p[AL0]
    loss = y[19] + y[20]
    supplied = math.pi * u0 * a1 * math.sin(lag) - y[18] / q
    virial = -y[17]
    from_motion = y[21] - y[18] * om / (2 * math.pi) - 0.5 * u0 * a1 * math.cos(lag)
    unit = k * nm * nm
    return {
        "tip_offset": z0 * nm,
        "amplitude": a1 * nm,
        "phase": 90 - math.degrees(lag),
        "mean_deflection": y[15] * nm,
        "indentation": dmax * nm,
        "farthest": dmin * nm,
        "dissipation": loss * unit,
        "dissipation_hysteresis": y[20] * unit,
        "dissipation_viscous": y[19] * unit,
        "virial": virial * unit,
        "peak_force": high * k * nm,
        "attractive_force": low * k * nm,
        "mean_force": y[16] * k * nm,
        "contact_fraction": y[22],
        "contacts": int(touched),
        "contacts_state": int(mode),
        "harmonics": [float(abs(h)) * nm for h in har[1:]],
        "energy_closure": (supplied - loss) / max(abs(math.pi * u0 * a1), 1e-300),
        "virial_closure": (virial - from_motion) / (u0 * a1),
        "determinant": math.exp(-y[23]),
        "mean_closure": (y[15] + y[16]) / a1,
        "start": {
            "drive_angle": float(begin),
            "deformation": float(x[0]) * nm,
            "velocity": float(x[1]) * nm,
            "mode": int(mode),
        },
    }


def complete(p, case, om, mode, begin, x, **keywords):
    """Refine and describe."""
    x, size, m, res, j = shoot(p, om, mode, begin, x[:2], x[2], **keywords)
    out = facts(p, case, om, mode, begin, x)
    mu = np.linalg.eigvals(m)
    out["floquet"] = float(np.max(np.abs(mu)))
    out["multipliers"] = [[float(e.real), float(e.imag)] for e in mu]
    full = np.linalg.solve(j[:2, :2], -j[:2, 2])  # d(d, v)/dz0
    out["determinant_closure"] = float(np.linalg.det(m) / out.pop("determinant") - 1)
    out["slope"] = float(j[2, :2] @ full + j[2, 2])  # dA/dz0
    out["residual"] = res * 1e-9
    out["last_step"] = size * 1e-9
    return x, out


__all__ = ["Lost", "TOL", "complete", "drive_period", "facts", "parameters", "shoot"]
