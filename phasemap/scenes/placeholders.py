"""Placeholders for the materials of a measured image, which does not name them."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from phasemap._shared.notices import untold
from phasemap.experiment.material import Material
from phasemap.experiment.material_rows import damping_of
from phasemap.experiment.microscope import Microscope
from phasemap.experiment.surface import Surface
from phasemap.scenes.scene import Scene
from phasemap.scenes.tables import Table

PLACEHOLDERS = ("LDPE", "PS", "glass", "gold")  # presets, so that an image that nobody edited has a contrast
ONE = "PS"  # where there is one material only
TRIED = (0.02, 50.0, 31)  # factors on modulus and damping of a placeholder that are tried: ends, and how many
NEAR = 0.5  # of a contrast that counts as given [degree]


def placeholders(phases: int) -> list[str]:
    """Presets that stand for materials nobody has named, from the lowest label: the stiffer, the higher the phase."""
    return [ONE] if phases == 1 else list(PLACEHOLDERS[:phases])


def placeholder_with(preset: str, given: Any) -> Any:
    """The placeholder with the values that the user gives; a damping takes the place of its viscosity."""
    if not isinstance(given, dict):
        return given  # what is wrong is said when the scene is checked
    if "preset" in given:
        return given
    numbers = {name: value for name, value in dataclasses.asdict(Material.preset(preset)).items() if value is not None}
    del numbers["viscosity" if given.get("damping") else "damping"]
    return numbers | given


def with_own_damping(table: Any, given: Any, scope: Microscope) -> Any:
    """The placeholder with the damping that its viscosity is under this lever, which is what one turns to fit."""
    kept = "viscosity" not in table or "viscosity" in given or "preset" in table
    if kept or scope.interaction.damping_exponent != scope.interaction.law.spread:
        return table
    damping = float(damping_of(np.array(table["viscosity"]), scope))
    return {"damping" if key == "viscosity" else key: value for key, value in table.items()} | {
        "damping": float(f"{damping:.1e}")
    }


def starts_of_contrast(materials: Table, names: list[str], levels: np.ndarray, scene: Scene) -> dict[str, Table]:
    """Modulus and damping that give the measured contrasts to the stiffest placeholder, those nearest to the others.

    `levels`: median phases of the materials, positive repulsive, whatever their zero [degree].
    """
    from phasemap.imaging.simulation import simulate

    reference = max(names, key=lambda name: float(materials[name]["modulus"]))
    moved = np.geomspace(*TRIED)
    stiffer, lossier = (one.reshape(1, -1) for one in np.meshgrid(moved, moved))

    def phases(placeholder: Table, modulus: Any, damping: Any) -> np.ndarray:
        size, loss = placeholder["modulus"] * modulus, placeholder.get("damping", 0.0) * damping
        more = {key: placeholder[key] for key in ("adhesion", "poisson_ratio") if key in placeholder}
        tried = Surface(size, damping=loss, pixel_size=1e-9, **more)
        image = simulate(tried, scene.microscope, scene.options["setpoint"], "averaging", variables=["phase"])
        return np.asarray(image["phase"].values[0])

    below = phases(materials[reference], np.ones((1, 1)), 1.0) - levels[names.index(reference)]
    starts = {}
    for name, level in zip(names, levels, strict=True):
        placeholder = materials[name]
        if name == reference or "damping" not in placeholder:
            continue
        with untold():  # of those that have no orbit
            apart = (phases(placeholder, stiffer, lossier) - below - level) / NEAR
        cost = apart**2 + np.log(stiffer[0]) ** 2 + np.log(lossier[0]) ** 2
        best = int(np.argmin(np.where(np.isfinite(cost), cost, np.inf)))
        if abs(apart[best]) < 2.0:
            both = (("modulus", stiffer), ("damping", lossier))
            starts[name] = {key: float(f"{placeholder[key] * by[0, best]:.3g}") for key, by in both}
    return starts
