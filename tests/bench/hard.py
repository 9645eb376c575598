"""The hard cases solved, and what became of them, family by family: ``python tests/bench/hard.py``.

tests/bench/test_hard.py holds every case against tests/data/hard.json, made by codes that share nothing with
phasemap.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from hard_cases import CASES, HardCase

from phasemap.solvers.pixel import Pixel, solve_pixel

__all__ = ["CASES", "HardCase", "fault_of", "hard"]

SAME_PHASE, SAME_HEIGHT = 0.1, 1e-11
"""[degree, m] Answers farther apart are different orbits, or wrong."""
UNSOLVED = ("not_converged", "not_settled", "too_many_contacts", "no_averaged_orbit")
"""Statuses that say nothing about the physics."""


@dataclass
class _Count:
    """What became of a family."""

    cases: int = 0
    solved: int = 0
    unsolved: int = 0
    phase: float = 0.0
    height: float = 0.0
    slowest: float = 0.0


def hard(progress: Callable[[str], None] | None = None, solver: str = "auto") -> str:
    """Solve the hard cases, and check the answers on the spot.

    A solved pixel is wrong if its phase is not the one known from engaging in time, and a status that denies an orbit
    is wrong if there is one. Where it settles, "march" is the check of the numbers: it starts on the solver's
    branch and shares nothing else with it; where it does not, scipy's DOP853 is.

    Parameters
    ----------
    progress : callable, optional
        Told which family is being solved.
    solver : {"auto", "averaging", "orbit", "march"}
        As in `phasemap.simulate`.

    Returns
    -------
    str
        A Markdown table with a line a family, and a list of what is wrong or not converged.
    """
    solve_pixel(CASES[0].material, CASES[0].scope, CASES[0].setpoint, solver)  # compiles, or reads what is compiled
    lines = [
        "| family | cases | solved | said why not | wrong | not converged | largest phase difference [degree] "
        "| largest height difference [pm] | slowest pixel [ms] |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    bad: list[str] = []
    for family in dict.fromkeys(case.family for case in CASES):
        if progress is not None:
            progress(f"hard cases, {family}")
        lines.append(_line(family, solver, bad))
    return "\n".join([*lines, *(["", *bad] if bad else [])])


def _line(family: str, solver: str, bad: list[str]) -> str:
    count, why = _Count(), dict[str, int]()
    wrong = 0
    for case in (case for case in CASES if case.family == family):
        started = time.perf_counter()
        pixel = solve_pixel(case.material, case.scope, case.setpoint, solver)
        count.slowest = max(count.slowest, time.perf_counter() - started)
        count.cases += 1
        status = pixel.status.name
        fault = fault_of(case, pixel)
        if status in UNSOLVED:
            count.unsolved += 1
            bad.append(f"* {case.name}: {status}")
        elif status != "good":
            why[status] = why.get(status, 0) + 1
        else:
            count.solved += 1
            phase, height = _checked(case, pixel)
            if math.isnan(phase):
                bad.append(f"* {case.name}: solved, but the check did not converge")
            count.phase, count.height = max(count.phase, phase), max(count.height, height)
            if not fault and (phase > SAME_PHASE or height > SAME_HEIGHT):
                fault = f"{phase:.2g} degree and {height * 1e12:.2g} pm from the check"
        if fault:
            wrong += 1
            bad.append(f"* {case.name}: {fault}")
    said = ", ".join(f"{number} {name}" for name, number in why.items()) or "0"
    return (
        f"| {family} | {count.cases} | {count.solved} | {said} | {wrong} | {count.unsolved} | {count.phase:.1g} "
        f"| {count.height * 1e12:.1g} | {count.slowest * 1e3:.3g} |"
    )


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
    """How far the nearest orbit found by `phasemap.validation.bench.reference` is [degree, m]; NaN if none is found."""
    from phasemap.validation.bench.equation import Case
    from phasemap.validation.bench.reference import NoOrbit, Start, find_orbit

    scope, material = case.scope, case.material
    plain = Case(
        stiffness=scope.cantilever.stiffness,
        quality_factor=scope.cantilever.quality_factor,
        free_amplitude=scope.drive.free_amplitude,
        radius=scope.tip.radius,
        modulus=material.modulus,
        adhesion=material.adhesion,
        damping=material.damping,
        poisson_ratio=material.poisson_ratio,
        setpoint=case.setpoint,
        decay_length=scope.interaction.decay_length,
        frequency_ratio=scope.frequency_ratio,
    )
    try:
        found = find_orbit(plain, Start(pixel.tip_offset, pixel.mean_deflection, pixel.phase))
    except (NoOrbit, np.linalg.LinAlgError):
        return math.nan, math.nan
    return abs(found.phase - pixel.phase), abs(found.tip_offset - pixel.tip_offset)


if __name__ == "__main__":
    print(hard(print))
