"""Makes tests/data/relaxing_contacts.json: orbits over films that relax, and over solids that relax under liquid.

    python tests/reference/relaxing_contacts.py

By the hereditary integral over elements of `prony.py`. None of the package's methods is used, but the elastic law of the
film, which `film.py` checks.

A layer on a rigid base is a row of elements as well: under a punch of radius x its surface moves as one within x, so
that the sphere's pressure is a sum of those of punches, with parts as large as the depth at which a contact is as wide
as x moves. Where the element of that depth is, x^2 of the half-space, F' of the elastic law says how stiff all up to it
are. `prony.check` compares one tap with Ting's integrals (1966), with the layer's force in place of Hertz's.

A neck forms where the gap to the surface, as that comes back, falls to D_on, and breaks where it rises to D_off.
"""

from __future__ import annotations

import json
import math
import pathlib

import numpy as np
import prony

import phasemap as pm

DATA = pathlib.Path(__file__).parent.parent / "data" / "relaxing_contacts.json"
BEFORE = {"poisson_ratio": prony.POISSON, "decay_length": 0.3e-9, "halved": True, "setpoint": 0.6}
FAST, SLOW = {"moduli": [1e9], "times": [30e-9]}, {"moduli": [0.6e9, 0.3e9], "times": [50e-9, 1.5e-6]}
STIFF = {"radius": 10e-9, "stiffness": 40.0, "quality_factor": 400.0, "frequency": 300e3, "free_amplitude": 40e-9}
SOFT = {"radius": 20e-9, "stiffness": 5.0, "quality_factor": 150.0, "frequency": 80e3, "free_amplitude": 50e-9}


def film_force(one: dict):
    """Elastic force on the film over (4/3) E* sqrt(R), of depths."""
    law, film = pm.interaction.Film(one["base"]), np.array([[prony.POISSON, one["thickness"]]])
    p = pm.Interaction(law).columns(np.ones(1), np.zeros(1), np.zeros(1), one["radius"], film)[0]
    p[0] = 1.0
    return np.vectorize(lambda depth: law.force(depth, p))


def film_stiffness(one: dict):
    """Stiffness of all elements up to x, by differences of order four of the elastic force."""
    force = film_force(one)

    def stiff(x: np.ndarray) -> np.ndarray:
        h = 1e-3 * x * x + 1e-20
        a, b, c, d = (force(np.maximum(x * x + i * h, 0.0)) for i in (-2, -1, 1, 2))
        return np.where(x > 0, (a - 8 * b + 8 * c - d) / (12 * h) / 1.5, 0.0)

    return stiff


def neck_force(one: dict):
    """Force [N] of the neck on a tip at periodic gaps [m]: formed and broken between two samples, in the mean."""
    strength = 4 * math.pi * one["radius"] * one["surface_tension"]
    width = math.sqrt(one["volume"] / (math.pi * one["radius"]))

    def force(gap: np.ndarray) -> np.ndarray:
        held, share = 0.0, np.zeros(len(gap))
        for _ in range(2):
            for n in range(len(gap)):
                share[n] = held
                if held == 0.0 and gap[n] < one["forms_at"]:
                    held, share[n] = 1.0, 1.5 - (gap[n - 1] - one["forms_at"]) / (gap[n - 1] - gap[n])
                elif held == 1.0 and gap[n] > one["breaks_at"]:
                    held, share[n] = 0.0, (one["breaks_at"] - gap[n - 1]) / (gap[n] - gap[n - 1]) - 0.5
        return -share * strength * (1 - gap / np.hypot(gap, width))

    return force


def complete(one: dict) -> dict:
    """The same with what `prony` asks for."""
    more = {"drive_frequency": one["frequency"]}
    if "thickness" in one:
        more |= {"stiff": film_stiffness(one), "elastic": film_force(one)}
    if "film" in one:
        h, radius = one["film"], one["radius"]
        one |= {"volume": 4 * math.pi * radius * h**2 + 4 / 3 * math.pi * h**3, "forms_at": 2 * h}
        root = math.cbrt(one["volume"])
        one |= {"breaks_at": root - root**2 / (5 * radius)}
        more["neck"] = neck_force(one)
    return one | more


CASES = [
    BEFORE | STIFF | FAST | {"equilibrium": 1e9, "adhesion": 0.05, "thickness": 5e-9, "base": "bonded"},
    BEFORE | STIFF | FAST | {"equilibrium": 1e9, "adhesion": 0.0, "thickness": 2e-9, "base": "slipping"},
    BEFORE | SOFT | SLOW | {"equilibrium": 0.2e9, "adhesion": 0.03, "thickness": 15e-9, "base": "bonded"},
    BEFORE | STIFF | FAST | {"equilibrium": 1e9, "adhesion": 0.05, "film": 0.5e-9, "surface_tension": 0.072},
    BEFORE | STIFF | SLOW | {"equilibrium": 1e9, "adhesion": 0.03, "film": 0.3e-9, "surface_tension": 0.072},
    BEFORE
    | SOFT
    | SLOW
    | {"equilibrium": 0.5e9, "adhesion": 0.0, "film": 0.3e-9, "surface_tension": 0.03, "free_amplitude": 120e-9},
]

if __name__ == "__main__":
    found = []
    for case in CASES:
        one = complete(case)
        answer = prony.solve(one, 8000)
        print(f"Ting {prony.check(one):.1e}", answer, flush=True)
        found.append(case | answer)
    DATA.write_text(json.dumps(found, indent=1) + "\n")
