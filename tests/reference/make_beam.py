"""Makes tests/data/beam.json: taps of levers with one to three eigenmodes, in liquid and in air (equations: beam.py).

    python tests/reference/make_beam.py [GROUP ...]

Without a group all are made anew; otherwise these, and the rest of the file stays. Lists have one entry for each mode.

How an orbit is found: the tip is lowered from far in steps and each settles, in time where the quality factor is below
10, otherwise by Newton's method from the orbit before, in time where that ends or is no longer stable. The first settled
amplitude at the setpoint or below says which orbit a tip lowered from far finds (`from_far`). In air it is lowered on
until it jumps to another branch, and raised along that up to the setpoint: the other orbit. A material on which the
amplitude jumps past the setpoint, on which nothing settles, or that is pressed deeper than the tip is wide, is drawn
anew.

Results: phase [degree] and tip_offset [m], with the errors that are left when the tolerance of the integration is a
hundred times smaller; indentation [m]; touches (begun in a period of the drive); mode_amplitude [m] and mode_phase
[degree], arg(i X) where force or base moves as cos(w t); from_taps [J], minus the integral of F x' over a period, of each mode;
lost [J], the integral of (k/omega Q) x'^2 of each mode; dissipated [J] in the sample; spectral_radius of the monodromy
matrix of `periods` periods; state [m], x and x'/omega_1 of each mode at t = 0.
"""

import json
import math
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
        """The stable orbit to which time leads. Past a fold a motion lingers where the orbit was: it goes on from there."""
        p = self.problem
        for change in (1e-6, 1e-7, 1e-8, 1e-9):
            state = p.settle(state, z0, change)
            try:
                found = p.newton(state, z0, turns=8)[0]
            except (ArithmeticError, np.linalg.LinAlgError):
                continue
            if np.max(abs(found - state)) < 0.02 * p.p.scale and p.orbit(found, z0).radius < 1:
                return found
        raise ArithmeticError("not periodic")

    def move(self, by):
        """To another z0; True if the orbit is the one before, moved. Halves the step before it gives up on that."""
        p = self.problem
        if not self.in_time:
            while abs(by) > 1e-3:
                try:
                    state = p.newton(self.state, self.z0 + by, turns=8)[0]
                    orbit = p.orbit(state, self.z0 + by)
                    if orbit.radius < 1 and abs(p.share(orbit) - self.share) * abs(p.free_seen) < 1.5 * abs(by):
                        self.state, self.z0, self.share = state, orbit.z0, p.share(orbit)
                        return True
                except (ArithmeticError, np.linalg.LinAlgError):
                    pass
                by /= 4
            by = math.copysign(0.02, by)  # past the fold, so that time does not take too long to leave it
        state = self.settle(self.state, self.z0 + by)
        orbit = p.orbit(state, self.z0 + by, False)
        jump = abs(p.share(orbit) - self.share) * abs(p.free_seen)
        self.state, self.z0, self.share = state, orbit.z0, p.share(orbit)
        return jump < 1.5 * abs(by) + 0.01

    def at_setpoint(self):
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
    found = [sweep.at_setpoint()]
    if sweep.problem.orbit(*found[0], stability=False).peak > 2e9 * case["tip_radius"]:
        raise ArithmeticError("deeper than the tip is wide")
    if sweep.in_time or not case["adhesion"]:
        return found
    try:
        while sweep.move(-sweep.longest):
            if sweep.share < 0.5 * setpoint:
                return found
        below = sweep.share < setpoint
        while (sweep.share < setpoint) == below and sweep.move(math.copysign(sweep.longest, below - 0.5)):
            pass
        other = sweep.at_setpoint()
        if abs(other[1] - found[0][1]) > 1e-3:
            found.append(other)
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


def between(rng, low, high, log=False):
    return float(np.exp(rng.uniform(np.log(low), np.log(high))) if log else rng.uniform(low, high))


def second(rng, ratio, quality, modes=2):
    """Eigenmodes above the first: those of a beam, shifted in frequency as the second is."""
    shifts = [1.0, ratio, ratio / UNIFORM["frequency"][1] * UNIFORM["frequency"][2]][:modes]
    return dict(
        frequency_ratio=shifts, quality_factor=[*quality, *([between(rng, 1.2, 2.0) * quality[1]] * (modes - 2))]
    )


def wet(rng, modes=2, **given):
    return second(rng, between(rng, 6, 8.5), [between(rng, 1.5, 5), between(rng, 3, 10)], modes) | dict(
        stiffness=between(rng, 0.03, 1, True), setpoint=between(rng, 0.4, 0.9), modulus=between(rng, 1e6, 5e9, True),
        free_amplitude=between(rng, 5e-9, 20e-9, True), tip_radius=between(rng, 5e-9, 30e-9, True),
        excitation=str(rng.choice(["direct", "base"])), detector=str(rng.choice(["slope", "tip"])),
    ) | given  # fmt: skip


def wet_lossy(rng):
    return wet(rng, adhesion=between(rng, 0.001, 0.02, True), damping=between(rng, 0.01, 0.3, True))


def wet_stiff(rng):
    return wet(
        rng, stiffness=between(rng, 0.03, 0.1, True), modulus=between(rng, 2e9, 60e9, True),
        free_amplitude=between(rng, 10e-9, 30e-9), setpoint=between(rng, 0.6, 0.9),
    )  # fmt: skip


def dry(rng, ratio=None, modes=2, **given):
    ratio = ratio or between(rng, 6.05, 6.4)
    return second(rng, ratio, [between(rng, 40, 400, True), between(rng, 100, 800, True)], modes) | dict(
        resonance_frequency=75e3, stiffness=between(rng, 0.3, 40, True), setpoint=between(rng, 0.4, 0.9),
        modulus=between(rng, 50e6, 70e9, True), free_amplitude=between(rng, 10e-9, 60e-9, True),
        adhesion=between(rng, 0.005, 0.08, True), damping=float(rng.choice([0.0, between(rng, 1e-3, 0.05, True)])),
        excitation=str(rng.choice(["direct", "base"])), detector=str(rng.choice(["slope", "tip"])),
    ) | given  # fmt: skip


def dry_sticky(rng):
    return dry(
        rng, stiffness=between(rng, 2, 20), adhesion=between(rng, 0.04, 0.1), modulus=between(rng, 0.5e9, 10e9, True),
        free_amplitude=between(rng, 8e-9, 25e-9), setpoint=between(rng, 0.5, 0.95),
    )  # fmt: skip


def dry_soft(rng, periods=1):
    lever = dict(stiffness=0.3, quality_factor=[40.0, 150.0], free_amplitude=50e-9)
    sample = dict(modulus=between(rng, 5e9, 70e9, True), adhesion=0.0, damping=0.0)
    return dry(rng) | lever | sample | dict(periods=periods)


def dry_detuned(rng):
    drawn = dry(rng, drive_ratio=between(rng, 0.98, 1.02))
    return drawn | dict(quality_factor=[between(rng, 40, 120), drawn["quality_factor"][1]])


def repeats(one):
    """Whether an orbit is one of a single period of the drive."""
    residual = Problem(one, periods=1).residual(np.append(one["state"], one["tip_offset"]) * 1e9)
    return np.max(abs(residual[:-1])) < 1e-6


# Of the groups that want more than any orbit: whether the orbits of a case are what they want.
WANTED = {
    "air, both branches": lambda orbits: len(orbits) == 2,
    "air, two periods": lambda orbits: not repeats(orbits[0]),
}
# Name: number of cases, seed, and how one is drawn.
GROUPS = {
    "table": (36, None, table),
    "liquid, direct": (10, 1, lambda rng: wet(rng, excitation="direct")),
    "liquid, base": (10, 2, lambda rng: wet(rng, excitation="base")),
    "liquid, adhesion and loss": (6, 3, wet_lossy),
    "liquid, soft lever on stiff sample": (6, 4, wet_stiff),
    "liquid, three modes": (4, 5, lambda rng: wet(rng, modes=3)),
    "liquid, off resonance": (6, 6, lambda rng: wet(rng, drive_ratio=between(rng, 0.8, 1.2))),
    "air": (6, 7, dry),
    "air, second mode near the sixth harmonic": (5, 8, lambda rng: dry(rng, between(rng, 6.0, 6.05))),
    "air, soft lever on stiff sample": (3, 9, dry_soft),
    "air, both branches": (4, 12, dry_sticky),
    "air, two periods": (2, 13, lambda rng: dry_soft(rng, periods=2)),
    "air, three modes": (1, 10, lambda rng: dry(rng, modes=3)),
    "air, off resonance": (3, 11, dry_detuned),
}


def draws(group):
    """Cases of a group, without end if they are drawn."""
    _, seed, draw = GROUPS[group]
    if seed is None:
        yield from draw()
        return
    rng = np.random.default_rng(seed)
    while True:
        yield draw(rng)


def make(group):
    """Results of as many cases as the group has."""
    found, solved = [], 0
    for given in draws(group):
        case = whole(given)
        try:
            orbits = lower(case)
            new = [record(case, *at, from_far=not i) | {"group": group} for i, at in enumerate(orbits)]
        except (ArithmeticError, np.linalg.LinAlgError) as error:
            print("  drawn anew:", error, flush=True)
            continue
        if group in WANTED and not WANTED[group](new):
            continue
        for one in new:
            shown = ("phase", "phase_error", "tip_offset", "tip_offset_error", "touches", "spectral_radius")
            print(group, solved, {key: float(f"{one[key]:.7g}") for key in shown}, flush=True)
        found += new
        solved += 1
        if solved == GROUPS[group][0]:
            return found
    raise ValueError(f"{group}: only {solved} cases")


if __name__ == "__main__":
    names = sys.argv[1:] or list(GROUPS)
    old = json.loads(OUT.read_text()) if sys.argv[1:] else []
    new = {name: make(name) if name in names else [one for one in old if one["group"] == name] for name in GROUPS}
    OUT.write_text(json.dumps([one for name in GROUPS for one in new[name]], indent=1) + "\n")
