"""Makes tests/data/losses.json: orbits with a loss outside contact and with adhesion that grows at the deepest point.

    python tests/reference/losses.py

Integration and engagement are those of long_range.py; nothing is shared with phasemap. The integrator stops at contact
and, in contact, where the tip is deepest: from there adhesion is w_r until contact ends. E_dis [J] of the surface is what
the drive gives less what the lever's own damping takes, both from the motion.
"""

import json
import math
from pathlib import Path

import long_range
import numpy as np
from long_range import ATOL, PERIOD, RTOL, Tip
from scipy.integrate import solve_ivp

OUT = Path(__file__).parents[1] / "data" / "losses.json"
COUNT = 18
FREQUENCY = 300e3
OUTSIDE, INWARD, OUTWARD = range(3)


def drawn(rng, kind):
    return {
        "law": "van der waals",
        "parameters": {},
        "stiffness": rng.uniform(5, 40),
        "quality_factor": rng.uniform(15, 60),
        "free_amplitude": rng.uniform(8e-9, 30e-9),
        "radius": rng.uniform(5e-9, 20e-9),
        "modulus": math.exp(rng.uniform(math.log(3e8), math.log(5e9))),
        "adhesion": rng.uniform(0.005, 0.04),
        "damping": rng.choice([0.0, rng.uniform(0, 0.01)]),
        "decay_length": rng.uniform(0.2e-9, 0.5e-9),
        "setpoint": rng.uniform(0.5, 0.95),
        "adhesion_ratio": rng.uniform(1.1, 3.0) if kind != "outside" else 1.0,
        "outer_loss": math.exp(rng.uniform(math.log(1e-8), math.log(1e-6))) if kind != "adhesion" else 0.0,
        "outer_length": rng.uniform(0.2e-9, 3e-9),
    }


class Lossy(Tip):
    """A tip whose last number in a state is what its contact does."""

    def __init__(self, case):
        super().__init__(case)
        k = case["stiffness"]
        self.more = 2 * math.pi * case["radius"] * (case["adhesion_ratio"] - 1) * case["adhesion"] / k * 1e9
        self.loss = case["outer_loss"] * 2 * math.pi * FREQUENCY / (2 * k)
        self.length = 1e9 * case["outer_length"]

    def slopes(self, tau, y, z0, mode):
        found = super().slopes(tau, y, z0, mode != OUTSIDE)
        if mode == OUTSIDE:
            found[1] -= 2 * self.loss * math.exp(min(y[0] - z0, 0.0) / self.length) * y[1]
        elif mode == OUTWARD:
            found[1] += self.more
        return [*found, y[1] * y[1], y[1] * math.cos(tau)]

    def newton(self, state, z0):
        found = super().newton(state, z0)
        if found is not None:
            self.period(found[0], z0)  # what is dissipated there
        return found

    def period(self, state, z0):
        def edge(tau, y):
            return y[0] - z0

        def deepest(tau, y):
            return y[1]

        edge.terminal = deepest.terminal = True
        deepest.direction = -1
        mode = OUTSIDE if state[0] <= z0 else INWARD if state[1] > 0 else OUTWARD
        tau, y = 0.0, np.array([*state, 0.0, 0.0, 0.0, 0.0])
        while tau < PERIOD:
            edge.direction = 1 if mode == OUTSIDE else -1
            part = solve_ivp(
                lambda t, y, mode=mode: self.slopes(t, y, z0, mode), (tau, PERIOD), y, "DOP853", rtol=RTOL, atol=ATOL,
                max_step=0.3, events=[edge, deepest] if mode == INWARD else [edge],
            )  # fmt: skip
            y, tau = part.y[:, -1], part.t[-1]
            if part.status == 1:
                left = len(part.t_events[0]) > 0
                mode = (INWARD if mode == OUTSIDE else OUTSIDE) if left else OUTWARD
        gained = self.drive * y[5] - 2 * self.alpha0 * y[4]  # over k [nm^2]
        self.dissipated = gained * self.case["stiffness"] * 1e-18
        return y[:2], (y[2] - 1j * y[3]) / math.pi


def force_outside(case, gap):
    return -2 * math.pi * case["radius"] * case["adhesion"] / (1 + gap / case["decay_length"]) ** 2


def main():
    long_range.force_outside = force_outside
    rng, cases = np.random.default_rng(39), []
    while len(cases) < COUNT:
        case = drawn(rng, ("outside", "adhesion", "both")[len(cases) % 3])
        tip = Lossy(case)
        found = tip.engaged()
        if found is None:
            continue
        z0, phasor = found
        phase = 90 + math.degrees(math.atan2(phasor.imag, phasor.real))
        cases.append({**case, "tip_offset": 1e-9 * z0, "phase": phase, "dissipation": tip.dissipated})
        print(len(cases), f"{z0:.4f} nm, {phase:.4f} degree, {tip.dissipated / 1.602e-19:.3f} eV", flush=True)
        OUT.write_text(json.dumps(cases, indent=1) + "\n")


if __name__ == "__main__":
    main()
