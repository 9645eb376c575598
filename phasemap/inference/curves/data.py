"""Measured curves, checked, and what may be fitted to them, on the scale that the optimiser sees."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from phasemap._shared.arrays import real_numbers
from phasemap._shared.checks import number
from phasemap._shared.errors import InputError
from phasemap._shared.notices import unquestioned
from phasemap.experiment.interaction import Neck
from phasemap.experiment.material import Material
from phasemap.experiment.microscope import Microscope
from phasemap.inference.verdict import REACH
from phasemap.solvers.continuation.path import UNITS, Question
from phasemap.sweeps.sweep import check_axis

QUANTITIES = {"amplitude": "m", "phase": "degree"}
DIRECTIONS = {"frequency": ("up", "down"), "tip_offset": ("approach", "retract")}
OFFSETS = {"frequency": "tip_offset", "tip_offset": "offset"}  # what the height is called, by the axis
OF_SAMPLE = ("modulus", "adhesion", "damping", "viscosity", "thickness", "liquid_film")
OF_SCOPE = ("stiffness", "resonance_frequency", "quality_factor", "radius", "free_amplitude", "decay_length")
READING = ("amplitude_scale", "sensitivity", "phase_offset")
ALL_UNITS = UNITS | {
    "resonance_frequency": "Hz", "tip_offset": "m", "offset": "m", "amplitude_scale": "1", "phase_offset": "degree",
    "sensitivity": "1", "neck_length": "m",
}  # fmt: skip
FACTOR, KNOWN = 10.0, 1.44  # within which a property of the sample, and of the microscope, is known beforehand
WIDTHS = 3.3  # the same of the resonance frequency, in its half widths
TURN = 60.0  # the same of a phase [degree]


@dataclass(frozen=True, eq=False)
class Data:
    """Amplitudes and phases along an axis, in one direction or both."""

    axis: str  # "frequency" or "tip_offset"
    values: np.ndarray  # shape (n,) [Hz or m]
    directions: tuple[str, ...]
    # measured, errors: "amplitude" [m] and "phase" [degree], or one of them, and their standard errors
    measured: dict[str, np.ndarray]
    errors: dict[str, np.ndarray]

    @property
    def size(self) -> int:
        """Number of measured numbers."""
        return sum(part.size for part in self.measured.values())

    @property
    def spacing(self) -> float:
        """Mean step along the axis [Hz or m]."""
        return float(np.ptp(self.values)) / (len(self.values) - 1)


def check_data(axis: str, values: Any, direction: Any, given: dict[str, tuple[Any, Any]]) -> Data:
    """What was measured, as arrays.

    `given`: measured values and their errors of each of `QUANTITIES`, as given.
    """
    frequency = axis == "frequency"
    name = "frequencies" if frequency else "tip_offsets"
    along = check_axis(name, values, "Hz" if frequency else "m", above=0 if frequency else -np.inf)
    allowed = DIRECTIONS[axis]
    directions = (direction,) if isinstance(direction, str) else direction
    if not isinstance(directions, (list, tuple)) or tuple(directions) not in ((allowed[0],), (allowed[1],), allowed):
        raise InputError("direction", direction, f'"{allowed[0]}", "{allowed[1]}" or {allowed}')
    full = (len(directions), len(along))
    shape = full[1:] if isinstance(direction, str) else full
    measured, errors = {}, {}
    for quantity, (numbers, error) in given.items():
        if numbers is None:
            continue
        found = _finite(quantity, numbers, QUANTITIES[quantity])
        if found.shape != shape:
            raise InputError(quantity, f"an array of shape {found.shape}", f"one of shape {shape}, as of {name}")
        spread = _finite(f"{quantity}_error", error, QUANTITIES[quantity])
        if spread.shape not in ((), shape):
            raise InputError(f"{quantity}_error", f"an array of shape {spread.shape}", f"a number or shape {shape}")
        if not (spread > 0).all():
            raise InputError(f"{quantity}_error", float(spread.min()), f"numbers above 0 {QUANTITIES[quantity]}")
        measured[quantity], errors[quantity] = found.reshape(full), np.broadcast_to(spread, shape).reshape(full)
    if not measured:
        raise InputError("amplitude, phase", (None, None), "at least one of the two")
    return Data(axis, along, tuple(directions), measured, errors)


def _finite(name: str, values: Any, unit: str) -> np.ndarray:
    found = real_numbers(name, values, unit)
    bad = found[~np.isfinite(found)]
    if bad.size:
        where = f" ({bad.size} of {found.size} values)" if found.ndim else ""
        raise InputError(name, f"{values if not found.ndim else bad[0]}{where}", f"finite numbers [{unit}]")
    return found


@dataclass(frozen=True)
class Setup:
    """Everything that the measured curve depends on."""

    material: Material
    scope: Microscope
    height: float  # tip offset of a frequency sweep, or what is added to the tip offsets of a distance sweep [m]
    amplitude_scale: float = 1.0  # amplitude that the instrument says over the true one [1]
    phase_offset: float = 0.0  # phase that the instrument says less the true one [degree]

    def with_parameter(self, name: str, value: float) -> Setup:
        """The setup with one parameter changed."""
        if name == "phase_offset":
            return replace(self, phase_offset=value)
        if name == "amplitude_scale":
            return replace(self, amplitude_scale=value)
        if name in OFFSETS.values():
            return replace(self, height=value)
        if name == "sensitivity":  # the free amplitude read is known, so that the true one changes
            free = self.scope.drive.free_amplitude * self.amplitude_scale * value
            return replace(self.with_parameter("free_amplitude", free), amplitude_scale=1 / value)
        scope = self.scope
        with unquestioned():
            if name == "neck_length":
                return replace(self, scope=replace(scope, interaction=replace(scope.interaction, contact=Neck(value))))
            if name == "resonance_frequency":
                lever = replace(scope.cantilever, resonance_frequency=value)
                return replace(self, scope=replace(scope, cantilever=lever))
        changed = Question(self.material, scope).with_parameter(name, value)
        return replace(self, material=changed.material, scope=changed.scope)

    def value(self, name: str) -> float | None:
        """A parameter's value; None if it has none."""
        special = {"sensitivity": 1 / self.amplitude_scale, **dict.fromkeys(OFFSETS.values(), self.height)}
        if name in special:
            return special[name]
        if name == "neck_length":
            return getattr(self.scope.interaction.contact, "length", None)
        parts = (self, self.material, self.scope.cantilever, self.scope.tip, self.scope.drive, self.scope.interaction)
        found: float | None = next(getattr(part, name) for part in parts if hasattr(part, name))
        return found


@dataclass(frozen=True)
class Parameter:
    """One fitted parameter, by standard deviations q of what is known of it: start exp(q size), or start + q size."""

    name: str
    start: float  # value at q = 0, in `units`
    units: str
    logarithmic: bool
    size: float  # standard deviation of the value beforehand, or of its logarithm

    def value(self, q: float) -> float:
        """The value at q."""
        return float(self.start * np.exp(q * self.size) if self.logarithmic else self.start + q * self.size)

    def error(self, q: float, of_q: float) -> float:
        """The error of the value at q, from that of q."""
        return float(of_q * self.size * (self.value(q) if self.logarithmic else 1.0))


def check_parameters(names: object, setup: Setup, axis: str) -> tuple[Parameter, ...]:
    """The parameters of these names, from their values in `setup`; None for modulus, adhesion and damping.

    `names`: a sequence, or a mapping to how well each is known: a factor above 1, a standard error, or None.
    """
    loss, other = ("damping", "viscosity") if setup.material.viscosity is None else ("viscosity", "damping")
    if names is None:
        names = ("modulus", "adhesion", loss)
    known = (*OF_SAMPLE, "neck_length", *OF_SCOPE, OFFSETS[axis], *READING)
    if not isinstance(names, Sequence | Mapping) or isinstance(names, str) or not names:
        raise InputError("parameters", names, "a sequence of names out of " + ", ".join(known))
    found = []
    for i, name in enumerate(names):
        if name not in known:
            raise InputError("parameters", name, "names out of " + ", ".join(known))
        if name == other:
            raise InputError("parameters", name, f"{loss}, because that is what the start material has")
        if name in list(names)[:i]:
            raise InputError("parameters", name, "every name once")
        found.append(_parameter(name, setup, names[name] if isinstance(names, Mapping) else None))
    return tuple(found)


def _parameter(name: str, setup: Setup, spread: float | None) -> Parameter:
    """A parameter that is known within `spread`, by default as well as such a one mostly is."""
    start, units = setup.value(name), ALL_UNITS[name]
    if name in (*OFFSETS.values(), "phase_offset"):
        usual = TURN if name == "phase_offset" else setup.scope.drive.free_amplitude / REACH
        size = usual if spread is None else number(f"error of {name}", spread, units, above=0)
        return Parameter(name, float(start or 0.0), units, False, size)
    if start is None or start <= 0:
        raise InputError(f"{name} to start from", start, f"a number above 0 {units}".removesuffix(" 1"))
    if spread is not None:
        size = np.log(number(f"factor of {name}", spread, "1", above=1, maximum=FACTOR**2))
    elif name == "resonance_frequency":
        size = WIDTHS * setup.scope.cantilever.damping_ratio
    else:
        size = np.log(FACTOR if name in (*OF_SAMPLE, "neck_length") else KNOWN)
    return Parameter(name, start, units, True, float(size))
