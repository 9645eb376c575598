"""Makes tests/data/channels.json: what is integrated over orbits, by the equation of motion in time.

    python tests/reference/make_channels.py

Orbits by shooting in (z, z', z0): scipy's DOP853 from contact to contact (located by bisection of its dense output,
solve_ivp's events), one period of the drive, Newton's method until it closes with the amplitude that is wanted. All
integrals are further states of the same integration. Nothing is taken from phasemap. Lengths in nm, tau = omega_c t, and
forces over k in nm; the file has SI.

With F = F_elastic + F_attraction + damping, where F_elastic is the same law without adhesion: virial sums <F z>, the work of
the attraction (what a neck takes), the energy that damping takes, the energy <dF_elastic/dd (dd/dtheta)^2> that the
contact stores, <dF/dd> and <damping>, both over the period, and the harmonics 2 ... 6 of z as complex amplitudes against that of the first, which is taken as real.
"""

import json
import math
import pathlib

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

DATA = pathlib.Path(__file__).parent.parent / "data" / "channels.json"
HARMONICS = range(2, 7)


def laws(c):
    """F/k [nm] in contact and outside, its parts without adhesion, their slopes [1], alpha_s [1], release [nm]."""
    k, r, w = c["stiffness"], c["tip_radius"] * 1e9, c["adhesion"]
    modulus = c["modulus"] / (1 - c["poisson_ratio"] ** 2)
    K = 4 / 3 * modulus * 1e-9  # nN/nm2
    d0 = None if c["decay_length"] is None else c["decay_length"] * 1e9
    f0 = 0.0 if c["law"] == "hertz" else 2 * math.pi * w * r  # nN
    alpha1 = c["viscosity"] * c["tip_radius"] * 2 * math.pi * c["resonance_frequency"] / (2 * k)
    hertz = lambda d: K * math.sqrt(r) * max(d, 0.0) ** 1.5 / k
    hertz_slope = lambda d: 1.5 * K * math.sqrt(r) * math.sqrt(max(d, 0.0)) / k
    outside = lambda d: -f0 / (1 - d / d0) ** 2 / k if d0 else 0.0
    outside_slope = lambda d: -2 * f0 / d0 / (1 - d / d0) ** 3 / k if d0 else 0.0
    alpha = lambda d: alpha1 * math.sqrt(max(d, 0.0) / r)
    if c["law"] != "jkr":
        return (lambda d: hertz(d) - f0 / k), outside, hertz, hertz_slope, outside_slope, alpha, 0.0
    ac = (math.pi * w * r * r / (8 * modulus * 1e-9)) ** (1 / 3)
    depth = lambda a: a * a / r - 2 / 3 * math.sqrt(6 * math.pi * w * a / K)

    def radius(d):
        if d <= depth(ac):
            return ac
        return brentq(lambda a: depth(a) - d, ac, 10 * ac + 3 * math.sqrt(r * abs(d)), xtol=1e-15, rtol=1e-15)

    def force(d):
        a = radius(d)
        return (K * a**3 / r - math.sqrt(6 * math.pi * w * K * a**3)) / k

    slope = lambda d: 0.0  # infinite at release: not integrated
    return force, outside, hertz, slope, outside_slope, alpha, depth(ac)


class Lever:
    def __init__(self, c):
        self.c = c
        self.om = c["frequency_ratio"]
        self.q = c["quality_factor"]
        self.u0 = c["free_amplitude"] * 1e9 / self.q
        self.base = self.u0 if c["excitation"] == "base" else 0.0
        free = self.u0 / math.hypot(1 - self.om**2, self.om / self.q)
        if self.base:
            free *= math.hypot(self.om**2, self.om / self.q)
        self.target = c["setpoint"] * free
        (self.inside, self.outside, self.hertz, self.slope_in, self.slope_out, self.alpha, self.release) = laws(c)

    def field(self, touching, z0, full):
        om, q, u0 = self.om, self.q, self.u0

        def rhs(tau, y):
            z, v = y[0], y[1]
            d = z - z0
            f = self.inside(d) if touching else self.outside(min(d, 0.0))
            drag = 2 * self.alpha(d) * v if touching else 0.0
            c, s = math.cos(om * tau), math.sin(om * tau)
            out = [v, u0 * c - z - v / q - f - drag, z * c, z * s]
            if full:
                pull = f - self.hertz(d)
                slope = self.slope_in(d) if touching else self.slope_out(min(d, 0.0))
                alpha = 2 * self.alpha(d) if touching else 0.0
                out += [(f + drag) * z, pull * z, pull * c, pull * s, pull * v, drag * v, slope, alpha, f + drag]
                for n in HARMONICS:
                    out += [z * math.cos(n * om * tau), z * math.sin(n * om * tau)]
                out.append(1.5 * self.hertz(d) / d * v * v if d > 0 else 0.0)
            return out

        return rhs

    def period(self, z, v, z0, full=False):
        y = np.zeros(4 + (10 + 2 * len(HARMONICS) if full else 0))
        y[:2] = z, v
        self.deepest = -math.inf
        tau, end, touching = 0.0, 2 * math.pi / self.om, z - z0 > 0
        while tau < end:
            edge = self.release if touching else 0.0

            def event(_tau, y, edge=edge):
                return y[0] - z0 - edge

            def apex(_tau, y):
                return y[1]

            event.terminal, event.direction, apex.direction = True, (-1 if touching else 1), -1
            run = solve_ivp(
                self.field(touching, z0, full),
                (tau, end),
                y,
                "DOP853",
                events=[event, apex],
                rtol=1e-11,
                atol=1e-13,
                max_step=0.2,
            )
            tau, y = run.t[-1], run.y[:, -1]
            self.deepest = max([self.deepest, *(one[0] - z0 for one in run.y_events[1])])
            if run.status == 1:
                touching = not touching
        return y

    def seen(self, y):
        """Complex amplitude of z, z = Re(Z exp(i omega tau)), and what the detector sees of it."""
        z = (y[2] - 1j * y[3]) * self.om / math.pi
        return z, z - self.base

    def misses(self, x):
        y = self.period(*x)
        return np.array([y[0] - x[0], y[1] - x[1], abs(self.seen(y)[1]) - self.target])

    def start(self):
        """A harmonic orbit from the averaged equations by plain sums, the branch nearest to the surface."""
        theta = (np.arange(4000) + 0.5) * 2 * math.pi / 4000
        amplitude, om = self.target, self.om
        side = 1 if self.c["branch"] == "repulsive" else -1

        def sums(depth):
            d = depth - amplitude * (1 - np.cos(theta))
            v = -amplitude * om * np.sin(theta)
            touch = (d >= 0) | ((v < 0) & (d > self.release))
            f = np.array([self.inside(x) if t else self.outside(min(x, 0)) for x, t in zip(d, touch)])
            f = f + np.array([2 * self.alpha(x) for x in d]) * v
            return f.mean(), 2 * (f * np.cos(theta)).mean(), 2 * (f * np.sin(theta)).mean()

        def mismatch(depth):
            _, push, drag = sums(depth)
            x, y = push + amplitude * (1 - om**2), om / self.q * amplitude - drag
            return math.hypot(x, y) - self.u0

        depths = np.concatenate([np.geomspace(0.9 * amplitude, 0.05, 60), -np.linspace(0.01, 3, 60)])
        found = [mismatch(x) for x in depths]
        for i in range(1, len(depths)):
            if found[i - 1] > 0 >= found[i]:
                depth = brentq(mismatch, depths[i], depths[i - 1], xtol=1e-6)
                mean, push, drag = sums(depth)
                if (push > 0) == (side > 0):
                    break
        else:
            raise RuntimeError("no averaged orbit")
        x, y = push + amplitude * (1 - om**2), om / self.q * amplitude - drag
        lag = math.pi / 2 - math.atan2(x, y)
        z0 = amplitude - depth - mean
        return np.array([amplitude * math.cos(lag) - mean, amplitude * om * math.sin(lag), z0])

    def orbit(self):
        x = self.start()
        for _ in range(12):
            miss = self.misses(x)
            if np.abs(miss).max() < 1e-9:
                return x
            jacobian = np.empty((3, 3))
            for j, h in enumerate((1e-5, 1e-5, 1e-5)):
                moved = x.copy()
                moved[j] += h
                jacobian[:, j] = (self.misses(moved) - miss) / h
            step = np.linalg.solve(jacobian, miss)
            x = x - step * min(1.0, 0.3 / np.abs(step).max())
        raise RuntimeError(f"not closed: {miss}")

    def record(self):
        x = self.orbit()
        y = self.period(*x, full=True)
        om, k = self.om, self.c["stiffness"]
        z, seen = self.seen(y)
        share, energy = om / (2 * math.pi), k * 1e-18
        turn = np.angle(z)
        harmonics = []
        for i, n in enumerate(HARMONICS):
            value = (y[13 + 2 * i] - 1j * y[14 + 2 * i]) * om / math.pi * np.exp(-1j * n * turn)
            harmonics.append([float(value.real) * 1e-9, float(value.imag) * 1e-9])
        return {
            "tip_offset": x[2] * 1e-9, "indentation": self.deepest * 1e-9,
            "amplitude": abs(z) * 1e-9, "phase": math.degrees(turn) + 90,  # of the tip
            "seen_amplitude": abs(seen) * 1e-9,
            "seen_phase": math.degrees(np.angle(seen)) + 90 + (math.degrees(math.atan(1 / self.q)) if self.base else 0),
            "virial": -y[4] * share * energy,  # positive attractive
            "attraction_virial": -y[5] * share * energy,
            "adhesion_virial": -((y[6] - 1j * y[7]) * z.conjugate()).real * share * energy,  # of the first harmonic of z
            "contact_storage": y[-1] / om**2 * share * energy, "adhesion_loss": y[8] * energy, "damping_loss": y[9] * energy,
            "gradient": None if self.c["law"] == "jkr" else y[10] * share * k, "damping": y[11] * share,  # <k> [N/m], <2 alpha_s> [1]
            "mean_force": y[12] * share * k * 1e-9,
            "harmonics": harmonics,
        }  # fmt: skip


DEFAULTS = dict(
    stiffness=40.0, resonance_frequency=300e3, quality_factor=400.0, free_amplitude=40e-9, frequency_ratio=1.0,
    excitation="direct", tip_radius=10e-9, law="dmt", decay_length=0.3e-9, modulus=1e9, poisson_ratio=0.35,
    adhesion=0.0, viscosity=20.0, setpoint=0.6, branch="repulsive",
)  # fmt: skip
HARD = dict(
    stiffness=3.0, resonance_frequency=70e3, quality_factor=60.0, free_amplitude=60e-9, tip_radius=30e-9, setpoint=0.7
)
CASES = [
    dict(),
    dict(adhesion=0.06),
    dict(adhesion=0.06, setpoint=0.8),
    dict(modulus=0.2e9, adhesion=0.06),
    dict(modulus=0.2e9, adhesion=0.06, viscosity=100.0),
    dict(modulus=0.2e9, adhesion=0.06, viscosity=100.0, setpoint=0.8),
    dict(law="jkr", adhesion=0.06, decay_length=None, modulus=1e9),
    dict(law="jkr", adhesion=0.03, decay_length=None, modulus=0.3e9, viscosity=50.0),
    dict(adhesion=0.06, frequency_ratio=0.9995),
    dict(adhesion=0.06, excitation="base", quality_factor=30.0, stiffness=3.0, free_amplitude=20e-9),
    dict(adhesion=0.02, quality_factor=3.0, stiffness=0.5, free_amplitude=10e-9, modulus=0.1e9, setpoint=0.7),
    dict(
        adhesion=0.02,
        quality_factor=3.0,
        stiffness=0.5,
        free_amplitude=10e-9,
        modulus=0.1e9,
        setpoint=0.7,
        excitation="base",
    ),
    *(dict(HARD, law=law, adhesion=w, modulus=modulus, viscosity=v, decay_length=d0)
      for law, d0 in (("dmt", 0.3e-9), ("jkr", None)) for w in (0.0, 0.05)
      for modulus, v in ((1e9, 1036.0), (10e9, 10360.0)) if law == "dmt" or w),
    dict(HARD, quality_factor=3.0, stiffness=1.0, free_amplitude=20e-9, modulus=0.3e9, viscosity=600.0, adhesion=0.02),
]  # fmt: skip

if __name__ == "__main__":
    found = []
    for case in CASES:
        case = {**DEFAULTS, **case}
        found.append({**case, **Lever(case).record()})
        one = found[-1]
        om = 2 * math.pi * one["resonance_frequency"] * one["frequency_ratio"]
        material = om * one["viscosity"] * (1 - one["poisson_ratio"] ** 2) / (2 * one["modulus"])
        loss = one["damping_loss"] / (2 * math.pi * (one["attraction_virial"] - one["virial"]))
        raw = (one["damping_loss"] + one["adhesion_loss"]) / (2 * math.pi * -one["virial"])
        print(f"{raw:9.4f} {loss:9.4f} {material:9.4f}", one["phase"], one["harmonics"][0], flush=True)
    DATA.write_text(json.dumps(found, indent=1) + "\n")
