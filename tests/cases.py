"""Reference cases: what the JSON files of tests/data hold, as phasemap's objects."""

from __future__ import annotations

import json
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np

import phasemap as pm
from phasemap._kernels import columns as col
from phasemap._kernels import records
from phasemap._kernels.law import Oscillator
from phasemap._kernels.rows.answers import Pixels
from phasemap._kernels.rows.marched import march_rows

DATA = Path(__file__).parent / "data"
Case = dict[str, Any]


def load(name: str) -> list[Case]:
    """Read the cases of tests/data/NAME.json."""
    return list(json.loads((DATA / f"{name}.json").read_text()))


def label(case: Case) -> str:
    """Name a case in a test report."""
    return str(case.get("name") or f"{case['regime']} k={case['stiffness']:.2g} Q={case['quality_factor']:.4g}")


def law_of(case: Case) -> str | pm.ContactLaw:
    """Return the contact law of a case."""
    if "neck_length" in case:
        return pm.interaction.Neck(case["neck_length"])
    return pm.interaction.MaugisDugdale(case["range"]) if case.get("range") else str(case.get("contact", "dmt"))


def scope_of(case: Case) -> pm.Microscope:
    """Return the microscope of a case."""
    frequency = case.get("resonance_frequency", 300e3)
    ratio = case.get("frequency_ratio", 1.0)
    return pm.Microscope(
        pm.Cantilever(case["stiffness"], frequency, case["quality_factor"]),
        pm.Tip(case["tip_radius"], case.get("tip_modulus"), case.get("tip_poisson_ratio") or 0.3),
        pm.Drive(case["free_amplitude"], None if ratio == 1.0 else ratio * frequency),
        pm.Interaction(law_of(case), case["decay_length"], case.get("damping_exponent", 0.5)),
    )


def material_of(case: Case) -> pm.Material:
    """Return the material of a case."""
    ratio = case.get("poisson_ratio", 0.35)
    return pm.Material(case["modulus"], adhesion=case["adhesion"], damping=case["damping"], poisson_ratio=ratio)


def hold_in_time(oscillator: Oscillator, amplitude: float, eta: float, most: int, row: np.ndarray) -> int:
    """Hold an amplitude as the march does, from the orbit in a row, or from far where that is NaN; returns a status."""
    near = np.isfinite(row[col.TIP_OFFSET])
    status = np.array([col.GOOD if near else col.PENDING], np.int8)
    law, p, lever = oscillator
    march_rows(Pixels(law, np.array([p]), lever, np.array([amplitude])), eta, most, row[None], status)
    return int(status[0])


def plain(kernel: Any, known: dict[Any, Any] | None = None) -> Any:
    """A kernel as Python runs it, with all that it calls."""
    function, known = kernel.py_func, {} if known is None else known
    if kernel not in known:
        scope = dict(function.__globals__)
        known[kernel] = FunctionType(function.__code__, scope)
        called = {name: scope.get(name) for name in function.__code__.co_names}
        scope.update({name: plain(one, known) for name, one in called.items() if hasattr(one, "py_func")})
        scope.update(
            {name: getattr(records, f"_{name}") for name in ("assign", "clear", "numbers_of") if name in called}
        )
    return known[kernel]
