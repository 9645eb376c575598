"""The hard cases solved, and what became of them, family by family: ``phasemap bench --hard``.

tests/benchmarks/test_hard.py holds every case against tests/data/hard.json, made by codes that share nothing with
phasemap.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable

import numpy as np

from benchmarks.accuracy.reference import NoOrbit, Start, find_orbit
from benchmarks.accuracy.regimes import Batch
from benchmarks.hard_cases import CASES, HardCase
from benchmarks.tables import markdown
from phasemap.solvers.pixel import Pixel, solve_pixel

SAME_PHASE, SAME_HEIGHT = 0.1, 1e-11
"""[degree, m] Answers farther apart are different orbits, or wrong."""
UNSOLVED = ("not_converged", "not_settled", "too_many_contacts", "no_averaged_orbit")
"""Statuses that say nothing about the physics."""


def table(say: Callable[[str], None]) -> str:
    """Solve the hard cases, and check the answers on the spot.

    A solved pixel is wrong if its phase is not the one known from engaging in time, and a status that denies an orbit
    is wrong if there is one. Where it settles, "march" is the check of the numbers: it starts on the solver's
    branch and shares nothing else with it; where it does not, scipy's DOP853 is.
    Returns a Markdown table with a line a family, and a list of what is wrong or not converged.
    """
    solve_pixel(CASES[0].material, CASES[0].scope, CASES[0].setpoint)  # compiles, or reads what is compiled
    heads = (
        "family", "cases", "solved", "said why not", "wrong", "not converged", "largest phase difference [degree]",
        "largest height difference [pm]", "slowest pixel [ms]",
    )  # fmt: skip
    lines, bad = [], list[str]()
    for family in dict.fromkeys(case.family for case in CASES):
        say(f"hard cases, {family}")
        lines.append(_line(family, bad))
    return "\n".join([markdown(heads, lines), *(["", *bad] if bad else [])])


def _line(family: str, bad: list[str]) -> list[str]:
    """What became of a family; what is wrong or not converged is added to `bad`."""
    statuses, faulty = Counter[str](), 0
    slowest, phases, heights = 0.0, [0.0], [0.0]
    for case in (case for case in CASES if case.family == family):
        started = time.perf_counter()
        pixel = solve_pixel(case.material, case.scope, case.setpoint)
        slowest = max(slowest, time.perf_counter() - started)
        statuses[pixel.status.name] += 1
        fault = fault_of(case, pixel)
        if pixel.status.name in UNSOLVED:
            bad.append(f"* {case.name}: {pixel.status.name}")
        elif pixel.status.name == "good":
            phase, height = _checked(case, pixel)
            if math.isnan(phase):
                bad.append(f"* {case.name}: solved, but the check did not converge")
            phases.append(phase)
            heights.append(height)
            if not fault and (phase > SAME_PHASE or height > SAME_HEIGHT):
                fault = f"{phase:.2g} degree and {height * 1e12:.2g} pm from the check"
        if fault:
            faulty += 1
            bad.append(f"* {case.name}: {fault}")
    why = [f"{number} {name}" for name, number in statuses.items() if name not in ("good", *UNSOLVED)]
    return [
        family, str(statuses.total()), str(statuses["good"]), ", ".join(why) or "0", str(faulty),
        str(sum(statuses[name] for name in UNSOLVED)), f"{np.nanmax(phases):.1g}", f"{1e12 * np.nanmax(heights):.1g}",
        f"{1e3 * slowest:.3g}",
    ]  # fmt: skip


def fault_of(case: HardCase, pixel: Pixel) -> str:
    """What is wrong with an answer, as far as is known; empty if nothing is.

    Examples
    --------
    >>> case = CASES[0]
    >>> fault_of(case, solve_pixel(case.material, case.scope, case.setpoint, solver="orbit"))
    ''
    """
    status = pixel.status.name
    if status in UNSOLVED or (case.phase is not None and math.isnan(case.phase)):
        return ""
    if status != "good":
        return "" if case.phase is None else f"{status}, though the orbit at {case.phase:.2f} degree can be held"
    if case.phase is None:
        return f"an orbit at {pixel.phase:.2f} degree, though nothing holds the setpoint"
    if abs(pixel.phase - case.phase) > SAME_PHASE:
        return f"phase {pixel.phase:.2f} degree, engaging in time gives {case.phase:.2f}"
    return ""


def _checked(case: HardCase, pixel: Pixel) -> tuple[float, float]:
    """Differences from an independent answer on the same branch [degree, m]; NaN if there is none."""
    if pixel.solver != "march":
        marched = solve_pixel(case.material, case.scope, case.setpoint, "march")
        if marched.status.name == "good":
            return abs(marched.phase - pixel.phase), abs(marched.tip_offset - pixel.tip_offset)
    return shot(case, pixel)


def shot(case: HardCase, pixel: Pixel) -> tuple[float, float]:
    """How far the nearest orbit found by `accuracy.reference` is [degree, m]; NaN if none is found."""
    material = case.material
    numbers = [material.modulus, material.adhesion, material.damping, material.poisson_ratio]
    plain = Batch(case.scope, np.array([numbers], np.float64), case.setpoint).case(0)
    try:
        found = find_orbit(plain, Start(pixel.tip_offset, pixel.mean_deflection, pixel.phase))
    except (NoOrbit, np.linalg.LinAlgError):
        return math.nan, math.nan
    return abs(found.phase - pixel.phase), abs(found.tip_offset - pixel.tip_offset)
