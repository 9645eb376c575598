"""Makes tests/data/folds.json: saddle-node points of distance curves A(z0) and frequency responses A(omega): DMT
with long range, and where curves of the laws with hysteresis end.

    python tests/reference/make_folds.py [word]

Curves are followed from the free oscillation and from every orbit that averaging gives at some amplitudes, so that
closed curves that are not joined to the free oscillation ("joined": false) are seen too; a fold is the root of (change
over a period, det(I - M)) and is checked against the extremum of a polynomial through the parameter over the phase
(truth_folds.py).

Per case: parameters (SI), sweep "distance" (frequency_ratio given) or "frequency" (tip_offset given), folds:
[tip_offset, frequency_ratio, amplitude, phase [degree], indentation (max d), setpoint (amplitude over free amplitude at
the drive), joined, kind ("stable above": the stable orbits next to the fold have the larger amplitude, else "stable
below"; "none": neither side is stable), uncertainty = [swept parameter (m or 1), amplitude (m)]: the largest of last
step, change when the integrator is 10 times less exact, difference from the polynomial].  curves: tip offset or
frequency ratio, amplitude, phase, stable along every curve followed, thinned, as a picture of it. Each curve has ends:
how "grazing" (the orbit of one contact per period, or of none, just touches: with a law that has hysteresis or jumps at
d = 0 the curve stops there), "range", "closed", "start" or "stops" (not followed farther: often the tip is in contact
at the section); and where. Turns of a distance curve are where its amplitude is largest or smallest. Folds at tip offsets below `range` of the free amplitude are not looked for.
"""

import json
import math
import pathlib
import sys
import time

import numpy as np
from make_laws import BASE, FIG3, HARD, SMALL, SOFT, W7
from scipy.integrate import solve_ivp
from truth_folds import BEGIN, Curve
from truth_map import AL0, D0, SZ, U0, law
from truth_orbits import Lost, facts, parameters, shoot
from truth_seeds import averaged, free_state

HERE = pathlib.Path(__file__).parent
OUT = (HERE.parent / "data" if (HERE.parent / "data").is_dir() else HERE) / "folds.json"
FIG4 = FIG3 | dict(quality_factor=1 / 0.0012, free_amplitude=0.152e-9 / 0.0012)
# Its amplitude turns 40 fm from where its tip offset does.
SHARP = BASE | dict(stiffness=1.13, quality_factor=253.0, free_amplitude=7.43e-9, tip_radius=10.3e-9, modulus=2.69e8, adhesion=0.108,
                    damping=0.00395, decay_length=0.3e-9)  # fmt: skip
CASES = [
    ("fig 3 lever", FIG3, "distance"),
    ("bistable at resonance", W7, "distance"),
    ("small amplitude", SMALL, "distance"),
    ("hard", HARD, "distance"),
    ("sharp turn", SHARP, "distance"),
    ("soft", SOFT, "distance"),
    ("soft, more adhesion", SOFT | dict(adhesion=0.05), "distance"),
    ("bistable, undamped, drive 1.002", W7 | dict(damping=0.0, frequency_ratio=1.002, adhesion=0.1), "distance"),
    (
        "bias, k 0.3, Q 30",
        BASE | dict(stiffness=0.3, bias=1.0, quality_factor=30.0, adhesion=0.01, modulus=2e8),
        "distance",
    ),
    ("fig 3 lever, 140 nm", FIG3 | dict(tip_offset=140e-9), "frequency"),
    ("fig 4 lever, 110 nm", FIG4 | dict(tip_offset=110e-9), "frequency"),
    ("bistable, 32 nm", W7 | dict(tip_offset=32e-9), "frequency"),
    ("soft, 30 nm", SOFT | dict(tip_offset=30e-9), "frequency"),
    ("jkr, adhesion 0.1", W7 | dict(law="jkr", adhesion=0.1), "distance"),
    ("jkr, adhesion 0.1, no long range", W7 | dict(law="jkr", adhesion=0.1, decay_length=None), "distance"),
    ("jkr, adhesion 0.2", W7 | dict(law="jkr"), "distance"),
    ("jkr soft", SOFT | dict(law="jkr", free_amplitude=60e-9), "distance"),
    ("jkr fig 3 lever", FIG3 | dict(law="jkr"), "distance"),
    ("maugis, adhesion 0.1", W7 | dict(law="maugis", adhesion=0.1), "distance"),
    ("neck, no long range", W7 | dict(law="neck", neck_length=0.9e-9, decay_length=None, adhesion=0.1), "distance"),
]
LEAST = 0.05


def propagate(p, om, begin, d, v, z0, end):
    """State at another drive angle (a start only)."""

    def rate(th, y):
        d = y[0] - z0
        m = law(1, math.sqrt(d), p) if d >= 0 else law(0, d, p)
        return [y[1] / om, (p[U0] * math.cos(th) - 2 * (p[AL0] + m[5]) * y[1] - y[0] - m[3]) / om]

    while end < begin:
        end += 2 * math.pi
    s = solve_ivp(rate, (begin, end), [d + z0, v], method="DOP853", rtol=1e-10, atol=1e-10, max_step=0.03)
    return s.y[0, -1] - z0, s.y[1, -1]


def beginnings(p, om, free, case, sweep):
    """((d, v), z0, omega, joined) to follow curves from."""
    if sweep == "distance":
        far = free + 30 * p[D0]
        yield free_state(p, om, far, BEGIN)[1:], far, om, True
        for s in (0.98, 0.9, 0.75, 0.6, 0.5, 0.3):
            yield from ((*o, False) for o in at_amplitude(p, om, s * free, None))
    else:
        z0 = case["tip_offset"] * 1e9
        half = 0.5 / case["quality_factor"]
        yield free_state(p, 1 - 15 * half, z0, BEGIN)[1:], z0, 1 - 15 * half, True
        for om in 1 + half * np.array([-3, -1.5, -0.6, 0, 1.0, 2.0, 4.0]):
            # averaged orbits at this frequency whose tip offset is the one wanted: scan amplitudes
            f = p[U0] / abs(complex(1 - om * om, 2 * p[AL0] * om))
            grid = np.linspace(0.3, 0.999, 60) * f
            points = [(a, o) for a in grid for o in averaged(p, om, a, n=300)]
            for a, (zz, lag, mean) in points:
                if abs(zz - z0) < 0.02 * f:
                    yield from ((*o, False) for o in at_amplitude(p, om, a, (zz, lag, mean), z0))


def at_amplitude(p, om, a, start=None, z0=None):
    for zz, lag, mean in [start] if start else averaged(p, om, a):
        try:
            z = z0 if z0 is not None else zz
            x, *_ = shoot(
                p,
                om,
                0,
                lag - math.pi,
                [mean - a - z, 0.0],
                z,
                target=None if z0 is not None else a,
                tol=1e-11,
                enough=1e-7,
            )
            yield propagate(p, om, lag - math.pi, x[0], x[1], x[2], BEGIN), x[2], om
        except (Lost, np.linalg.LinAlgError):
            continue


def follow_all(p, om, free, case, sweep):
    """[(curve, points, joined)]."""
    kind = 2 if sweep == "distance" else 3
    out = []
    half = 0.5 / case["quality_factor"]
    for u, z0, w, joined in beginnings(p, om, free, case, sweep):
        c = Curve(p, kind, om if kind == 2 else case["tip_offset"] * 1e9)
        par = z0 if kind == 2 else w
        if kind == 3:
            c.unit = np.array([free, free, half * 2])
        try:
            y, *_ = shoot(p, w, 0, BEGIN, u, z0)
            y = np.array([y[0], y[1], par])
            h = c.at(y)[2]
        except (Lost, np.linalg.LinAlgError):
            continue
        if any(
            min(math.hypot((q[0][2] - par) / c.unit[2], abs(q[1] - h) / free) for q in pts) < 0.015 for _, pts, _ in out
        ):
            continue
        if kind == 2:
            stop = lambda x, h: x[2] < LEAST * free or x[2] > free + 35 * p[D0]  # noqa: E731
        else:
            stop = lambda x, h: abs(x[2] - 1) > 20 * half  # noqa: E731
        pts = c.follow(y, 1 if kind == 3 else -1, stop=stop, points=2500, biggest=0.01)
        ends = ["start", c.end]
        if not joined and c.end != "closed":
            pts = c.follow(y, -1 if kind == 3 else 1, stop=stop, points=2500, biggest=0.01)[::-1][:-1] + pts
            ends[0] = c.end
        elif not joined:
            ends[0] = "closed"
        c.ends = ends
        out.append((c, pts, joined))
    return out


def stable(c, x):
    j = c.at(x)[1]
    return bool(np.max(np.abs(np.linalg.eigvals(j[:, :2] + np.eye(2)))) < 1)


def describe(c, f, p, case, om, joined, before, after):
    z0, w = (f[2], om) if c.free == 2 else (c.other, f[2])
    h = c.at(f)[2]
    step = c.fold(f)[1]
    f2, _ = c.fold(f, tol=1e-13)
    change = [abs(f2[2] - f[2]), abs(abs(c.at(f2)[2]) - abs(h))]
    best = None
    for width in (0.03, 0.01, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5):
        try:
            got = c.chebyshev(f, width)
        except (Lost, np.linalg.LinAlgError, IndexError):
            continue
        if best is None or got[2] < best[2]:
            best = got
    check = [abs(best[0] - f[2]), abs(best[1] - abs(h))] if best else [math.nan, math.nan]
    out = facts(p, case, w, 0, BEGIN, np.array([f[0], f[1], z0]))
    unit = 1e-9 if c.free == 2 else 1.0
    free = p[U0] / abs(complex(1 - w * w, 2 * p[AL0] * w))
    side = {abs(c.at(q)[2]) > abs(h): stable(c, q) for q in (before, after)}
    kind = "none" if not any(side.values()) else ("stable above" if side.get(True) else "stable below")
    return {
        "tip_offset": z0 * 1e-9,
        "frequency_ratio": w,
        "amplitude": abs(h) * 1e-9,
        "phase": out["phase"],
        "indentation": out["indentation"],
        "setpoint": abs(h) / free,
        "joined": joined,
        "kind": kind,
        "uncertainty": [max(change[0], check[0]) * unit, max(change[1], check[1]) * 1e-9],
        "_parts": dict(step=step, change=change, check=check, misfit=best[2] if best else None),
    }


def turns_of(c, pts):
    """Where the amplitude along a curve is largest or smallest, from polynomials of the phase beside it."""
    sizes, out = [abs(q[1]) for q in pts], []
    for i in range(1, len(pts) - 1):
        if (sizes[i] - sizes[i - 1]) * (sizes[i + 1] - sizes[i]) >= 0:
            continue
        best = None
        for width in (0.03, 0.01, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5):
            try:
                got = c.chebyshev(pts[i][0], width, of_amplitude=True)
            except (Lost, np.linalg.LinAlgError, IndexError):
                continue
            if best is None or got[2] < best[2]:
                best = got
        if best and best[2] < 1e-3:
            out.append({"tip_offset": best[0] * 1e-9, "amplitude": best[1] * 1e-9, "misfit": best[2]})
            print("    turn", out[-1], flush=True)
    return out


def end_of(c, q, how, p, case, om):
    x, h = q[0], q[1]
    z0, w = (x[2], om) if c.free == 2 else (c.other, x[2])
    try:
        depth = facts(p, case, w, 0, BEGIN, np.array([x[0], x[1], z0]))["indentation"]
    except Lost:
        depth = None
    if how == "stops" and depth is not None and abs(depth) < 2e-5 * 1e-9 * p[SZ]:
        how = "grazing"
    out = {
        "how": how,
        "swept": float(x[2] * (1e-9 if c.free == 2 else 1.0)),
        "amplitude": abs(h) * 1e-9,
        "phase": 90 - math.degrees(np.angle(h)),
        "indentation": depth,
        "contacts": int(q[3]),
        "stable": stable(c, x),
    }
    print("   end", *(f"{k} {v:.9g}" if isinstance(v, float) else f"{k} {v}" for k, v in out.items()), flush=True)
    return out


def folds_of(case, sweep):
    p, om, free = parameters(case)
    found, pictures = [], []
    for c, pts, joined in follow_all(p, om, free, case, sweep):
        det = np.array([q[2] for q in pts])
        for i in np.nonzero(det[1:] * det[:-1] < 0)[0]:
            start = pts[i][0] if abs(det[i]) < abs(det[i + 1]) else pts[i + 1][0]
            try:
                f, _ = c.fold(start)
            except (Lost, np.linalg.LinAlgError) as e:
                print("   no fold", start, e)
                continue
            if any(abs(f[2] - g[2]) < 1e-9 * g[2] and abs(f[0] - g[0]) < 1e-6 * free for g, _ in found):
                continue
            d = describe(c, f, p, case, om, joined, pts[max(i - 1, 0)][0], pts[min(i + 2, len(pts) - 1)][0])
            print("   ", *(f"{k} {v:.12g}" if isinstance(v, float) else f"{k} {v}" for k, v in d.items()), flush=True)
            d.pop("_parts")
            found.append((f, d))
        keep = pts[:: max(1, len(pts) // 150)]
        unit = 1e-9 if c.free == 2 else 1.0
        pictures.append(
            {
                "joined": joined,
                "turns": turns_of(c, pts) if sweep == "distance" else [],
                "ends": [end_of(c, q, how, p, case, om) for q, how in zip((pts[0], pts[-1]), c.ends)],
                "swept": [float(f"{q[0][2] * unit:.10g}") for q in keep],
                "amplitude": [float(f"{abs(q[1]) * 1e-9:.8g}") for q in keep],
                "phase": [float(f"{90 - math.degrees(np.angle(q[1])):.6g}") for q in keep],
                "stable": [stable(c, q[0]) for q in keep],
            }
        )
        print(f"   curve of {len(pts)} points, joined {joined}, {pts[0][0][2]:.6g} .. {pts[-1][0][2]:.6g}", flush=True)
    return [d for _, d in found], pictures


def main(word=""):
    done = {c["name"]: c for c in json.loads(OUT.read_text())} if OUT.exists() else {}
    for name, case, sweep in CASES:
        if word not in name:
            continue
        print(name, flush=True)
        t = time.time()
        folds, pictures = folds_of(case, sweep)
        case = {k: v for k, v in case.items() if k != "setpoint"}
        done[name] = {"name": name, "sweep": sweep, **case, "range": LEAST, "folds": folds, "curves": pictures}
        OUT.write_text(json.dumps([done[n] for n, *_ in CASES if n in done], indent=1))
        print(f"   {len(folds)} folds, {time.time() - t:.1f} s", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
