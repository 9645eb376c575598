"""Curves of `phasemap.read_curve` as data of a fit, and the parameters that contact laws add."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from phasemap._shared.arrays import within_half_a_turn
from phasemap._shared.errors import InputError, Word
from phasemap._shared.fields import number_of
from phasemap._shared.notices import unquestioned
from phasemap.experiment.interaction import Capillary, ContactLaw, Interaction, LossyDMT, Neck, may_remember
from phasemap.experiment.interaction.contact import LAWS
from phasemap.experiment.material import Material, relaxes
from phasemap.experiment.microscope import Microscope
from phasemap.inference.curves.data import CurveSetting, numbers_of_law, spreads_of, those_that_act
from phasemap.inference.determined import PRIOR
from phasemap.io.metadata import recorded_sign

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
"""Numbers of contact laws that are fitted unasked where they are above their least value."""
PARTS = ("decay_length", "damping_exponent", "bias", "longrange", "withdrawal")
"""What an interaction says beside its contact law; a withdrawal is refused by what stands before it."""
EVERY = (*dict.fromkeys(("dmt", *LAWS)), "neck", "lossy dmt")


class FitArguments(NamedTuple):
    """Arguments of a fit."""

    distances: np.ndarray  # [m]; 0 where the tip was nearest
    given: dict[str, tuple[Any, Any]]  # amplitude [m] and phase [degree] with their errors
    directions: tuple[str, ...]
    scope: Microscope  # with the free amplitude of the curve
    offset: float  # tip offset at the distance 0, for a hard surface [m]
    parameters: dict[str, float | None]  # what is to be fitted, and how well it is known beforehand


def of_curve(curve: xr.Dataset, scope: Microscope, start: Material, asked: Any = None) -> FitArguments:
    """Arguments of a fit to a curve of `phasemap.read_curve`, for a material like `start`.

    `asked`: parameters to be fitted in place of the usual ones, or a mapping of what is known otherwise, or more.
    """
    if not {"distance", "amplitude", "direction"} <= set(curve.variables):
        raise InputError("the curve", ", ".join(map(str, curve.variables)), "one of phasemap.read_curve")
    curve = curve if curve["direction"].ndim else curve.expand_dims("direction")
    attrs, volts = curve.attrs, curve["amplitude"].attrs.get("units") == "V"
    sensitivity = float(attrs.get("amplitude_sensitivity", np.nan)) if volts else 1.0
    free = sensitivity * float(attrs.get("free_amplitude_voltage" if volts else "free_amplitude", np.nan))
    if not free > 0:
        raise InputError(
            "free amplitude of the curve", None, "a number: the curve's far end has to show the free lever"
        )
    z = curve["distance"].values
    values = {"amplitude": sensitivity * curve["amplitude"].values}
    if "phase" in curve and "phase_zero" in attrs:
        from_free = recorded_sign(attrs) * (curve["phase"].values - attrs["phase_zero"])
        values["phase"] = within_half_a_turn(from_free + scope.free_phase)
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
        repeatability = np.repeat(
            [_repeats(part, name) for part in np.split(means[name], [BINS], axis=1)], [BINS, scatter.shape[1] - BINS]
        )
        errors[name] = np.hypot(scatter, repeatability * (free if name == "amplitude" else 1.0))
    seen = np.isfinite(sum(means.values()) + sum(errors.values())).all(axis=0)
    middles = 0.5 * (edges[1:] + edges[:-1])[seen]
    if len(middles) < 5:
        raise InputError("the curve", Word(f"{len(middles)} distances at which something acts"), "5 at least, each way")
    drive = scope.drive
    scope = replace(scope, drive=replace(drive, free_amplitude=free * drive.free_amplitude / scope.driven_amplitude))
    parameters: dict[str, float | None] = {**spreads_of(None, start), "offset": None, "radius": None}
    parameters["sensitivity"] = GUESSED if volts else CALIBRATED
    if "phase" in values:
        parameters |= {"phase_offset": ZERO, "free_phase": None}
    if isinstance(asked, Mapping):
        parameters |= asked
    elif asked is not None:
        parameters = {name: parameters.get(name) for name in spreads_of(asked, start)}
    given = {name: (means[name][:, seen], errors[name][:, seen]) for name in means}
    offset = float(given["amplitude"][0][:, 0].mean() - middles[0])  # of a hard surface, where the tip is nearest
    directions = tuple(map(str, curve["direction"].values))
    return FitArguments(middles, given, directions, scope, offset, parameters)


def check_unsaid(offset: float, **given: Any) -> None:
    """Refuse what is given beside a curve that was read, which has its own."""
    for name, value in {"offset": offset or None, **given}.items():
        if value is not None:
            hint = 'One direction is curve.sel(direction="approach").' if name == "direction" else ""
            raise InputError(name, Word("given"), "nothing beside a curve that was read, which has its own", hint)


def with_law(parameters: Any, setup: CurveSetting, more: dict[str, float | None]) -> dict[str, float | None]:
    """What is fitted with what a law adds, as far as it acts; what is said of how well that is known is kept."""
    spreads = spreads_of(parameters, setup.material)
    every = {**spreads, **more, **{name: spread for name, spread in spreads.items() if spread is not None}}
    return those_that_act(every, setup)


def _binned(z: np.ndarray, values: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means of one direction between the edges, and their standard errors; NaN where there is no value.

    A single value spreads as values of the other bins do in the middle; 0 where all bins have one.
    """
    count, total, square = (
        np.histogram(z[known := np.isfinite(z + values)], edges, weights=(values[known] ** power))[0]
        for power in range(3)
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(count > 0, total / count, np.nan)
        error = np.sqrt(np.maximum(square / count - mean**2, 0.0) / np.maximum(count - 1, 1))
    if (count > 1).any():
        error[count == 1] = np.median((error * np.sqrt(count))[count > 1])
    return mean, error


def _repeats(means: np.ndarray, name: str) -> float:
    """Difference of approach and retract at the same distance, its median: an estimate of the error of the data."""
    if len(means) < 2 or not np.isfinite(means[1] - means[0]).any():
        return ONE_WAY[name]
    apart = NORMAL * np.nanmedian(np.abs(means[1] - means[0])) / np.sqrt(2.0)
    return float(max(FLOORS[name], apart / (np.nanmax(means) if name == "amplitude" else 1.0)))


def begun(start: Material, asked: Any) -> Material:
    """Material to start from; adhesion and damping that it lacks are those of the prior, where they are fitted.

    `asked`: as of `of_curve`.
    """
    fitted = asked if isinstance(asked, Sequence) else ("adhesion", "damping")
    if "adhesion" in fitted:
        start = replace(start, adhesion=start.adhesion or PRIOR.adhesion)
    if "damping" not in fitted or start.damping or start.viscosity or relaxes(start):
        return start
    return replace(start, damping=PRIOR.damping, viscosity=None)


def compared(laws: Any, scope: Microscope, start: Material) -> tuple[list[Any], str]:
    """Contact laws to compare, and what is said of those that "all" leaves out."""
    if laws is None:
        return [scope.interaction], ""
    if laws != "all":
        return [laws] if isinstance(laws, str) else list(laws), ""
    known = [
        law for law in EVERY
        if not relaxes(start) or may_remember(under(law, scope, start)[0].interaction.law, relaxes=True)
    ]  # fmt: skip
    unknown = [law for law in EVERY if law not in known]
    return known, f"Not compared, because they know no relaxation: {', '.join(unknown)}." if unknown else ""


def under(law: object, scope: Microscope, start: Material) -> tuple[Microscope, Material, dict[str, float | None]]:
    """Microscope and start under a law, or a name of `EVERY` or `BEGUN`, and the parameters that it adds."""
    names = dict.fromkeys((*EVERY, *BEGUN))
    if isinstance(law, str) and law.lower() not in names:
        raise InputError("law", law, "one of " + ", ".join(names))
    interaction = law if isinstance(law, Interaction) else _named(str(law), scope.interaction)
    more: dict[str, float | None] = {}
    if interaction.law.takes_film:
        start, more["thickness"] = replace(start, thickness=start.thickness or FILM), None
    if interaction.law.wets:
        start, more["liquid_film"] = replace(start, liquid_film=start.liquid_film or LIQUID), None
    for name, field in numbers_of_law(interaction).items():
        if name in FITTED and getattr(interaction.contact, field) > number_of(type(interaction.contact), field).ends[0]:
            more[name] = None
    if interaction.decay_length is not None:
        more["decay_length"] = 2.0
    return replace(scope, interaction=interaction), start, more


def _named(name: str, given: Interaction) -> Interaction:
    """Interaction with a law of `EVERY` or `BEGUN`, and else as given, but for what the law refuses."""
    interaction = Interaction(BEGUN.get(name.lower(), name))
    for part in PARTS:
        with suppress(InputError), unquestioned():
            changed = replace(interaction, **{part: getattr(given, part)})
            changed.law.pull(np.array([PRIOR.modulus]), np.array([PRIOR.adhesion]), FILM)  # a cone's needs its reach
            interaction = changed
    if interaction.law.hysteretic and not (interaction.law.may_do_without_neck or interaction.law.wets):
        # A neck beside a force that reaches farther would create energy.
        interaction = replace(interaction, decay_length=None)
    return interaction


def as_known_to(law: ContactLaw, start: Material) -> tuple[Material, str]:
    """The start as a law among several can have it, and what is said of what it does not know."""
    foreign = ("thickness",) * (not law.takes_film) + ("liquid_film", "contact_angle") * (not law.wets)
    lost: dict[str, Any] = dict.fromkeys(name for name in foreign if getattr(start, name) is not None)
    sentence = f"{law.name} contact is fitted without {', '.join(lost)} of the start, which it does not know."
    return replace(start, **lost), sentence if lost else ""


def refused(given: Interaction, kept: Interaction) -> str:
    """What is said of the parts of a given interaction that a law could not keep."""
    lost = [part for part in PARTS if getattr(kept, part) != getattr(given, part)]
    sentence = f"Not as in the microscope's interaction, for {kept.law.name} contact refuses it: {', '.join(lost)}."
    return sentence if lost else ""
