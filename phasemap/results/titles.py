"""What pictures and summaries say a result is of: which material, under which microscope, at which setpoint."""

from __future__ import annotations

import json
import math
from typing import Any

import xarray as xr

from phasemap._shared.units import say


def titles(ds: xr.Dataset) -> list[str]:
    """Title, material and microscope of a sweep, a line each; what is swept is left out.

    `ds`: of a sweep, with its ``configuration``.
    """
    about = json.loads(ds.attrs.get("configuration", "{}"))
    swept = about.get("sweep", "")
    material = about.get("material", {})
    scope = about.get("microscope", {})
    lines = [
        [ds.attrs["title"]] if "title" in ds.attrs else [],
        [
            *_said(material, swept, modulus=("modulus {}", "Pa"), adhesion=("adhesion {}", "J m-2")),
            *_said(material, swept, **_loss(material)),
            *_said(about, swept, setpoint=("setpoint held at {}", "1"), tip_offset=("tip offset held at {}", "m")),
        ],
        microscope_in_words(scope, swept),
    ]  # fmt: skip
    return [", ".join(line) for line in lines if line]


def microscope_in_words(scope: dict[str, Any], swept: str = "") -> list[str]:
    """Lever, tip and drive of a ``configuration`` in words, as far as they are known, without what is swept."""
    lever, tip, drive = (scope.get(part, {}) for part in ("cantilever", "tip", "drive"))
    return [
        *_said(lever, swept, stiffness=("lever {}", "N m-1"), resonance_frequency=("{}", "Hz")),
        *_said(lever, swept, quality_factor=("Q {}", "1")),
        *_said(tip, swept, radius=("tip radius {}", "m")),
        *_said(drive, swept, free_amplitude=("free amplitude {}", "m"), frequency=("driven at {}", "Hz")),
    ]


def _loss(material: dict[str, Any]) -> dict[str, tuple[str, str]]:
    """What a material loses energy by."""
    if material.get("relaxation_time") is not None:
        return {"relaxed_modulus": ("relaxed {}", "Pa"), "relaxation_time": ("in {}", "s")}
    if material.get("viscosity") is not None:
        return {"viscosity": ("viscosity {}", "Pa s")}
    return {"damping": ("damping {}", "1")}


def _said(table: dict[str, Any], swept: str, **words: tuple[str, str]) -> list[str]:
    """The values of a table that are given and not swept, in words."""
    return [
        phrase.format(say(table[name], units, 5))
        for name, (phrase, units) in words.items()
        if table.get(name) is not None and name != swept
    ]


def of_file(ds: xr.Dataset, name: str, i: int, scale: float = 1.0) -> str:
    """The setpoint or free amplitude of a file as recorded, else from where to where it may be."""
    recorded = scale * float(ds[f"recorded_{name}"][i])
    if math.isfinite(recorded):
        return f"{recorded:.3g}"
    ends = [scale * float(ds[f"{name}_{end}"][i]) for end in ("low", "high")]
    return " to ".join(f"{end:.0f}" if end >= 100 else f"{end:.2g}" for end in ends)
