"""Makes tests/data/jumps.json: quasi-static sweeps of tip offset or drive frequency by brute force in time.

    python tests/reference/make_jumps.py [word]

The state (mode, d, v once per drive period) is carried from step to step; after each step of the tip offset or the
frequency, made gradually over 2 Q periods, whole periods are integrated (truth_map.py, contact located) until the state
no longer moves, or, if it never comes to rest, for a fixed time. Nothing is assumed of orbits, folds or averaging.  A
step that changes the first harmonic by more than it should is taken back and divided, down to `resolution`; what then
changes abruptly is a jump.

Per sweep: parameters (SI), sweep "distance" or "frequency", direction ("approach", "retract", "up", "down"), resolution
(m, or relative frequency), jumps: [at (the bracket: last value before, first value after), amplitude and phase before
and after (first harmonic, mean over periods if it never settles), touching_before/after (contacts per period),
steady_before/after], end: where the sweep turned or stopped, and branch: [swept value, amplitude, phase, contacts per
period, steady] at the steps taken, thinned. A retract sweep starts from the state in which the approach before it
ended.  "Steady" means repeating every period. gradual: steps were spread over 2 Q periods (false: sudden steps, earlier
version; next to grazing of a law with hysteresis they touch some pm too early; at smooth folds no difference within the
resolution).  A sweep stops after LIMIT seconds; end says where.
"""

import json
import math
import pathlib
import sys
import time

import numpy as np
from make_folds import FIG4
from make_laws import FIG3, HARD, SMALL, SOFT, W7
from numba import njit
from truth_map import D0, DREL, parameters, period
from truth_seeds import free_state

HERE = pathlib.Path(__file__).parent
OUT = (HERE.parent / "data" if (HERE.parent / "data").is_dir() else HERE) / "jumps.json"
TOL = 1e-9
LIMIT = 150.0  # seconds a sweep may take
REST = 3e-7
BEGIN = -0.5 * math.pi
JKR = dict(law="jkr")
CASES = [
    ("fig 3 lever", FIG3, "distance", 1.0, 0.8),
    ("small amplitude", SMALL, "distance", 0.05, 0.3),
    ("hard", HARD, "distance", 0.1, 0.6),
    ("soft", SOFT, "distance", 0.2, 0.3),
    ("jkr air", W7 | JKR | dict(adhesion=0.1), "distance", 0.2, 0.4),
    ("jkr, no long range", W7 | JKR | dict(adhesion=0.1, decay_length=None), "distance", 0.2, 0.4),
    ("jkr soft", SOFT | JKR | dict(free_amplitude=60e-9), "distance", 0.3, 0.4),
    ("fig 3 lever, 140 nm", FIG3 | dict(tip_offset=140e-9), "frequency", 2e-5, 0.9965, 1.0035),
    ("bistable, 32 nm", W7 | dict(tip_offset=32e-9), "frequency", 4e-5, 0.995, 1.008),
    ("soft, 30 nm", SOFT | dict(tip_offset=30e-9), "frequency", 1e-4, 0.988, 1.012),
    ("fig 4 lever, 110 nm", FIG4 | dict(tip_offset=110e-9), "frequency", 1e-5, 0.9985, 1.0012),
    ("jkr, 32 nm", W7 | JKR | dict(adhesion=0.1, tip_offset=32e-9), "frequency", 4e-5, 0.995, 1.008),
]


@njit(cache=True)
def run(mode, d, v, begin, p, z0, om, tol, periods, trail):
    y, seen = np.empty(5), np.empty((3, 2))
    for i in range(periods):
        mode, n = period(0, mode, d, v, begin, p, z0, om, tol, y, seen)
        if mode < 0:
            return mode, d, v
        d, v = y[1], y[2]
        trail[i, 0], trail[i, 1], trail[i, 2], trail[i, 3], trail[i, 4] = d, v, y[3], y[4], n
    return mode, d, v


class Tip:
    def __init__(self, case):
        self.case = case
        self.p, self.om, self.free = parameters(case)
        self.q = case["quality_factor"]
        self.periods = 0
        self.block = int(max(8, self.q / 2))
        self.rest = 15 * self.q + 500  # periods of moving about without a pause after which a state never rests
        self.most = 400_000  # periods given to one that creeps

    def settle(self, z0):
        """Periods until the state rests.  Sets h, contacts, steady."""
        spent, mode, d, v = 0, *self.s
        tail, restless = [], 0
        while True:
            trail = np.empty((self.block, 5))
            mode, d, v = run(mode, d, v, BEGIN, self.p, z0, self.om, TOL, self.block, trail)
            if mode < 0:
                raise ArithmeticError("integration failed")
            spent += self.block
            moves = np.abs(np.diff(trail[:, 2:4], axis=0)).max(axis=0).max()  # most a harmonic changes in a period
            tail = [*tail[-19:], trail[:, 2:5]]
            change = np.abs(trail[-1, 2:4] - trail[0, 2:4]).max()
            if max(change, moves) < REST * self.free:
                steady = True
                break
            restless = restless + self.block if moves > 0.02 / self.q * self.free else 0
            if restless > self.rest or spent > self.most:
                steady = False
                break
        self.s, self.steady = (mode, d, v), steady
        self.periods += spent
        if steady:
            self.h, self.contacts = complex(trail[-1, 2], trail[-1, 3]), float(trail[-1, 4])
        else:
            every = np.concatenate(tail)
            self.h, self.contacts = complex(every[:, 0].mean(), every[:, 1].mean()), float(every[:, 2].mean())

    def move(self, before, after):
        """The tip offset changes in 2 Q equal parts, one a period, each at constant z: a sudden step would kick the tip into the surface."""
        n = int(2 * self.q)
        trail = np.empty((1, 5))
        for i in range(n):
            z0 = before + (after - before) * (i + 1) / n
            self.shift((before - after) / n)
            mode, d, v = run(*self.s, BEGIN, self.p, z0, self.om, TOL, 1, trail)
            if mode < 0:
                raise ArithmeticError("integration failed")
            self.s = (mode, d, v)
        self.periods += n

    def shift(self, by):
        mode, d, v = self.s
        d += by
        if mode == 0 and d > 0:
            mode = 1
        elif mode > 0:
            mode = (1 if d >= 0 else 2) if d > self.p[DREL] and d != 0 else 0
            if mode == 2 and self.p[DREL] == 0:
                mode = 0
        self.s = (mode, d, v)

    def keep(self):
        return self.s, self.h, self.contacts, self.steady

    def back(self, kept):
        self.s, self.h, self.contacts, self.steady = kept


def readings(h):
    return abs(h), 90 - math.degrees(math.atan2(h.imag, h.real))


def sweep(tip, start, end, step, resolution, set_to, unit, expected):
    """Go from start to end; jumps and branch.  expected(step): how much the harmonic may change in a step without being looked at."""
    value, jumps, branch = start, [], []
    sign, full, bad = math.copysign(1, end - start), step, None
    clock = time.time()
    while (end - value) * sign > 1e-12 * abs(end):
        kept = tip.keep()
        step = min(step, abs(end - value))
        h0, steady0 = tip.h, tip.steady
        set_to(value, value + sign * step)
        change = abs(tip.h - h0)
        large = change > expected(step) or tip.steady != steady0
        if large and step > resolution and (steady0 or tip.steady):
            tip.back(kept)
            if set_to.undo:
                set_to.undo(value)
            bad = value + sign * step
            step = max(step / 2, resolution)
            continue
        if large and steady0 and (change > 5 * expected(0) or not tip.steady):
            (a0, f0), (a1, f1) = readings(h0), readings(tip.h)
            jumps.append(
                dict(bracket=[value * unit, (value + sign * step) * unit], amplitude_before=a0 * 1e-9, amplitude_after=a1 * 1e-9,
                     phase_before=f0, phase_after=f1, contacts_before=kept[2], contacts_after=tip.contacts,
                     steady_before=steady0, steady_after=tip.steady)
            )  # fmt: skip
            print(f"      jump {value + 0.5 * sign * step:.9g} A {a0:.6g} -> {a1:.6g}  phase {f0:.4g} -> {f1:.4g} contacts {kept[2]:.3g} ->"
                  f" {tip.contacts:.3g} steady {steady0} -> {tip.steady}", flush=True)  # fmt: skip
        elif large and tip.steady and not steady0:
            a1, f1 = readings(tip.h)
            print(f"      settles at {value:.7g}: A {a1:.6g} phase {f1:.4g} contacts {tip.contacts}", flush=True)
        value += sign * step
        branch.append([value * unit, readings(tip.h)[0] * 1e-9, readings(tip.h)[1], tip.contacts, tip.steady])
        step = min(step * 2, full)
        if bad is not None:  # halve towards the value that was too far
            left = (bad - value) * sign
            bad, step = (None, full) if left < 1e-3 * resolution else (bad, min(step, max(left / 2, resolution)))
        if time.time() - clock > LIMIT:
            print("      out of time", flush=True)
            break
    return jumps, branch, value


def thin(branch, most=150):
    keep = branch[:: max(1, len(branch) // most)]
    return [
        [float(f"{b[0]:.10g}"), float(f"{b[1]:.7g}"), float(f"{b[2]:.6g}"), round(b[3], 4), bool(b[4])] for b in keep
    ]


def distance(name, case, step, deepest):
    tip = Tip(case)
    far = math.ceil(tip.free + (12 if case["decay_length"] else 3) * (tip.p[D0] if case["decay_length"] else 1.0))
    tip.s = free_state(tip.p, tip.om, far, BEGIN)
    tip.settle(far)

    def set_to(before, after):
        tip.move(before, after)
        tip.settle(after)

    set_to.undo = None
    out, value = [], far
    for direction, end in (("approach", deepest * tip.free), ("retract", far)):
        print(f"   {direction}", flush=True)
        jumps, branch, value = sweep(tip, value, end, step, 5e-4, set_to, 1e-9, lambda s: 8 * s + 3e-3 * tip.free)
        out.append(dict(name=name, sweep="distance", **case, direction=direction, gradual=True, resolution=5e-13, step=step * 1e-9, jumps=jumps,
                        end=value * 1e-9, branch=thin(branch)))  # fmt: skip
    return tip, out


def frequency(name, case, step, low, high):
    out = []
    for direction, start, end in (("up", low, high), ("down", high, low)):
        print(f"   {direction}", flush=True)
        tip = Tip(case)
        z0 = case["tip_offset"] * 1e9
        tip.om = start
        tip.s = free_state(tip.p, start, z0, BEGIN)
        if tip.s[1] > 0:
            tip.s = (1, *tip.s[1:])
        tip.settle(z0)

        def set_to(before, after, tip=tip, z0=z0):
            n, trail = int(2 * tip.q), np.empty((1, 5))
            for i in range(n):
                tip.om = before + (after - before) * (i + 1) / n
                tip.s = run(*tip.s, BEGIN, tip.p, z0, tip.om, TOL, 1, trail)
            tip.periods += n
            tip.om = after
            tip.settle(z0)

        def undo(before, tip=tip):
            tip.om = before

        set_to.undo = undo
        width = 0.5 / tip.q
        jumps, branch, value = sweep(
            tip, start, end, step, 5e-7, set_to, 1.0, lambda s: (1.2 * s / width + 3e-3) * tip.free
        )
        out.append(dict(name=name, sweep="frequency", **case, direction=direction, gradual=True, resolution=5e-7, step=step, jumps=jumps, end=value,
                        branch=thin(branch)))  # fmt: skip
    return tip, out


def main(word=""):
    done = json.loads(OUT.read_text()) if OUT.exists() else []
    for name, case, kind, *rest in CASES:
        if (word != "rest" and word not in name and word != kind) or (
            word == "rest" and any((d["name"], d["sweep"]) == (name, kind) for d in done)
        ):
            continue
        print(name, kind, flush=True)
        t = time.time()
        tip, out = (distance if kind == "distance" else frequency)(name, case, *rest)
        done = [d for d in done if (d["name"], d["sweep"]) != (name, kind)]
        for o in out:
            o.pop("setpoint")
            if kind == "frequency":
                o.pop("frequency_ratio")
            done.append(o)
        OUT.write_text(json.dumps(done, indent=1))
        print(f"   {tip.periods} periods, {time.time() - t:.1f} s", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
