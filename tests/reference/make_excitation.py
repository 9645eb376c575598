"""Makes tests/data/excitation.json: orbits that hold the amplitude of the lever's deflection, its base being shaken.

    python tests/reference/make_excitation.py [NAME ...]

The equation of motion is written for the deflection y = z - u0 cos(omega tau) itself, in nm,

    y'' + 2 (alpha0 + alpha_s(d)) (y' + b') + y + F(d)/k = -b'',   b = u0 cos(omega tau),   d = y + b - z0,

and integrated by scipy's DOP853, from contact to contact (where the force has its corner) found as events. Newton's
method on y, y' at drive phase 0 and on z0 makes it periodic and its first harmonic as large as asked for: all by
central differences. Nothing is shared with the package, nor with shooting.py.

In liquid each case is begun far from the surface with the free oscillation and lowered in steps, each settled in time:
the first settled amplitude below the setpoint says which orbit engagement finds. Elsewhere, where that takes long,
Newton's method is begun at an orbit without losses of the branch that the case names.

phase: of y, 0 for the free lever at resonance, positive repulsive. tip: amplitude and phase of z = y + b, 0 likewise.
"""

import json
import math
import pathlib
import sys

import numpy as np
from scipy.integrate import solve_ivp

OUT = pathlib.Path(__file__).parent.parent / "data" / "excitation.json"
DEFAULTS = dict(
    stiffness=0.5, quality_factor=3.0, free_amplitude=10e-9, frequency_ratio=1.0, radius=10e-9, poisson_ratio=0.35,
    modulus=1e9, adhesion=0.05, damping=0.01, decay_length=0.3e-9, setpoint=0.7, side=0,
)  # fmt: skip
CASES = {
    "liquid": {},
    "liquid, stiffer": dict(modulus=3e9),
    "liquid, elastic, high setpoint": dict(damping=0.0, adhesion=0.0, setpoint=0.9),
    "liquid, below resonance": dict(frequency_ratio=0.9),
    "liquid, low setpoint": dict(setpoint=0.5, quality_factor=5.0),
    "Q 30, attractive": dict(stiffness=2.0, quality_factor=30.0, free_amplitude=4e-9, setpoint=0.9, side=-1),
    "Q 30": dict(stiffness=2.0, quality_factor=30.0, free_amplitude=30e-9, adhesion=0.02, side=1),
    "air": dict(stiffness=40.0, quality_factor=400.0, free_amplitude=40e-9, side=1),
    "air, stiffer": dict(stiffness=40.0, quality_factor=400.0, free_amplitude=40e-9, modulus=3e9, side=1),
}  # fmt: skip


class Lever:
    """The lever over a surface; lengths in nm, forces over the stiffness."""

    def __init__(self, case):
        c = {**DEFAULTS, **case}
        self.w, self.a0 = c["frequency_ratio"], 0.5 / c["quality_factor"]
        self.u0 = c["free_amplitude"] * 1e9 / c["quality_factor"]
        self.radius = c["radius"] * 1e9
        contact = 4 / 3 * c["modulus"] / (1 - c["poisson_ratio"] ** 2)
        self.hertz = contact * math.sqrt(c["radius"]) * 1e-9**1.5 / c["stiffness"] * 1e9
        self.f0 = 2 * math.pi * c["adhesion"] * c["radius"] / c["stiffness"] * 1e9
        self.d0, self.a1 = c["decay_length"] * 1e9, c["damping"]
        response = 1 / (1 - self.w**2 + 2j * self.a0 * self.w)
        self.free = abs(self.u0 * (response - 1))
        self.start = self.u0 * (response - 1)
        self.target = c["setpoint"] * self.free
        self.period = 2 * math.pi / self.w

    def rhs(self, inside):
        w, a0, u0, z0 = self.w, self.a0, self.u0, self.z0

        def f(t, s):
            c, n = u0 * math.cos(w * t), u0 * math.sin(w * t)
            d = s[0] + c - z0
            if inside:
                d = max(d, 0.0)
                force, loss = self.hertz * d**1.5 - self.f0, self.a1 * math.sqrt(d / self.radius)
            else:
                force, loss = -self.f0 / (1 - min(d, 0.0) / self.d0) ** 2, 0.0
            a = w * w * c - 2 * (a0 + loss) * (s[1] - w * n) - s[0] - force
            return (s[1], a, s[0] * math.cos(w * t), s[0] * math.sin(w * t), s[0])

        return f

    def run(self, y, v, periods=1, rtol=1e-12):
        """State after some periods, and the complex amplitude and mean of y over the last of them."""
        s = np.array([y, v, 0, 0, 0], float)

        def gap(t, s):
            return s[0] + self.u0 * math.cos(self.w * t) - self.z0

        gap.terminal = True
        for _ in range(periods):
            s[2:] = 0
            t = 0.0
            speed = s[1]
            inside = gap(0.0, s) > 0 or (gap(0.0, s) == 0 and speed > 0)
            while t < self.period * (1 - 1e-14):
                gap.direction = -1 if inside else 1
                done = solve_ivp(self.rhs(inside), (t, self.period), s, "DOP853", rtol=rtol, atol=1e-13, events=gap)
                t, s = done.t[-1], done.y[:, -1]
                if done.status == 1:
                    inside = not inside
        harmonic = (s[2] - 1j * s[3]) * 2 / self.period
        return s[0], s[1], harmonic, s[4] / self.period

    def first(self, side):
        """The orbit that engagement finds, or a stable one of this branch."""
        for start in self.without_losses(side) if side else self.engage():
            try:
                x, residual, floquet = self.settle(start)
            except (RuntimeError, np.linalg.LinAlgError):
                continue
            if floquet < 1 and residual < 1e-9:
                return x, residual, floquet
        raise RuntimeError("no orbit")

    def miss(self, x):
        self.z0 = x[2]
        y, v, harmonic, _ = self.run(x[0], x[1])
        return np.array([y - x[0], v - x[1], abs(harmonic) - self.target])

    def settle(self, x):
        """The orbit that holds the setpoint, near one."""
        for _ in range(30):
            m = self.miss(x)
            steps = 1e-5 * np.array([1.0, 1.0, 1.0])
            jacobian = np.array(
                [(self.miss(x + h) - self.miss(x - h)) / (2 * s) for s, h in zip(steps, np.diag(steps))]
            ).T
            move = np.linalg.solve(jacobian, -m)
            x = x + move * min(1.0, 0.3 / np.abs(move).max())
            if np.abs(move).max() < 1e-10:
                return x, np.abs(self.miss(x)).max(), np.abs(np.linalg.eigvals(jacobian[:2, :2] + np.eye(2))).max()
        raise RuntimeError(f"not converged: {x}, {m}")

    def without_losses(self, side):
        """Places near the orbit of this branch that the deflection's amplitude would have without losses."""
        most = self.u0 / (2 * self.a0)
        turn = np.linspace(0, np.pi / 2, 100001)
        a = most * np.cos(turn)
        seen = np.abs(a * np.exp(1j * side * turn) - 1j * self.u0)
        first = int(np.argmax(seen < self.target))
        z = -1j * a[first] * np.exp(1j * side * turn[first])
        y = z - self.u0
        return [np.array([y.real, -self.w * y.imag, a[first] - side * off]) for off in np.arange(0.2, 4.0, 0.4)]

    def engage(self):
        """Lower the tip from far until the settled amplitude is below the setpoint."""
        far = abs(self.start) + self.u0
        y, v = self.start.real, -self.w * self.start.imag
        step = 0.1 * far / max(1.0, 0.02 / self.a0)
        self.z0 = 1.15 * far + 2.0
        while True:
            before = (y, v, self.z0)
            last = 0.0
            for _ in range(int(60 / self.a0)):
                y, v, harmonic, _ = self.run(y, v, 2, 1e-6)
                if abs(harmonic - last) < 2e-5 * abs(harmonic):
                    break
                last = harmonic
            if abs(harmonic) <= self.target:
                return np.array([y, v, self.z0]), np.array(before)
            self.z0 -= step


def main():
    wanted = sys.argv[1:] or list(CASES)
    found = [case for case in json.loads(OUT.read_text()) if case["name"] not in wanted] if OUT.exists() else []
    for name in wanted:
        case = CASES[name]
        lever = Lever(case)
        x, residual, floquet = lever.first(case.get("side", 0))
        y, v, harmonic, mean = lever.run(x[0], x[1])
        lever.z0 = x[2]
        phase = math.degrees(np.angle(1j * harmonic)) + math.degrees(math.atan(2 * lever.a0))
        tip = harmonic + lever.u0
        found.append(
            {"name": name, **DEFAULTS, **case}
            | dict(
                tip_offset=x[2] * 1e-9, amplitude=abs(harmonic) * 1e-9, phase=phase, mean_deflection=mean * 1e-9,
                floquet=floquet, residual=residual * 1e-9, tip_amplitude=abs(tip) * 1e-9,
                tip_phase=math.degrees(np.angle(1j * tip)),
            )
        )  # fmt: skip
        print(name, found[-1]["phase"], x[2], abs(harmonic), floquet, residual, flush=True)
        OUT.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
