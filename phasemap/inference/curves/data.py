"""Measured curves, checked, and the parameters that may be fitted to them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from scipy.optimize import brentq

from phasemap._kernels import columns as col
from phasemap._shared.arrays import real_numbers
from phasemap._shared.checks import number
from phasemap._shared.errors import InputError, Word
from phasemap._shared.fields import Number, number_of
from phasemap._shared.notices import unquestioned
from phasemap._shared.units import UDUNITS
from phasemap.experiment.interaction import ContactLaw, Interaction, Neck
from phasemap.experiment.interaction.contact import LAWS
from phasemap.experiment.material import Material, relaxes
from phasemap.experiment.microscope import Microscope
from phasemap.inference.determined import REACH
from phasemap.solvers.continuation.path import UNITS, Question
from phasemap.sweeps.sweep import check_axis

QUANTITIES = {"amplitude": "m", "phase": "degree"}
DIRECTIONS = {"frequency": ("up", "down"), "tip_offset": ("approach", "retract")}
OFFSETS = {"frequency": "tip_offset", "tip_offset": "offset"}  # what the height is called, by the axis
OF_SAMPLE = ("modulus", "adhesion", "damping", "viscosity", "thickness", "liquid_film", "relaxation_time")
OF_SCOPE = ("stiffness", "resonance_frequency", "quality_factor", "radius", "free_amplitude", "decay_length")
READING = ("amplitude_scale", "sensitivity", "phase_offset")
ALL_UNITS = UNITS | {
    "resonance_frequency": "Hz", "tip_offset": "m", "offset": "m", "amplitude_scale": "1", "phase_offset": "degree",
    "sensitivity": "1", "free_phase": "degree",
}  # fmt: skip
FACTOR, KNOWN = 10.0, 1.44  # within which a property of the sample, and of the microscope, is known beforehand
WIDTHS = 3.3  # the same of the resonance frequency, in its half widths
OF_PHASE = {"phase_offset": 60.0, "free_phase": 10.0}  # the same of phases; levers are tuned near resonance [degree]
MOST_TUNED = 20.0  # the largest that may be said of the latter [degree]


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
    """Measured amplitudes and phases as arrays. `given`: values and errors of each of `QUANTITIES`, as given."""
    frequency = axis == "frequency"
    name = "frequencies" if frequency else "tip_offsets"
    along = check_axis(name, values, Number[float]("Hz", above=0) if frequency else Number[float]("m"))
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
        array = _finite(quantity, numbers, QUANTITIES[quantity])
        if array.shape != shape:
            raise InputError(quantity, Word(f"an array of shape {array.shape}"), f"one of shape {shape}, as of {name}")
        spread = _finite(f"{quantity}_error", error, QUANTITIES[quantity])
        if spread.shape not in ((), shape):
            raise InputError(
                f"{quantity}_error", Word(f"an array of shape {spread.shape}"), f"a number or shape {shape}"
            )
        if not (spread > 0).all():
            raise InputError(f"{quantity}_error", float(spread.min()), f"numbers above 0 {QUANTITIES[quantity]}")
        measured[quantity], errors[quantity] = array.reshape(full), np.broadcast_to(spread, shape).reshape(full)
    if not measured:
        raise InputError("amplitude, phase", (None, None), "at least one of the two")
    return Data(axis, along, tuple(directions), measured, errors)


def _finite(name: str, values: Any, unit: str) -> np.ndarray:
    """Values in SI units, or an error that quotes the first one that is not finite."""
    numbers = real_numbers(name, values, unit)
    bad = numbers[~np.isfinite(numbers)]
    if bad.size:
        where = f" ({bad.size} of {numbers.size} values)" if numbers.ndim else ""
        raise InputError(name, f"{values if not numbers.ndim else bad[0]}{where}", f"finite numbers [{unit}]")
    return numbers


@dataclass(frozen=True)
class CurveSetting:
    """Everything that the measured curve depends on."""

    material: Material
    scope: Microscope
    height: float  # tip offset of a frequency sweep, or what is added to the tip offsets of a distance sweep [m]
    amplitude_scale: float = 1.0  # amplitude that the instrument says over the true one [1]
    phase_offset: float = 0.0  # phase that the instrument says less the true one [degree]

    def read(self, amplitude: np.ndarray, phase: np.ndarray) -> dict[str, np.ndarray]:
        """A motion [m, degree] as the instrument says it."""
        return {"amplitude": self.amplitude_scale * amplitude, "phase": phase + self.phase_offset}

    def with_parameter(self, name: str, value: float) -> CurveSetting:
        """The setup with one parameter changed."""
        if name == "phase_offset":
            return replace(self, phase_offset=value)
        if name == "amplitude_scale":
            return replace(self, amplitude_scale=value)
        if name in OFFSETS.values():
            return replace(self, height=value)
        if name == "free_phase":  # what is read far from the surface stays as it is
            scope = _tuned(self.scope, value)
            return replace(self, scope=scope, phase_offset=self.phase_offset + self.scope.free_phase - scope.free_phase)
        if name == "sensitivity":  # the free amplitude read is known, so that the true one changes
            free = self.scope.drive.free_amplitude * self.amplitude_scale * value
            return replace(self.with_parameter("free_amplitude", free), amplitude_scale=1 / value)
        scope = self.scope
        with unquestioned():
            if name in (fields := numbers_of_law(acts := scope.interaction)):
                law = replace(cast(Any, contact_of(acts)), **{fields[name]: value})
                return replace(self, scope=replace(scope, interaction=replace(acts, contact=law)))
            if name == "resonance_frequency":
                lever = replace(scope.cantilever, resonance_frequency=value)
                return replace(self, scope=replace(scope, cantilever=lever))
        changed = Question(self.material, scope).with_parameter(name, value)
        return replace(self, material=changed.material, scope=changed.scope)

    def value(self, name: str) -> float | None:
        """A parameter's value; None if it has none."""
        special = {
            "sensitivity": 1 / self.amplitude_scale,
            "free_phase": self.scope.free_phase,
            **dict.fromkeys(OFFSETS.values(), self.height),
        }
        if name in special:
            return special[name]
        acts = self.scope.interaction
        if name in (fields := numbers_of_law(acts)):
            return float(getattr(contact_of(acts), fields[name]))
        parts = (self.material, self.scope.cantilever, self.scope.tip, self.scope.drive, acts, self)
        return next(getattr(part, name) for part in parts if hasattr(part, name))


def _tuned(scope: Microscope, free_phase: float) -> Microscope:
    """The microscope driven where beside the resonance the free phase [degree] is this, or nearest to it."""
    lever, width = scope.cantilever, min(10 * scope.cantilever.damping_ratio, 0.9)
    ends = 1 - width, 1 + width

    def driven(ratio: float) -> Microscope:
        return replace(scope, drive=replace(scope.drive, frequency=ratio * lever.resonance_frequency))

    with unquestioned():
        least, most = sorted(driven(ratio).free_phase for ratio in ends)
        wanted = min(max(free_phase, least), most)
        at = brentq(lambda ratio: driven(ratio).free_phase - wanted, *ends, xtol=1e-14)
        free = scope.drive.free_amplitude * scope.driven_amplitude / driven(at).driven_amplitude
        return replace(scope, drive=replace(driven(at).drive, free_amplitude=free))


def contact_of(acts: Interaction) -> ContactLaw:
    """The contact law, as an object or name that `Interaction` takes."""
    return LAWS[acts.contact] if isinstance(acts.contact, str) else acts.contact


def numbers_of_law(acts: Interaction) -> dict[str, str]:
    """Names of the numbers that the contact law has of its own, and of its fields."""
    law = type(contact_of(acts))
    names = [name for name, field in vars(law).items() if isinstance(field, Number)]
    return {f"neck_{name}" if law is Neck else name: name for name in names}


@dataclass(frozen=True)
class Parameter:
    """A fitted parameter, in standard deviations q of what is known of it.

    It is least + (start - least) exp(q size), or start + q size.
    """

    name: str
    start: float  # value at q = 0, in `units`
    units: str
    logarithmic: bool
    size: float  # standard deviation of the value beforehand, or of its logarithm
    ends: tuple[float, float] = (0.0, np.inf)  # the least and the most of a logarithmic one

    def q(self, value: float) -> float:
        """The number of standard deviations at which it has this value."""
        if not self.logarithmic:
            return (value - self.start) / self.size
        least = self.ends[0]
        return math.log(max(value - least, math.ulp(1.0) * self.start) / (self.start - least)) / self.size

    def value(self, q: float) -> float:
        """The value at q."""
        if not self.logarithmic:
            return float(self.start + q * self.size)
        least, most = self.ends
        return float(min(least + (self.start - least) * np.exp(q * self.size), most))

    def error(self, q: float, of_q: float) -> float:
        """The error of the value at q, from that of q."""
        return float(of_q * self.size * (self.value(q) - self.ends[0] if self.logarithmic else 1.0))


def check_parameters(names: object, setup: CurveSetting, axis: str) -> tuple[Parameter, ...]:
    """The parameters of these names, as of `spreads_of`, from their values in `setup`."""
    losses, spreads = losses_of(setup.material), spreads_of(names, setup.material)
    spreads = spreads if names is not None else those_that_act(spreads, setup)
    known = (*OF_SAMPLE, *numbers_of_law(setup.scope.interaction), *OF_SCOPE, OFFSETS[axis], *READING)
    known = (*known, "free_phase") if axis == "tip_offset" else known
    parameters = []
    for name, spread in spreads.items():
        if name not in known:
            raise InputError("parameters", name, "names out of " + ", ".join(known))
        if name in ("damping", "viscosity") and name not in losses:
            has = losses[0] if losses else "modulus, adhesion or relaxation_time"
            raise InputError("parameters", name, f"{has}, because that is what the start material has")
        parameters.append(_parameter(name, setup, spread))
    return tuple(sorted(parameters, key=lambda one: one.name == "free_phase"))  # last: of the lever as it then is


def spreads_of(names: Any, material: Material) -> dict[str, float | None]:
    """How well parameters of these names are known: a factor above 1, a standard error, or None, as is usual.

    `names`: a sequence, a mapping to these, or None for modulus, adhesion and what describes the material's losses.
    """
    if names is None:
        return dict.fromkeys(("modulus", "adhesion", *losses_of(material)))
    is_list = isinstance(names, Sequence | Mapping) and not isinstance(names, str)
    if not (is_list and names and all(isinstance(name, str) for name in names)):
        raise InputError("parameters", names, "a sequence of names, such as modulus and adhesion, or a mapping of them")
    spreads = dict(names) if isinstance(names, Mapping) else dict.fromkeys(names)
    if len(spreads) < len(names):
        raise InputError("parameters", names, "every name once")
    return spreads


def those_that_act(spreads: dict[str, float | None], setup: CurveSetting) -> dict[str, float | None]:
    """The parameters but those of sample and law that change nothing: the adhesion of a law without attraction."""
    of_forces = (*OF_SAMPLE, "decay_length", *numbers_of_law(setup.scope.interaction))

    def forces(setting: CurveSetting) -> np.ndarray:
        row = Question(setting.material, setting.scope).work(marched=True).rows[0]
        from_afar = row[col.LONGRANGE] or setting.scope.interaction.law.lossy  # else the columns of no force
        return row if from_afar else np.delete(row, range(col.LONGRANGE, col.DAMPING))

    def acts(name: str) -> bool:
        law = setup.scope.interaction.law
        if name in (taken := {"thickness": law.takes_film, "liquid_film": law.wets}):
            return taken[name]
        value = setup.value(name) if name in of_forces else None
        return not value or not np.array_equal(forces(setup), forces(setup.with_parameter(name, 1.01 * value)))

    return {name: spread for name, spread in spreads.items() if acts(name)}


def losses_of(material: Material) -> tuple[str, ...]:
    """Name of the number that describes a material's losses, damping or viscosity; none for one that relaxes."""
    return () if relaxes(material) else ("damping",) if material.viscosity is None else ("viscosity",)


def _parameter(name: str, setup: CurveSetting, spread: float | None) -> Parameter:
    """Make a parameter that is known beforehand within `spread`; by default within the usual spread of its kind."""
    start, ends = setup.value(name), (0.0, np.inf)
    if field := numbers_of_law(setup.scope.interaction).get(name):
        of_law = number_of(type(contact_of(setup.scope.interaction)), field)
        units, ends = UDUNITS.get(of_law.unit, of_law.unit), of_law.ends
    else:
        units = ALL_UNITS[name]
    if name in (*OFFSETS.values(), *OF_PHASE):
        usual = OF_PHASE.get(name, setup.scope.drive.free_amplitude / REACH)
        most = MOST_TUNED if name == "free_phase" else np.inf
        size = usual if spread is None else number(f"error of {name}", spread, units, above=0, maximum=most)
        return Parameter(name, float(start or 0.0), units, False, size)
    if start is None or not ends[0] < start < ends[1]:
        raise InputError(f"{name} to start from", start, f"a number above {ends[0]:g} {units}".removesuffix(" 1"))
    if spread is not None:
        size = np.log(number(f"factor of {name}", spread, "1", above=1, maximum=FACTOR**2))
    elif name == "resonance_frequency":
        size = WIDTHS * setup.scope.cantilever.damping_ratio
    else:
        size = np.log(KNOWN if name in OF_SCOPE else FACTOR)
    return Parameter(name, start, units, True, float(size), ends)
