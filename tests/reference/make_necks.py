"""Makes tests/data/necks.json: Maugis-Dugdale contacts and DMT contacts with a neck, engaged in time; and compares.

    python tests/reference/make_necks.py make [NUMBER ...]
    python tests/reference/make_necks.py curves
    python tests/reference/make_necks.py compare [SOLVER]

Integration, lowering, feedback and what is stated of a setpoint are those of make_polymers.py, where they are explained;
nothing is shared with phasemap. Here are the two other laws with hysteresis, as published: a neck holds the tip with
2 pi w R down to its length; Maugis' equations (theory, Eq. (model-9)) are solved at each depth, with contact at d = 0
on the branch of the largest radius, and release where d turns or the radius is 0. Where a loop of contact and release
would create energy beside the long-range force, contact ends at d = 0.

Materials.  20 MPa to 5 GPa, 0.02 to 0.1 J/m2; levers, tips and damping as in make_polymers.py. Maugis: lambda from 0.1 to
5, all evenly in their logarithm, which gives the range h0 of adhesion; those with 0.1 to 3 nm are kept. One in three has
that decay length of the long-range force too (`range` null), one in three 0.3 nm, one in three none. Necks: 0.2 to 5 nm
long; a decay length of 0.3 nm for two in three, none for the others. Sticky ones have up to 300 MPa, lambda above 1,
and necks of 2 to 10 nm; stiff ones 10 to 100 GPa, and 0.3 nm for both ranges of Maugis, which leaves some without neck.

Steps are those of make_polymers.py. The phase of 31 at 0.7 is off by 1.2e-4 degree (made again with 3e-12); of the others
none was made again with finer steps. SEVERAL are the two that differed from phasemap when they were first compared.

`make` engages STORED, or the cases of these numbers (0 to 85 are drawn); of SEVERAL it asks what other ways lead to, for
which pattern of taps they hold goes with it. `curves` compares the forces of all, and `compare` what is held.
"""

import ctypes
import json
import math
import sys

import numpy as np
from make_polymers import DMT, MAUGIS, OUT, POISSON, Tip, compiled, engage, judged, near, write
from scipy.integrate import quad
from scipy.optimize import brentq

NECKS = OUT.with_name("necks.json")
SEED, SETPOINTS = 20261123, (0.9, 0.7, 0.5)
COUNTS = {"any": 60, "sticky": 20, "stiff": 6}
STORED = (0, 1, 4, 6, 10, 13, 18, 21, 31, 64, 80, 83, 8, 14, 20, 61, 65, 77)  # 12 of Maugis, then 6 necks
SEVERAL = ((61, 0.5), (64, 0.9))


def dugdale(library, lam, x):
    """Depth and force in Maugis' units, and d depth / dx, at cos x = a / c."""
    found = [ctypes.c_double() for _ in range(3)]
    library.dugdale(lam, x, *map(ctypes.byref, found))
    return [one.value for one in found]


def stiffness_of(case):
    return 4 / 3 * case["modulus"] / (1 - POISSON**2)


def tip(library, case):
    """What `Tip` has of the contact, in nm."""
    stiff, radius, w, k = stiffness_of(case), case["tip_radius"], case["adhesion"], case["stiffness"]
    if case["contact"] == "neck":
        return {
            "law": DMT, "force": stiff * math.sqrt(radius) / k * 1e-4 * math.sqrt(0.1), "first": 0.0,
            "depth": 2 * math.pi * w * radius / k * 1e9, "release": -case["neck_length"] * 1e9,
        }  # fmt: skip
    lam = 2 * w / (case["range"] or case["decay_length"]) * (radius / (math.pi * w * stiff**2)) ** (1 / 3)
    depth = (math.pi**2 * w**2 * radius / stiff**2) ** (1 / 3) * 1e9
    end = 0.5 * math.pi
    turns = [x for x in np.linspace(0.01, end, 2000) if dugdale(library, lam, x)[2] > 0]
    fold = brentq(lambda x: dugdale(library, lam, x)[2], turns[0] - 0.01, turns[0], xtol=1e-15) if turns else end
    first = brentq(lambda x: dugdale(library, lam, x)[0], 1e-3, fold, xtol=1e-15)
    release = dugdale(library, lam, fold)[0] * depth
    force = math.pi * w * radius / k * 1e9
    if case["decay_length"]:
        # what the contact gives from 0 to release, and the long-range force takes, over pi w R [nm]
        given, _ = quad(lambda x: math.prod(dugdale(library, lam, x)[1:]), first, fold, epsabs=1e-13)
        reach = case["decay_length"] * 1e9
        took = 2 * reach * (1 - 1 / (1 - release / reach))
        if given * depth < took:
            release, fold = 0.0, first
    return {
        "law": MAUGIS, "force": force, "depth": depth, "lam": lam, "release": release, "first": first, "fold": fold
    }  # fmt: skip


def draw(count, contact, box="any"):
    rng, cases = np.random.default_rng([SEED, contact == "neck", *map(ord, box * (box != "any"))]), []
    moduli = {"any": (20e6, 5e9), "sticky": (20e6, 300e6), "stiff": (10e9, 100e9)}[box]

    def between(low, high):
        return float(f"{math.exp(rng.uniform(math.log(low), math.log(high))):.4g}")

    while len(cases) < count:
        case = {
            "contact": contact, "modulus": between(*moduli), "adhesion": between(0.02, 0.1), "damping": between(0.002, 0.05),
            "tip_radius": between(5e-9, 20e-9), "stiffness": between(2, 40), "resonance_frequency": between(60e3, 350e3),
            "quality_factor": between(100, 600), "free_amplitude": between(10e-9, 100e-9),
            "decay_length": 0.3e-9 if rng.uniform() < 2 / 3 else None, "poisson_ratio": POISSON, "damping_exponent": 0.5,
        }  # fmt: skip
        if contact == "neck":
            case["neck_length"] = between(*((2e-9, 10e-9) if box == "sticky" else (0.2e-9, 5e-9)))
        elif box == "stiff":
            case |= {"decay_length": 0.3e-9, "range": None}
        else:
            w, lam = case["adhesion"], between(1 if box == "sticky" else 0.1, 5)
            unit = (case["tip_radius"] / (math.pi * w * stiffness_of(case) ** 2)) ** (1 / 3)
            case["range"] = float(f"{2 * w / lam * unit:.4g}")
            if not 0.1e-9 < case["range"] < 3e-9:
                continue
            if case["decay_length"] and rng.uniform() < 0.5:
                case |= {"decay_length": case["range"], "range": None}
        cases.append(case)
    return cases


def scope_of(case):
    import phasemap as pm

    law = pm.interaction.Neck(case["neck_length"]) if case["contact"] == "neck" else case["contact"]
    if case.get("range"):
        law = pm.interaction.MaugisDugdale(case["range"])
    return pm.Microscope(
        pm.Cantilever(case["stiffness"], case["resonance_frequency"], case["quality_factor"]),
        pm.Tip(case["tip_radius"]),
        pm.Drive(case["free_amplitude"], case.get("frequency_ratio", 1.0) * case["resonance_frequency"]),
        pm.Interaction(law, case["decay_length"], case.get("damping_exponent", 0.5)),
    )


def material_of(case):
    import phasemap as pm

    return pm.Material(case["modulus"], case["adhesion"], case["damping"], poisson_ratio=POISSON)


def all_drawn():
    """Two of Maugis, then a neck, and so on; then the sticky ones, in turn, and the stiff ones."""
    cases = []
    for box, count in COUNTS.items():
        maugis, necks = iter(draw(count, "maugis", box)), iter(draw(count, "neck", box))
        order = {"any": (maugis, maugis, necks), "sticky": (maugis, necks), "stiff": (maugis,)}[box]
        cases += [next(order[i % len(order)]) for i in range(count)]
    return cases


def curves():
    """Print the largest difference of forces, over 2 pi w R, at depths around release and contact."""
    import phasemap as pm

    library, worst = compiled(), 0.0
    for i, case in enumerate(all_drawn()):
        held = Tip(reach=(case["decay_length"] or 0.0) * 1e9, **tip(library, case))
        held.pull = 2 * math.pi * case["adhesion"] * case["tip_radius"] / case["stiffness"] * 1e9 * bool(held.reach)
        span = max(-held.release, 0.1)
        around = [-1.0001, -0.9999, -0.999, -0.99, -1e-6, 0, 1e-6, 30]
        depths = np.unique(np.concatenate((np.linspace(-1.5, 3, 50), around)) * span)
        found = pm.force_curve(material_of(case), scope_of(case), depths * 1e-9)
        unit = 2 * math.pi * case["adhesion"] * case["tip_radius"]
        for direction, end in (("approach", 0.0), ("retract", held.release)):
            own = np.array([
                library.contact(ctypes.byref(held), d) if d >= end else library.away(ctypes.byref(held), d) for d in depths
            ]) * case["stiffness"] * 1e-9  # fmt: skip
            off = np.abs(found.force.sel(direction=direction).values - own) / np.maximum(unit, np.abs(own))
            worst = max(worst, off.max())
            if off.max() > 1e-9:
                at = depths[off.argmax()]
                print(i, direction, f"lambda {held.lam:.4g} {off.max():.2e} at {at:.6g} nm of {held.release:.6g}")
    print(f"{len(all_drawn())} materials, largest difference {worst:.1e}")


def made(library, number):
    case = {"number": number} | all_drawn()[number]
    whole, found = case | {"tip": tip(library, case)}, []
    for held, _ in engage(library, whole, SETPOINTS):
        if (number, held["setpoint"]) in SEVERAL:
            held["near"] = near(library, whole, held["setpoint"])
        found.append(held)
    return case | {"setpoints": found}


def make(*numbers):
    library, cases = compiled(), []
    for number in numbers:
        cases.append(made(library, number))
        print(number, *((held["setpoint"], held.get("period"), held.get("phase")) for held in cases[-1]["setpoints"]))
        write(cases, NECKS)


def compare(solver="auto"):
    """Print how often phasemap agrees, and where it does not."""
    import phasemap as pm

    table, worst = {}, [0.0, 0.0]
    for case in json.loads(NECKS.read_text()):
        for held in case["setpoints"]:
            pixel = pm.solve_pixel(material_of(case), scope_of(case), held["setpoint"], solver)
            kind = "none" if not held["held"] else "periodic" if held["period"] == 1 else "irregular"
            says = judged(held, pixel)
            table[case["contact"], kind, says] = table.get((case["contact"], kind, says), 0) + 1
            if says == "agrees" and kind == "periodic":
                off = abs(pixel.phase - held["phase"]), abs(pixel.tip_offset - held["tip_offset"])
                worst = [max(pair) for pair in zip(worst, off, strict=True)]
            if says not in ("agrees", "both hold nothing"):
                print(case["number"], held["setpoint"], says, pixel, held)
    for key, count in sorted(table.items()):
        print(*(f"{word:10}" for word in key), count)
    print(f"periodic: within {worst[0]:.1e} degree and {worst[1] * 1e12:.1e} pm")


if __name__ == "__main__":
    task, *rest = sys.argv[1:]
    if task == "curves":
        curves()
    elif task == "compare":
        compare(*rest)
    else:
        make(*(map(int, rest) if rest else STORED))
