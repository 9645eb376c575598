"""Makes tests/data/beam.json: taps of levers with one to three eigenmodes, in liquid and in air (equations: beam.py).

    python tests/reference/make_beam.py [GROUP ...]

Without a group all are made anew; otherwise these, and the rest of the file stays. Lists have one entry for each mode.

How an orbit is found: the tip is lowered from far in steps and each settles, in time where the quality factor is below
10, otherwise by Newton's method from the orbit before, in time where that ends or is no longer stable. The first settled
amplitude at the setpoint or below says which orbit a tip lowered from far finds (`from_far`). In air it is lowered on
until it jumps to another branch, and raised along that up to the setpoint: the other orbit. A material on which the
amplitude jumps past the setpoint, or on which nothing settles, is drawn anew.

Results: phase [degree] and tip_offset [m], with the errors that are left when the tolerance of the integration is a
hundred times smaller; indentation [m]; touches (begun in a period of the drive); mode_amplitude [m] and mode_phase
[degree], arg(i X) where force or base moves as cos(w t); from_taps [J], minus the integral of F x' over a period, of each mode;
lost [J], the integral of (k/omega Q) x'^2 of each mode; dissipated [J] in the sample; spectral_radius of the monodromy
matrix of `periods` periods; state [m], x and x'/omega_1 of each mode at t = 0.
"""

import json
import pathlib
import sys

import numpy as np
from beam import UNIFORM, Problem

OUT = pathlib.Path(__file__).parent.parent / "data" / "beam.json"
DEFAULTS = dict(
    stiffness=0.1, resonance_frequency=30e3, quality_factor=[2.5, 6.0], frequency_ratio=[1.0, 7.5],
    stiffness_ratio=[1.0, 39.2739, 307.914], participation=list(UNIFORM["participation"]),
    slope_ratio=list(UNIFORM["slope"]), excitation="direct", detector="slope", drive_ratio=1.0, free_amplitude=10e-9,
    setpoint=0.8, tip_radius=10e-9, tip_modulus=130e9, tip_poisson_ratio=0.27, modulus=1e9, poisson_ratio=0.3,
    adhesion=0.0, decay_length=0.3e-9, damping=0.0, damping_exponent=0.5, periods=1,
)  # fmt: skip


def whole(case):
    """All parameters of a case, lists cut to its number of modes."""
    c = DEFAULTS | case
    n = len(c["quality_factor"])
    lists = ("frequency_ratio", "stiffness_ratio", "participation", "slope_ratio")
    return {key: list(value[:n]) if key in lists else value for key, value in c.items()}


class Sweep:
    """A tip that is lowered or raised slowly: its orbit at z0."""

    def __init__(self, case):
        self.problem = Problem(case, case["periods"], tol=1e-11)
        free = self.problem.free_modes.sum() + self.problem.p.base
        self.z0 = abs(free) + 5.0 + 20 * self.problem.p.d0 * (self.problem.p.f0 > 0)
        self.in_time = case["quality_factor"][0] < 10
        self.longest = min(0.3, 0.02 * abs(free))
        self.state = self.settle(self.problem.free_state(), self.z0)
        self.share = self.problem.share(self.problem.orbit(self.state, self.z0, False))

    def settle(self, state, z0):
        p = self.problem
        return p.newton(p.settle(state, z0, 1e-6), z0)[0]

    def move(self, by):
        """To another z0; True if the orbit is the one before, moved. Halves the step before it gives up on that."""
        p = self.problem
        if not self.in_time:
            while abs(by) > 1e-3:
                try:
                    state = p.newton(self.state, self.z0 + by, turns=8)[0]
                    orbit = p.orbit(state, self.z0 + by)
                    if orbit.radius < 1 and abs(p.share(orbit) - self.share) * p.target < 4 * abs(by):
                        self.state, self.z0, self.share = state, orbit.z0, p.share(orbit)
                        return True
                except (ArithmeticError, np.linalg.LinAlgError):
                    pass
                by /= 4
        state = self.settle(self.state, self.z0 + by)
        orbit = p.orbit(state, self.z0 + by)
        if orbit.radius >= 1:
            raise ArithmeticError("not periodic")
        jump = abs(p.share(orbit) - self.share) * abs(p.free_seen)
        self.state, self.z0, self.share = state, orbit.z0, p.share(orbit)
        return jump < 4 * abs(by) + 0.01

    def at_setpoint(self, case):
        """The stable orbit at the setpoint, near the present one."""
        state, z0 = self.problem.newton(self.state, self.z0, hold=True)
        if abs(z0 - self.z0) > 1.5 * self.longest or self.problem.orbit(state, z0).radius >= 1:
            raise ArithmeticError("another orbit")
        return state, z0


def lower(case):
    """States and z0 of the orbits at the setpoint: the one met from far, and in air the one beyond the jump, if any."""
    sweep, setpoint = Sweep(case), case["setpoint"]
    while sweep.share > setpoint:
        smooth = sweep.move(-sweep.longest)
        if not smooth and sweep.share < setpoint - 0.02:
            raise ArithmeticError("the amplitude jumps past the setpoint")
    found = [sweep.at_setpoint(case)]
    if sweep.in_time or not case["adhesion"]:
        return found
    try:
        while sweep.move(-sweep.longest):
            if sweep.share < 0.5 * setpoint:
                return found
        if sweep.share < setpoint:
            while sweep.share < setpoint and sweep.move(sweep.longest):
                pass
            found.append(sweep.at_setpoint(case))
    except ArithmeticError as error:
        print("  no other branch:", error)
    return found


def solved(case, state, z0, tol):
    p = Problem(case, case["periods"], tol)
    return p, p.orbit(*p.newton(state, z0, hold=True))


def record(case, state, z0, from_far):
    """Results in SI units."""
    p, orbit = solved(case, state, z0, 1e-13)
    rough, other = solved(case, state, z0, 1e-11)
    joule = case["stiffness"] * 1e-18
    results = dict(
        from_far=from_far, phase=p.phase(orbit), phase_error=abs(p.phase(orbit) - rough.phase(other)) + 1e-9,
        tip_offset=orbit.z0 * 1e-9, tip_offset_error=abs(orbit.z0 - other.z0) * 1e-9 + 1e-18,
        indentation=orbit.peak * 1e-9, touches=orbit.touches / case["periods"],
        mode_amplitude=(abs(orbit.harmonics) * 1e-9).tolist(),
        mode_phase=np.degrees(np.angle(1j * orbit.harmonics)).tolist(),
        from_taps=(orbit.given * joule).tolist(), lost=(orbit.lost * joule).tolist(),
        dissipated=orbit.dissipated * joule, spectral_radius=orbit.radius, state=(orbit.state * 1e-9).tolist(),
    )  # fmt: skip
    return case | results


def table():
    """The levers of two modes and of one in liquid, on which most was tried."""
    lever = dict(stiffness_ratio=[1.0, 39.2739])
    for setpoint in (0.8, 0.5):
        for modulus in (10e6, 100e6, 1e9):
            one = dict(quality_factor=[2.5], setpoint=setpoint, modulus=modulus)
            for excitation, detector in (("direct", "slope"), ("base", "slope"), ("base", "tip")):
                yield lever | dict(setpoint=setpoint, modulus=modulus, excitation=excitation, detector=detector)
            for excitation, participation in (("direct", 1.565984), ("base", 1.0), ("base", 1.565984)):
                yield one | dict(excitation=excitation, participation=[participation])


GROUPS = dict(table=table)


def make(group):
    found = []
    for number, given in enumerate(GROUPS[group]()):
        case = whole(given)
        try:
            orbits = lower(case)
            new = [record(case, *at, from_far=not i) for i, at in enumerate(orbits)]
        except (ArithmeticError, np.linalg.LinAlgError) as error:
            if group == "table":
                raise
            print("  drawn anew:", error, flush=True)
            continue
        for one in new:
            one["group"] = group
            print(group, number, {key: one[key] for key in ("phase", "phase_error", "tip_offset", "tip_offset_error",
                  "touches", "spectral_radius")}, flush=True)  # fmt: skip
        found += new
    return found


if __name__ == "__main__":
    names = sys.argv[1:] or list(GROUPS)
    kept = (
        [one for one in json.loads(OUT.read_text()) if one["group"] not in names]
        if sys.argv[1:] and OUT.exists()
        else []
    )
    for name in names:
        kept += make(name)
    OUT.write_text(json.dumps(kept, indent=1) + "\n")
