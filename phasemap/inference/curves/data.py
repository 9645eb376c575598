"""Measured curves, checked or as they were recorded, and what may be fitted to them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from phasemap._shared.arrays import real_numbers, within_half_a_turn
from phasemap._shared.checks import number
from phasemap._shared.errors import InputError
from phasemap._shared.fields import Number, number_of
from phasemap._shared.notices import unquestioned
from phasemap._shared.units import UDUNITS
from phasemap.experiment.interaction import Capillary, ContactLaw, Interaction, LossyDMT, Neck
from phasemap.experiment.interaction.contact import LAWS
from phasemap.experiment.material import Material, relaxes
from phasemap.experiment.microscope import Microscope
from phasemap.inference.verdict import PRIOR, REACH
from phasemap.solvers.continuation.path import UNITS, Question
from phasemap.sweeps.sweep import check_axis

if TYPE_CHECKING:
    import xarray as xr


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

BINS, FLAT = 30, 5  # of the distances at which something acts on the tip, and of those beyond
FINE = 100  # parts of a curve, whose means tell where something acts
ACTS = 0.005  # of the free amplitude, that is missing where something acts
FLOORS = {"amplitude": 5e-4, "phase": 0.1}  # least errors: of the free amplitude, and [degree]
ONE_WAY = {"amplitude": 2e-3, "phase": 0.3}  # the same where no second direction says how well a curve repeats
NORMAL = 1.4826  # standard deviation over the median absolute deviation
ZERO = 0.3  # error of the phase of the free lever [degree]
CALIBRATED, GUESSED = 1.05, 1.15  # factors within which the sensitivity of the amplitude is known
NECK, FILM, LIQUID = 1e-9, 5e-9, 0.4e-9  # length and thicknesses to start from [m]
LOSS = 1e-7  # loss outside contact to start from [N s/m]
BEGUN = {"neck": Neck(NECK), "capillary": Capillary(tip_film=0.0), "lossy dmt": LossyDMT(2.0, LOSS)}
"""Laws with parameters; a liquid film is that of tip and sample together, which a curve does not tell apart."""
FITTED = ("neck_length", "adhesion_ratio", "outer_loss")
"""Of these, what is fitted unasked where it is not at its least."""
EVERY = (*dict.fromkeys(("dmt", *LAWS)), "neck", "lossy dmt")


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

    def read(self, amplitude: np.ndarray, phase: np.ndarray) -> dict[str, np.ndarray]:
        """A motion [m, degree] as the instrument says it."""
        return {"amplitude": self.amplitude_scale * amplitude, "phase": phase + self.phase_offset}

    def with_parameter(self, name: str, value: float) -> Setup:
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
            if name in (own := numbers_of_law(acts := scope.interaction)):
                law = replace(cast(Any, contact_of(acts)), **{own[name]: value})
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
        if name in (own := numbers_of_law(acts)):
            return float(getattr(contact_of(acts), own[name]))
        parts = (self.material, self.scope.cantilever, self.scope.tip, self.scope.drive, acts, self)
        found: float | None = next(getattr(part, name) for part in parts if hasattr(part, name))
        return found


def _tuned(scope: Microscope, free_phase: float) -> Microscope:
    """The microscope driven beside the resonance, so that the free lever has this phase [degree] and its amplitude."""
    from scipy.optimize import brentq

    lever, width = scope.cantilever, 3 * scope.cantilever.damping_ratio

    def driven(ratio: float) -> Microscope:
        return replace(scope, drive=replace(scope.drive, frequency=ratio * lever.resonance_frequency))

    with unquestioned():
        at = brentq(lambda ratio: driven(ratio).free_phase - free_phase, max(1 - width, 0.05), 1 + width, xtol=1e-14)
        free = scope.drive.free_amplitude * scope.driven_amplitude / driven(at).driven_amplitude
        return replace(scope, drive=replace(driven(at).drive, free_amplitude=free))


def contact_of(acts: Interaction) -> ContactLaw:
    """The contact law as it was given."""
    return LAWS[acts.contact] if isinstance(acts.contact, str) else acts.contact


def numbers_of_law(acts: Interaction) -> dict[str, str]:
    """Names of the numbers that the contact law has of its own, and of its fields."""
    law = type(contact_of(acts))
    names = [name for name, field in vars(law).items() if isinstance(field, Number)]
    return {f"neck_{name}" if law is Neck else name: name for name in names}


@dataclass(frozen=True)
class Parameter:
    """One fitted parameter, by standard deviations q of what is known of it.

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


def check_parameters(names: object, setup: Setup, axis: str) -> tuple[Parameter, ...]:
    """The parameters of these names, from their values in `setup`; None for modulus, adhesion and damping.

    `names`: a sequence, or a mapping to how well each is known: a factor above 1, a standard error, or None.
    """
    losses = losses_of(setup.material)
    if names is None:
        names = ("modulus", "adhesion", *losses)
    known = (*OF_SAMPLE, *numbers_of_law(setup.scope.interaction), *OF_SCOPE, OFFSETS[axis], *READING)
    known = (*known, "free_phase") if axis == "tip_offset" else known
    if not isinstance(names, Sequence | Mapping) or isinstance(names, str) or not names:
        raise InputError("parameters", names, "a sequence of names out of " + ", ".join(known))
    found = []
    for i, name in enumerate(names):
        if name not in known:
            raise InputError("parameters", name, "names out of " + ", ".join(known))
        if name in ("damping", "viscosity") and name not in losses:
            has = losses[0] if losses else "modulus, adhesion or relaxation_time"
            raise InputError("parameters", name, f"{has}, because that is what the start material has")
        if name in list(names)[:i]:
            raise InputError("parameters", name, "every name once")
        found.append(_parameter(name, setup, names[name] if isinstance(names, Mapping) else None))
    return tuple(sorted(found, key=lambda one: one.name == "free_phase"))  # last: of the lever as it then is


def losses_of(material: Material) -> tuple[str, ...]:
    """What number of a material is its loss: none of one that relaxes."""
    return () if relaxes(material) else ("damping",) if material.viscosity is None else ("viscosity",)


def _parameter(name: str, setup: Setup, spread: float | None) -> Parameter:
    """A parameter that is known within `spread`, by default as well as such a one mostly is."""
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


class Recorded(NamedTuple):
    """Arguments of a fit."""

    distances: np.ndarray  # [m]; 0 where the tip was nearest
    given: dict[str, tuple[Any, Any]]  # amplitude [m] and phase [degree] with their errors
    directions: tuple[str, ...]
    scope: Microscope  # with the free amplitude of the curve
    offset: float  # tip offset at the distance 0, for a hard surface [m]
    parameters: dict[str, float | None]  # what is to be fitted, and how well it is known beforehand


def of_curve(curve: xr.Dataset, scope: Microscope, start: Material) -> Recorded:
    """What a curve of `phasemap.read_curve` says, for a material like `start`."""
    if not {"distance", "amplitude"} <= set(curve.data_vars):
        raise InputError("the curve", ", ".join(map(str, curve.data_vars)), "one of phasemap.read_curve")
    attrs, volts = curve.attrs, curve["amplitude"].attrs.get("units") == "V"
    sensitivity = float(attrs.get("amplitude_sensitivity", np.nan)) if volts else 1.0
    free = sensitivity * float(attrs.get("free_amplitude_voltage" if volts else "free_amplitude", np.nan))
    if not free > 0:
        raise InputError("free amplitude of the curve", None, "a curve whose far end shows the free lever")
    z = curve["distance"].values
    values = {"amplitude": sensitivity * curve["amplitude"].values}
    if "phase" in curve and "phase_zero" in attrs:
        values["phase"] = within_half_a_turn(
            attrs.get("phase_sign", 1.0) * (curve["phase"].values - attrs["phase_zero"])
        )
    end = float(np.nanmin(np.nanmax(z, axis=1)))
    fine = np.linspace(0.0, end, FINE + 1)
    means_of = [_binned(*one, fine)[0] for one in zip(z, values["amplitude"], strict=True)]
    far = float(fine[1:][(np.array(means_of) < (1 - ACTS) * free).any(axis=0)].max(initial=fine[1]))
    acting = np.linspace(0.0, far, BINS + 1)
    edges = np.concatenate([acting, np.linspace(far, end, FLAT + 1)[1:]]) if end > far + acting[1] else acting
    means, errors = {}, {}
    for name, every in values.items():
        binned = np.array([_binned(*one, edges) for one in zip(z, every, strict=True)])
        means[name], scatter = binned[:, 0], binned[:, 1]
        again = np.repeat(
            [_repeats(part, name) for part in np.split(means[name], [BINS], axis=1)], [BINS, scatter.shape[1] - BINS]
        )
        errors[name] = np.hypot(scatter, again * (free if name == "amplitude" else 1.0))
    seen = np.isfinite(sum(means.values()) + sum(errors.values())).all(axis=0)
    middles = 0.5 * (edges[1:] + edges[:-1])[seen]
    if len(middles) < 5:
        raise InputError("the curve", f"{len(middles)} distances at which something acts", "5 at least, each way")
    drive = scope.drive
    scope = replace(scope, drive=replace(drive, free_amplitude=free * drive.free_amplitude / scope.driven_amplitude))
    named = ("modulus", "adhesion", *losses_of(start), "offset", "radius")
    parameters: dict[str, float | None] = dict.fromkeys(named)
    parameters["sensitivity"] = GUESSED if volts else CALIBRATED
    if "phase" in values:
        parameters |= {"phase_offset": ZERO, "free_phase": None}
    given = {name: (means[name][:, seen], errors[name][:, seen]) for name in means}
    return Recorded(
        middles, given, tuple(map(str, curve["direction"].values)), scope,
        float(means["amplitude"][:, seen][:, 0].mean() - middles[0]), parameters,
    )  # fmt: skip


def _binned(z: np.ndarray, values: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means of one direction between the edges, and their standard errors; NaN where there are not two."""
    count, total, square = (
        np.histogram(z[known := np.isfinite(z + values)], edges, weights=(values[known] ** power))[0]
        for power in range(3)
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(count > 0, total / count, np.nan)
        error = np.sqrt(np.maximum(square / count - mean**2, 0.0) / np.maximum(count - 1, 1))
    return mean, error


def _repeats(means: np.ndarray, name: str) -> float:
    """How well both directions repeat each other, where they are on one branch: for most distances."""
    if len(means) < 2 or not np.isfinite(means[1] - means[0]).any():
        return ONE_WAY[name]
    apart = NORMAL * np.nanmedian(np.abs(means[1] - means[0])) / np.sqrt(2.0)
    return float(max(FLOORS[name], apart / (np.nanmax(means) if name == "amplitude" else 1.0)))


def begun(start: Material) -> Material:
    """A material to start from: what it lacks of adhesion and damping is that of the prior."""
    adhesion = start.adhesion or PRIOR.adhesion
    if start.damping or start.viscosity or relaxes(start):
        return replace(start, adhesion=adhesion)
    return replace(start, adhesion=adhesion, damping=PRIOR.damping, viscosity=None)


def under(law: object, scope: Microscope, start: Material) -> tuple[Microscope, Material, dict[str, float | None]]:
    """Microscope and start under a law, and the parameters that it adds.

    `law`: a name of `EVERY` or `BEGUN`, or an `Interaction`.
    """
    names = dict.fromkeys((*EVERY, *BEGUN))
    if isinstance(law, str) and law.lower() not in names:
        raise InputError("law", law, "one of " + ", ".join(names))
    own = law if isinstance(law, Interaction) else Interaction(BEGUN.get(str(law).lower(), str(law)))
    more: dict[str, float | None] = {}
    if own.law.takes_film:
        start, more["thickness"] = replace(start, thickness=start.thickness or FILM), None
    if own.law.wets:
        start, more["liquid_film"] = replace(start, liquid_film=start.liquid_film or LIQUID), None
    for name, field in numbers_of_law(own).items():
        if name in FITTED and getattr(own.contact, field) > number_of(type(own.contact), field).ends[0]:
            more[name] = None
    if isinstance(law, str) and own.law.hysteretic and not (own.law.may_do_without_neck or own.law.wets):
        own = replace(own, decay_length=None)  # a neck beside a force that reaches farther would create energy
    if own.decay_length is not None:
        more["decay_length"] = 2.0
    return replace(scope, interaction=own), start, more
