"""The sliders of the page: what each sets, in which unit, from where to where."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from phasemap.explorer.subject import Subject

DECADE = 10.0  # by which lengths can be made larger or smaller
WIDE = 30.0  # by which a modulus can be
PEAKS = 5.0  # half widths of the resonance that a frequency can be off


class Knob(NamedTuple):
    """One slider."""

    key: str  # of the setting that it changes
    label: str
    unit: str
    size: float  # the unit in the SI unit
    # low, high: ends of the slider [SI]; a number that is typed in may lie beyond
    low: float
    high: float
    scale: str  # "linear", "log", or "cubic", which begins at 0 and is fine there
    start: float  # [SI]
    material: int | None = None  # which one it belongs to


def knobs_of(subject: Subject) -> list[Knob]:
    """The sliders that a subject has, in the order of the page.

    Examples
    --------
    >>> from phasemap.explorer.subject import subject_of
    >>> [knob.label for knob in knobs_of(subject_of("samples/step.toml"))][:4]
    ['setpoint', 'free amplitude', 'frequency', 'tip radius']
    """
    return [*_of_microscope(subject), *_of_materials(subject)]


def _of_microscope(subject: Subject) -> Iterator[Knob]:
    """Setpoint, free amplitude, frequency and tip radius."""
    scope = subject.scope
    amplitude, radius = scope.drive.free_amplitude, scope.tip.radius
    resonance, driven = scope.cantilever.resonance_frequency, scope.frequency_ratio
    reach = min(0.5 * PEAKS / scope.cantilever.quality_factor, 0.6)
    off = max(reach, 1.5 * abs(driven - 1.0))
    low, high = max(1.0 - off, 0.1 * driven), 1.0 + off
    yield Knob("setpoint", "setpoint", "of free", 1.0, 0.1, 0.98, "linear", float(subject.options["setpoint"]))
    yield Knob("free_amplitude", "free amplitude", "nm", 1e-9, amplitude / DECADE, amplitude * DECADE, "log", amplitude)
    yield Knob("frequency", "frequency", "kHz", 1e3, low * resonance, high * resonance, "linear", driven * resonance)
    yield Knob("radius", "tip radius", "nm", 1e-9, radius / DECADE, radius * DECADE, "log", radius)


def _of_materials(subject: Subject) -> Iterator[Knob]:
    """Modulus, adhesion and loss of each material."""
    every = subject.materials.values()
    sticky = max(0.2, *(3 * material.adhesion for material in every))
    stiff = [material.modulus or 1e9 for material in every]
    for i, material in enumerate(every):
        yield Knob("modulus", "modulus", "GPa", 1e9, min(stiff) / WIDE, max(stiff) * WIDE, "log", material.modulus, i)
        yield Knob("adhesion", "adhesion", "mJ/m²", 1e-3, 0.0, sticky, "linear", material.adhesion, i)
        if subject.viscous:
            viscous = 4 * max(one.viscosity or 0.0 for one in every)
            yield Knob("viscosity", "viscosity", "Pa·s", 1.0, 0.0, viscous, "cubic", material.viscosity or 0.0, i)
        else:
            damped = max(0.3, *(4 * one.damping for one in every))
            yield Knob("damping", "damping", "", 1.0, 0.0, damped, "cubic", material.damping, i)
