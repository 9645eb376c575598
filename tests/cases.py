"""Reference cases: what the JSON files of tests/data hold, as phasemap's objects."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import phasemap as pm

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
