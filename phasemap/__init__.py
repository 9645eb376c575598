"""Synthetic phase images for tapping-mode atomic force microscopy.

Names are imported when they are first used, so that ``import phasemap`` costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from phasemap import plot
    from phasemap._shared.errors import FileError, InputError, PhasemapError, SolveError
    from phasemap._shared.notices import PlausibilityWarning, ResultWarning, strict_units
    from phasemap.comparison.levelling import level
    from phasemap.comparison.registration import Registration, register
    from phasemap.comparison.result import compare
    from phasemap.experiment import generate, interaction
    from phasemap.experiment.accuracy import Accuracy
    from phasemap.experiment.beam import Eigenmode
    from phasemap.experiment.control import Engage, Feedback, Raster
    from phasemap.experiment.interaction import ContactLaw, Interaction
    from phasemap.experiment.labels import Variation
    from phasemap.experiment.material import Material
    from phasemap.experiment.microscope import Cantilever, Drive, Microscope, Mode, Tip
    from phasemap.experiment.prony import Prony
    from phasemap.experiment.realism import Realism, TipChange
    from phasemap.experiment.surface import Surface
    from phasemap.explorer.explore import explore
    from phasemap.imaging.simulation import simulate
    from phasemap.inference.curves.fit import Fit, fit_distance, fit_frequency
    from phasemap.inference.images.invert import invert
    from phasemap.inference.images.regions import fit_regions
    from phasemap.inference.images.sensitivities import sensitivity
    from phasemap.inference.series.series import series
    from phasemap.io.curves import read_curve
    from phasemap.io.export import export, to_sidpy
    from phasemap.io.read import read_image
    from phasemap.results.channels import channels
    from phasemap.results.status import Status
    from phasemap.results.variables import phase_lag
    from phasemap.scenes.ensemble import load_ensemble
    from phasemap.scenes.measured import scene_from
    from phasemap.scenes.scene import load_scene
    from phasemap.solvers.pixel import Pixel, solve_pixel
    from phasemap.sweeps.contrasts.contrast_map import contrast
    from phasemap.sweeps.sweep import (
        force_curve,
        orbits,
        sweep_distance,
        sweep_frequency,
        sweep_parameter,
        sweep_setpoint,
    )
    from phasemap.validation.check import check
    from phasemap.validation.picture import Check

_NAMES = {
    "_shared.errors": ("FileError", "InputError", "PhasemapError", "SolveError"),
    "_shared.notices": ("PlausibilityWarning", "ResultWarning", "strict_units"),
    "comparison.levelling": ("level",),
    "comparison.registration": ("Registration", "register"),
    "comparison.result": ("compare",),
    "experiment.accuracy": ("Accuracy",),
    "experiment.control": ("Engage", "Feedback", "Raster"),
    "experiment.beam": ("Eigenmode",),
    "experiment.interaction": ("ContactLaw", "Interaction"),
    "experiment.material": ("Material",),
    "experiment.microscope": ("Cantilever", "Drive", "Microscope", "Mode", "Tip"),
    "experiment.prony": ("Prony",),
    "experiment.realism": ("Realism", "TipChange"),
    "experiment.labels": ("Variation",),
    "experiment.surface": ("Surface",),
    "explorer.explore": ("explore",),
    "imaging.simulation": ("simulate",),
    "inference.curves.fit": ("Fit", "fit_distance", "fit_frequency"),
    "inference.images.invert": ("invert",),
    "inference.images.regions": ("fit_regions",),
    "inference.images.sensitivities": ("sensitivity",),
    "inference.series.series": ("series",),
    "io.export": ("export", "to_sidpy"),
    "io.curves": ("read_curve",),
    "io.read": ("read_image",),
    "results.channels": ("channels",),
    "results.status": ("Status",),
    "results.variables": ("phase_lag",),
    "scenes.ensemble": ("load_ensemble",),
    "scenes.measured": ("scene_from",),
    "scenes.scene": ("load_scene",),
    "solvers.pixel": ("Pixel", "solve_pixel"),
    "sweeps.contrasts.contrast_map": ("contrast",),
    "sweeps.sweep": ("force_curve", "orbits", "sweep_distance", "sweep_frequency", "sweep_parameter", "sweep_setpoint"),
    "validation.check": ("check",),
    "validation.picture": ("Check",),
}
_HOME = {name: module for module, names in _NAMES.items() for name in names}
_MODULES = {"generate": "experiment.generate", "interaction": "experiment.interaction", "plot": "plot"}

__all__ = [
    "Accuracy", "Cantilever", "Check", "ContactLaw", "Drive", "Eigenmode", "Engage", "Feedback", "FileError", "Fit",
    "InputError", "Interaction", "Material", "Microscope", "Mode", "PhasemapError", "Pixel", "PlausibilityWarning",
    "Prony", "Raster", "Realism", "Registration", "ResultWarning", "SolveError", "Status", "Surface", "Tip",
    "TipChange", "Variation", "channels", "check", "compare", "contrast", "explore", "export", "fit_distance",
    "fit_frequency", "fit_regions", "force_curve", "generate", "interaction", "invert",
    "level", "load_ensemble", "load_scene", "orbits", "phase_lag", "plot", "read_curve", "read_image", "register",
    "scene_from", "sensitivity", "series", "simulate", "solve_pixel", "strict_units", "sweep_distance",
    "sweep_frequency", "sweep_parameter", "sweep_setpoint", "to_sidpy",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return importlib.import_module(f"phasemap.{_MODULES[name]}")
    if name == "__version__":
        from importlib.metadata import version

        return version("afm-phasemap")
    if name not in _HOME:
        raise AttributeError(f"module 'phasemap' has no attribute {name!r}")
    return getattr(importlib.import_module(f"phasemap.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
