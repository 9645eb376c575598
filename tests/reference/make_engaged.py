"""Makes tests/data/engaged.json: which orbit a quasi-static engagement ends on, by brute force in time.

    python tests/reference/make_engaged.py

Starts far from the surface with the free steady oscillation, lowers z0 in small steps and integrates after each until
the lock-in amplitude and phase have settled.  A step that changes the oscillation much (a jump) or passes the setpoint
is taken back and halved, down to 1 pm; so the state follows its branch to the fold, jumps there, and whatever it does
is what the oscillator does.  The first settled amplitude at or below the setpoint stops it; a secant on z0 then holds
the setpoint. Plain RK4 on (z, z') with time steps that shrink near the surface; no event location, no periodicity
assumed, nothing shared with shooting.py but the material constants.

engaged: tip_offset, phase, amplitude, branch ("attractive" or "repulsive" by the in-phase part of the force's first
harmonic; "none" if no oscillation of one drive period holds the setpoint: then the three others are null), periods
integrated, start and end of the lowering of z0, jumps (tip offset; amplitude and phase before and after; a slow jump is
listed as several, some pm apart), unsteady (tip offsets at which the oscillation had not settled after 25 Q + 200
periods: next to a fold, or for good). orbits: all exact orbits (shooting.py), of which the engaged one is
orbits[engaged.orbit].
"""

import json
import pathlib
import sys
import time

import numpy as np
from make_orbits import DEFAULTS, FIG7, LIQUID
from numba import njit
from shooting import AL0, AL1, D0, EX, FA, KC, RT, Oscillator, W

OUT = pathlib.Path(__file__).parent.parent / "data" / "engaged.json"
SMALL = dict(
    free_amplitude=6e-9, quality_factor=300.0, adhesion=0.04
)  # no attractive orbit at setpoints from about 0.32 to 0.761
STICKY = LIQUID | dict(quality_factor=8.0, adhesion=0.05, stiffness=1.0, modulus=1e9)
CASES = [
    *[
        (f"Fig. 7, setpoint {s}", "Fig. 7", FIG7 | dict(adhesion=0.1, setpoint=s))
        for s in (0.97, 0.95, 0.93, 0.9, 0.7, 0.4, 0.2)
    ],
    ("stays attractive", "bistable", FIG7),
    ("stays attractive, undamped", "bistable", FIG7 | dict(damping=0.0, setpoint=0.6)),
    ("small amplitude, stays attractive", "bistable", SMALL | dict(setpoint=0.85)),
    ("small amplitude, just above the smallest attractive amplitude", "near fold", SMALL | dict(setpoint=0.765)),
    ("small amplitude, just below it", "near fold", SMALL | dict(setpoint=0.755)),
    ("small amplitude, undamped, below it", "near fold", SMALL | dict(damping=0.0, setpoint=0.74)),
    ("small amplitude, attractive orbit exists but was left", "bistable", SMALL | dict(setpoint=0.25)),
    (
        "no repulsive orbit left",
        "bistable",
        FIG7 | dict(adhesion=0.3, damping=0.05, setpoint=0.92, quality_factor=200.0),
    ),
    (
        "strong damping, bistable",
        "bistable",
        FIG7 | dict(adhesion=0.3, damping=0.05, setpoint=0.6, quality_factor=200.0),
    ),
    ("soft lever", "bistable", dict(stiffness=3.0, quality_factor=150.0, modulus=5e8, adhesion=0.05, setpoint=0.8)),
    ("above resonance", "off resonance", dict(frequency_ratio=1.002, adhesion=0.1, setpoint=0.8, quality_factor=300.0)),
    (
        "above resonance, just above the smallest attractive amplitude",
        "off resonance",
        dict(frequency_ratio=1.003, quality_factor=300.0, setpoint=0.92),
    ),
    ("above resonance, below it", "off resonance", dict(frequency_ratio=1.003, quality_factor=300.0, setpoint=0.8)),
    ("below resonance", "off resonance", dict(frequency_ratio=0.998, adhesion=0.1, setpoint=0.8, quality_factor=300.0)),
    ("liquid", "low Q", LIQUID),
    ("liquid, sticky, attractive", "low Q", STICKY | dict(setpoint=0.9)),
    ("liquid, sticky, attractive orbit unstable, period doubled", "low Q", STICKY | dict(setpoint=0.79)),
    ("liquid, sticky, attractive orbit unstable", "low Q", STICKY | dict(setpoint=0.75)),
    ("liquid, stiff, two contacts per period", "low Q", LIQUID | dict(quality_factor=2.0, modulus=5e9, setpoint=0.2)),
]


@njit(cache=True)
def accel(z, v, drive, z0, p):
    d = z - z0
    a = p[AL0]
    if d >= 0.0:
        s = np.sqrt(d)
        f = p[KC] * d * s - p[FA]
        if p[AL1] != 0.0:
            a += p[AL1] * (s / np.sqrt(p[RT]) if p[EX] == 0.5 else (d / p[RT]) ** p[EX])
    elif p[D0] > 0.0:
        f = -p[FA] / (1.0 - d / p[D0]) ** 2
    else:
        f = 0.0
    return drive - 2.0 * a * v - z - f


@njit(cache=True)
def integrate(state, z0, u0, p, periods, out, n):
    """RK4 over whole drive periods; n steps per period far away, more near the surface.  state is (z, z') at drive phase 0.
    out[i] is the lock-in (in phase, quadrature) of period i."""
    z, v = state
    w = p[W]
    t_end = 2.0 * np.pi / w
    big = t_end / n
    for i in range(periods):
        t, c, s = 0.0, 0.0, 0.0
        while t < t_end - 1e-12:
            d = z - z0
            h = big
            if d > -3.0 - abs(v) * big:
                h = big / 4.0
                if d > -0.5 - abs(v) * big / 4.0:
                    h = big / 16.0
            if h > t_end - t:
                h = t_end - t
            w0, w1, w2 = np.cos(w * t), np.cos(w * (t + 0.5 * h)), np.cos(w * (t + h))
            s0, s1, s2 = np.sin(w * t), np.sin(w * (t + 0.5 * h)), np.sin(w * (t + h))
            a1 = accel(z, v, u0 * w0, z0, p)
            z2, v2 = z + 0.5 * h * v, v + 0.5 * h * a1
            a2 = accel(z2, v2, u0 * w1, z0, p)
            z3, v3 = z + 0.5 * h * v2, v + 0.5 * h * a2
            a3 = accel(z3, v3, u0 * w1, z0, p)
            z4, v4 = z + h * v3, v + h * a3
            a4 = accel(z4, v4, u0 * w2, z0, p)
            zn = z + h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4)
            vn = v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
            zm = 0.5 * (z + zn) + h / 8.0 * (v - vn)  # Hermite midpoint, Simpson
            c += h / 6.0 * (z * w0 + 4.0 * zm * w1 + zn * w2)
            s += h / 6.0 * (z * s0 + 4.0 * zm * s1 + zn * s2)
            z, v, t = zn, vn, t + h
        out[i, 0] = 2.0 * c / t_end
        out[i, 1] = 2.0 * s / t_end
    state[0], state[1] = z, v


class Bench:
    """The oscillator on the bench: integrates, counts periods, reads the lock-in."""

    def __init__(self, case, n=400):
        self.o = Oscillator(case)
        self.n, self.periods = n, 0
        x, y = 1 - self.o.w**2, self.o.w / self.o.q
        self.state = np.array([self.o.u0 * x / (x * x + y * y), self.o.u0 * y / (x * x + y * y) * self.o.w])

    def settle(self, z0, goal=2e-7):
        """(amplitude, phase in degrees, steady); goal: relative change of the lock-in signal over Q/2 + 4 periods."""
        block = int(self.o.q / 2) + 4
        out = np.empty((block, 2))
        old = np.array([np.inf, np.inf])
        for _ in range(50):
            integrate(self.state, z0, self.o.u0, self.o.p, block, out, self.n)
            self.periods += block
            new = out[-1].copy()
            if max(np.hypot(*(new - old)), np.hypot(*(out[-2] - new))) < goal * self.o.amp:
                return np.hypot(*new), 90 - np.degrees(np.arctan2(new[1], new[0])), True
            old = new
        mean = out.mean(axis=0)
        return np.hypot(*mean), 90 - np.degrees(np.arctan2(mean[1], mean[0])), False


def engage(case, step_max=0.2, step_min=1e-3):
    b = Bench(case)
    o = b.o
    z0 = o.free + (40.0 if o.far else 0.3)
    start, jumps, unsteady = z0, [], []
    amplitude, phase, _ = b.settle(z0)
    step, restless = step_max, False
    while True:
        saved = b.state.copy()
        new_amplitude, new_phase, steady = b.settle(z0 - step)
        # a jump: the lock-in signal moved by much more than the step
        moved = abs(new_amplitude * np.exp(1j * np.radians(new_phase)) - amplitude * np.exp(1j * np.radians(phase)))
        jump = moved > 3.0 * step + 0.02 * o.free
        # where it never settles (other than by slowing down next to a fold) steps of 10 pm have to do
        if (jump or not steady or new_amplitude <= o.amp) and step > (0.01 if restless else step_min):
            b.state[:] = saved
            step = max(step / 4, step_min)
            continue
        restless = not steady
        if not steady:
            unsteady.append(z0 - step)
        if jump:
            jumps.append(
                dict(
                    tip_offset=(z0 - step) * 1e-9,
                    amplitude_before=amplitude * 1e-9,
                    phase_before=phase,
                    amplitude_after=new_amplitude * 1e-9,
                    phase_after=new_phase,
                    steady=bool(steady),
                )
            )
        z0 -= step
        amplitude, phase = new_amplitude, new_phase
        step = min(step * 1.6, step_max)
        if amplitude <= o.amp:
            break
        if z0 < -3 * o.amp - 30 or len(unsteady) > 600:
            return None, dict(
                branch="none",
                periods=b.periods,
                start=start * 1e-9,
                end=z0 * 1e-9,
                jumps=jumps,
                unsteady=[float(u) * 1e-9 for u in unsteady],
            )
    end = z0
    # hold the setpoint: secant, slope near one to begin with
    last = (z0, amplitude)
    z0 += o.amp - amplitude
    held = False
    for _ in range(30):
        amplitude, phase, steady = b.settle(z0, 1e-9)
        if steady and abs(amplitude - o.amp) < 1e-7 * o.amp:
            held = True
            break
        slope = (amplitude - last[1]) / (z0 - last[0]) if z0 != last[0] else 1.0
        slope = slope if 0.1 < slope < 5 else 1.0
        last = (z0, amplitude)
        z0 += (o.amp - amplitude) / slope
    lag = np.radians(90 - phase)
    in_phase = o.u0 * np.cos(lag) - amplitude * (1 - o.w**2)
    branch = ("repulsive" if in_phase > 0 else "attractive") if held else "none"
    return z0, dict(
        tip_offset=z0 * 1e-9,
        phase=phase,
        amplitude=amplitude * 1e-9,
        branch=branch,
        periods=b.periods,
        start=start * 1e-9,
        end=end * 1e-9,
        jumps=jumps,
        unsteady=[float(u) * 1e-9 for u in unsteady],
    )


def main():
    data = []
    only = sys.argv[1] if len(sys.argv) > 1 else ""
    for name, regime, change in CASES:
        if only not in name:
            continue
        started = time.time()
        case = DEFAULTS | change
        found, complete = Oscillator(case).orbits()
        z0, engaged = engage(case)
        print(
            f"{name}: {engaged['branch']}, {engaged['periods']} periods, {len(engaged['jumps'])} jumps, {len(engaged['unsteady'])} unsteady {np.round(np.array(engaged['unsteady'])[[0, -1]] * 1e9, 4) if engaged['unsteady'] else ''}, {time.time() - started:.0f} s",
            flush=True,
        )
        for j in engaged["jumps"]:
            print(
                "   jump",
                {k: v if k in ("steady",) else round(v * (1e9 if abs(v) < 1e-5 else 1), 4) for k, v in j.items()},
            )
        engaged["orbit"] = None
        if z0 is not None:
            i = int(np.argmin([abs(f["tip_offset"] - engaged["tip_offset"]) for f in found])) if found else None
            if i is not None:
                dz, dphase = engaged["tip_offset"] - found[i]["tip_offset"], engaged["phase"] - found[i]["phase"]
                if abs(dz) < 5e-12 and abs(dphase) < 0.05:
                    engaged["orbit"] = i
                print(
                    f"   z0 {z0:.5f} phase {engaged['phase']:.5f}; exact orbit {i} of {len(found)}: dz0 {dz * 1e12:.4f} pm, dphase {dphase:.5f}"
                    f" floquet {found[i]['floquet']:.4f}",
                    flush=True,
                )
        for f in found:
            for key in ("x", "closure", "det_error", "z0_error_pm", "phase_error"):
                del f[key]
            f["multipliers"] = [[float(m.real), float(m.imag)] for m in f["multipliers"]]
            f.update({key: float(v) for key, v in f.items() if isinstance(v, np.floating)})
        if engaged["branch"] == "none":
            engaged |= dict(tip_offset=None, phase=None, amplitude=None, orbit=None)
        engaged = {key: float(v) if isinstance(v, np.floating) else v for key, v in engaged.items()}
        engaged["jumps"] = [{k: v if k == "steady" else float(v) for k, v in j.items()} for j in engaged["jumps"]]
        data.append(
            {"name": name, "regime": regime} | case | {"engaged": engaged, "orbits": found, "complete": complete}
        )
    if not only:
        OUT.write_text(json.dumps(data, indent=1) + "\n")


if __name__ == "__main__":
    main()
