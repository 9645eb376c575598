"""Levers with several eigenmodes of the independent code, `reference/beam.py`."""

from __future__ import annotations

from cases import Case, load

import phasemap as pm

CASES = [case for case in load("beam") if len(case["quality_factor"]) > 1]


def scope_of(case: Case) -> pm.Microscope:
    names = ("frequency_ratio", "quality_factor", "stiffness_ratio", "participation", "slope_ratio")
    first, *higher = zip(*(case[name] for name in names), strict=True)
    modes = tuple(pm.Eigenmode(*mode) for mode in higher)
    frequency = case["resonance_frequency"]
    return pm.Microscope(
        pm.Cantilever(case["stiffness"], frequency, first[1], participation=first[3], modes=modes),
        pm.Tip(case["tip_radius"], case["tip_modulus"], case["tip_poisson_ratio"]),
        pm.Drive(case["free_amplitude"], case["drive_ratio"] * frequency, case["excitation"]),
        pm.Interaction(
            "dmt" if case["adhesion"] else "hertz",
            case["decay_length"] if case["adhesion"] else None,
            case["damping_exponent"],
        ),
        detector=case["detector"],
    )


def material_of(case: Case) -> pm.Material:
    return pm.Material(case["modulus"], case["adhesion"], case["damping"], poisson_ratio=case["poisson_ratio"])
