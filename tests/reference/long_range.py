"""Makes tests/data/long_range.json: orbits over forces that repel, oscillate or attract before contact.

    python tests/reference/long_range.py

Nothing is shared with phasemap. The equation of motion (theory, Eq. (model-1)) is integrated by scipy's DOP853, which
stops at contact; forces are written as functions of the gap, from the charges and energies themselves. A tip is lowered
from where the surface hardly acts, along stable periodic orbits (Newton's method on the map of a period, by differences)
or, where one is lost, in time, until its amplitude is first at or below the setpoint; the last step is then halved and
interpolated. A material whose amplitude jumps across the setpoint is left out.

Lengths in nm, times in 1/omega_c, forces over the lever's stiffness k.
"""

import json
import math
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

OUT = Path(__file__).parents[1] / "data" / "long_range.json"
EPSILON_0 = 8.8541878188e-12
COUNT = {"dlvo": 24, "hydration": 12, "solvation": 12, "lennard-jones": 12}
PERIOD = 2 * math.pi
RTOL, ATOL = 1e-10, 1e-11  # nm
STRIDE = 0.03  # of the free amplitude
LOST = 0.2  # of the amplitude: a farther orbit is another one


def drawn(rng, law):
    """A material and a microscope, SI units."""
    air = law == "lennard-jones"
    case = {
        "law": law,
        "stiffness": rng.uniform(5, 40) if air else math.exp(rng.uniform(math.log(0.1), math.log(3))),
        "quality_factor": rng.uniform(10, 60) if air else math.exp(rng.uniform(math.log(2), math.log(30))),
        "free_amplitude": rng.uniform(10e-9, 40e-9) if air else rng.uniform(2e-9, 12e-9),
        "radius": rng.uniform(5e-9, 20e-9),
        "modulus": math.exp(rng.uniform(math.log(1e8), math.log(5e9))),
        "adhesion": rng.uniform(0.01, 0.08) if air else rng.choice([0.0, rng.uniform(1e-4, 3e-3)]),
        "damping": rng.uniform(0, 0.02) if air else rng.uniform(0, 0.2),
        "decay_length": rng.uniform(0.2e-9, 0.5e-9),
        "setpoint": rng.uniform(0.4, 0.95),
    }
    if law == "dlvo":
        case["parameters"] = {
            "surface_charge_tip": rng.choice([-1, 1]) * rng.uniform(1e-3, 2e-2),
            "surface_charge_sample": -rng.uniform(1e-3, 2e-2),
            "debye_length": rng.uniform(0.5e-9, 5e-9),
        }
    elif law == "hydration":
        case["parameters"] = {"strength": rng.uniform(-2e-3, 10e-3), "decay": rng.uniform(0.3e-9, 1.5e-9)}
    elif law == "solvation":
        case["parameters"] = {
            "strength": rng.uniform(-5e-3, 5e-3), "period": rng.uniform(0.25e-9, 1e-9), "decay": rng.uniform(0.3e-9, 1e-9),
        }  # fmt: skip
    else:
        case["parameters"] = {}
    return case


def force_outside(case, gap):
    """Force [N] on the tip at a gap [m], positive repulsive."""
    r, d0, given = case["radius"], case["decay_length"], case["parameters"]
    if case["law"] == "lennard-jones":
        z0, z = d0, d0 + gap
        hamaker = 16 * math.pi * z0**2 * case["adhesion"]
        return hamaker * r / 6 * (z0**6 / (4 * z**8) - 1 / z**2)
    if case["law"] == "solvation":
        energy = (case["adhesion"] + given["strength"]) * math.exp(-gap / given["decay"])
        return -2 * math.pi * r * energy * math.cos(2 * math.pi * gap / given["period"])
    hamaker = 12 * math.pi * d0**2 * case["adhesion"]
    force = -hamaker * r / (6 * (d0 + gap) ** 2)
    if case["law"] == "dlvo":
        tip, sample, debye = given["surface_charge_tip"], given["surface_charge_sample"], given["debye_length"]
        # The pressure between plates, integrated over the sphere.
        near = (2 / (78.5 * EPSILON_0)) * tip * sample * debye * math.exp(-gap / debye)
        nearer = (2 / (78.5 * EPSILON_0)) * (tip**2 + sample**2) * debye / 2 * math.exp(-2 * gap / debye)
        return force + 2 * math.pi * r * (near + nearer)
    return force + 2 * math.pi * r * given["strength"] * math.exp(-gap / given["decay"])


class Tip:
    """A tip over a surface; states are z [nm] and dz/dtau at drive phase 0, and the sums of z cos and z sin."""

    def __init__(self, case):
        self.case, k = case, case["stiffness"]
        self.alpha0, self.drive = 0.5 / case["quality_factor"], 1e9 * case["free_amplitude"] / case["quality_factor"]
        self.free, self.radius = 1e9 * case["free_amplitude"], 1e9 * case["radius"]
        stiff = 4 / 3 * case["modulus"] / (1 - 0.35**2)
        self.hertz = stiff * math.sqrt(case["radius"]) * 1e-9**1.5 / k * 1e9  # nm^-0.5
        self.edge = force_outside(case, 0.0)

    def slopes(self, tau, y, z0, touching):
        z, v = y[0], y[1]
        d, alpha, k = z - z0, self.alpha0, self.case["stiffness"]
        if touching:
            depth = max(d, 0.0)
            force = self.hertz * depth**1.5 + 1e9 * self.edge / k
            alpha += self.case["damping"] * math.sqrt(depth / self.radius)
        else:
            force = 1e9 * force_outside(self.case, max(-d, 0.0) * 1e-9) / k
        c, s = math.cos(tau), math.sin(tau)
        return [v, self.drive * c - z - 2 * alpha * v - force, z * c, z * s]

    def period(self, state, z0):
        """The state one period on, and the phasor of z [nm]."""

        def edge(tau, y):
            return y[0] - z0

        edge.terminal = True
        tau, y, touching = 0.0, np.array([*state, 0.0, 0.0]), state[0] > z0
        while tau < PERIOD:
            edge.direction = -1 if touching else 1
            part = solve_ivp(
                lambda t, y, touching=touching: self.slopes(t, y, z0, touching), (tau, PERIOD), y, "DOP853",
                rtol=RTOL, atol=ATOL, max_step=0.3, events=edge,
            )  # fmt: skip
            y, tau = part.y[:, -1], part.t[-1]
            touching ^= part.status == 1
        return y[:2], (y[2] - 1j * y[3]) / math.pi

    def settled(self, state, z0):
        """The periodic orbit at a tip offset that a tip in this state comes to, and its phasor; None if to none."""
        found = self.newton(state, z0)
        if found is not None and np.hypot(*(found[0] - state)) < LOST * self.free:
            return found
        for _ in range(int(12 * self.case["quality_factor"]) + 60):
            state, _ = self.period(state, z0)
        found = self.newton(state, z0)
        return found if found is not None and np.hypot(*(found[0] - state)) < 0.02 * self.free else None

    def newton(self, state, z0):
        """A stable fixed point of the map near a state, or None."""
        state, h = np.array(state), 1e-5 * self.free
        for _ in range(12):
            end, phasor = self.period(state, z0)
            matrix = np.array(
                [(self.period(state + h * e, z0)[0] - self.period(state - h * e, z0)[0]) for e in np.eye(2)]
            )
            matrix = matrix.T / (2 * h)
            step = np.linalg.solve(np.eye(2) - matrix, end - state)
            if np.hypot(*step) < 1e-9 * self.free:
                return (state, phasor) if np.abs(np.linalg.eigvals(matrix)).max() < 1 else None
            state = state + step
            if not np.hypot(*state) < 5 * self.free:
                return None
        return None

    def engaged(self):
        """(z0 [nm], phasor) where the amplitude is first at the setpoint, or None."""
        target, stride = self.case["setpoint"] * self.free, STRIDE * self.free
        reach = max(5 * self.case["parameters"].get("debye_length", 1e-9), 3e-9)
        z0, state = 1.05 * self.free + 1e9 * reach, np.array([0.0, self.free])
        before = self.settled(state, z0)
        while before is not None and z0 > -5 * self.free:
            after = self.settled(before[0], z0 - stride)
            if after is None:
                return None
            if abs(after[1]) <= target:
                break
            z0, before = z0 - stride, after
        else:
            return None

        def missing(offset):
            found = self.settled(before[0], offset)
            return math.nan if found is None else abs(found[1]) - target

        while stride > 1e-3 * self.free:  # nearer, for a step of which Newton's method loses nothing
            stride *= 0.5
            after = self.settled(before[0], z0 - stride)
            if after is None:
                return None
            if abs(after[1]) > target:
                z0, before = z0 - stride, after
        if not missing(z0 - stride) < 0.0 < missing(z0) or missing(z0) - missing(z0 - stride) > 0.05 * self.free:
            return None
        z0 = brentq(missing, z0 - stride, z0, xtol=1e-9)
        return z0, self.settled(before[0], z0)[1]


def main():
    rng, cases = np.random.default_rng(38), []
    for law, count in COUNT.items():
        kept = 0
        while kept < count:
            case = drawn(rng, law)
            found = Tip(case).engaged()
            if found is None:
                continue
            z0, phasor = found
            lag = -math.degrees(math.atan2(phasor.imag, phasor.real))
            cases.append({**case, "tip_offset": 1e-9 * z0, "phase": 90 - lag})
            kept += 1
            print(len(cases), law, f"{z0:.4f} nm, {90 - lag:.4f} degree", flush=True)
            OUT.write_text(json.dumps(cases, indent=1) + "\n")


if __name__ == "__main__":
    main()
