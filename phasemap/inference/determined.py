"""Prior of the materials, which properties the data determine, and the words for it."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.special import chdtrc

from phasemap._shared.arrays import Array
from phasemap._shared.checks import number
from phasemap._shared.errors import InputError, Word
from phasemap._shared.units import listed
from phasemap.experiment.material import Material

PRIOR = Material(modulus=1e9, adhesion=0.05, damping=0.01)
PARAMETERS = ("modulus", "adhesion", "damping")
UNITS = {"modulus": "Pa", "adhesion": "J m-2", "damping": "1"}
REACH = 3.0  # standard deviations of the prior that least squares search
END = 0.98  # of that range: an unknown beyond has run away
UNKNOWN = 0.5  # standard error of a logarithm above which a property is not determined: a factor of 1.6
UNLIKELY = 1e-4  # chance of a chi2 as large, below which the model does not describe the data
CODES = ("determined", "combination_only", "not_identifiable", "given")
DETERMINED, COMBINED, OPEN, GIVEN = range(len(CODES))


def check_prior(prior: object, factor: object) -> float:
    """Check the prior material and its factor, and return the factor."""
    if not isinstance(prior, Material):
        raise InputError("prior", prior, "a Material")
    remember = "contacts that remember"
    for name, what in (("liquid_film", "wet samples"), ("relaxation_time", remember), ("relaxation", remember)):
        if getattr(prior, name) is not None:
            allowed = f"None, for images of {what} are not inverted"
            raise InputError(f"{name} of the prior", getattr(prior, name), allowed)
    for name in ("modulus", "adhesion"):
        number(f"{name} of the prior", getattr(prior, name), "", above=0)
    number("damping of the prior", prior.damping if prior.viscosity is None else prior.viscosity, "1", above=0)
    return number("prior_factor", factor, "1", above=1, maximum=1e3)


def check_known(known: Mapping[int, Material] | None, names: Collection[int], prior: Material) -> dict[int, Material]:
    """Known materials by the label of their region, of which these are there; films where the prior is one."""
    known = dict(known or {})
    for name, material in known.items():
        if name not in names:
            raise InputError("a region of known material", name, f"one of {', '.join(map(str, names))}")
        if not isinstance(material, Material):
            raise InputError(f"known material of region {name}", material, "a Material")
        for field in ("relaxation_time", "relaxation"):
            if (value := getattr(material, field)) is not None:
                raise InputError(f"{field} of region {name}", value, "None where the region is known")
        if (material.thickness is None) != (prior.thickness is None):
            allowed = "None, as of the prior" if prior.thickness is None else "a number in m, as of the prior"
            hint = "" if prior.thickness is None else "Of a bare one say a thickness far above the tip radius."
            raise InputError(f"thickness of region {name}", material.thickness, allowed, hint)
    if len(known) == len(names):
        raise InputError("known", Word("every region"), "fewer of them: one at least is to be found")
    return known


def add_variable(
    ds: xr.Dataset, name: str, dims: str | tuple[str, ...], values: Any, long_name: str, units: str = "1", **more: Any
) -> None:
    """Add a variable to a Dataset, with its long name and units."""
    ds[name] = (dims, values, {"long_name": long_name, "units": units, **more})


def chance(chi2: Any, degrees: Any) -> Any:
    """Chance that errors as stated make chi2 at least as large."""
    return chdtrc(degrees, chi2)


def codes_of(covariance: Array, information: Array | None = None) -> NDArray[np.int8]:
    """Code of each logarithm by its error: determined by itself, only in combination with others, or not at all.

    `information`: inverse of the covariance, if it is known better than by inverting.
    """
    known = np.linalg.inv(covariance) if information is None else information
    errors, held = np.sqrt(np.diag(covariance)), 1 / np.sqrt(np.diag(known))
    return np.where(errors <= UNKNOWN, DETERMINED, np.where(held <= UNKNOWN, COMBINED, OPEN)).astype(np.int8)


def correlation_of(covariance: Array) -> Array:
    """Correlations of errors with this covariance."""
    size = np.sqrt(np.diag(covariance))
    correlation: Array = covariance / np.outer(size, size)
    np.fill_diagonal(correlation, 1.0)
    return correlation


def say_regions(
    names: list[int], codes: NDArray[np.int8], covariance: NDArray[Any], unknown: NDArray[np.intp]
) -> list[str]:
    """A sentence on each region; `codes` is over regions and properties."""
    sentences, correlation = [], correlation_of(covariance)
    every = [(int(region), name) for region in unknown for name in PARAMETERS]
    for region, label in enumerate(names):
        if (codes[region] == GIVEN).all():
            sentences.append(f"Region {label}: given.")
            continue
        words = [name if other == region else f"the {name} of region {names[other]}" for other, name in every]
        indices = [i for i, (other, _) in enumerate(every) if other == region]
        sentences.append(f"Region {label}: {say_codes(words, codes[unknown].ravel(), correlation, indices)}")
    return sentences


def say_what_helps(zero_unknown: bool, zero_free: bool) -> list[str]:
    """Advice on what to measure where properties stay open."""
    record = "Record the phase of the free lever with every image (phase_zero)"
    return [
        *[record + (', or keep one zero for all (phase_zero="shared").' if zero_free else ".")] * zero_unknown,
        "Add images at another free amplitude, and at setpoints farther apart, or name a material (known).",
    ]


def say_codes(
    names: Sequence[str], codes: NDArray[np.int8], correlation: NDArray[Any], indices: Sequence[int] | None = None
) -> str:
    """Sentence on how well unknowns, or those at the `indices`, are determined."""
    partners = np.abs(correlation)
    np.fill_diagonal(partners, 0.0)
    if (codes == COMBINED).sum() > 1:
        partners[:, codes != COMBINED] = 0.0  # the partner is to be of those in the same case
    parts = []
    indices = range(len(names)) if indices is None else indices
    for code, word in ((DETERMINED, "determined"), (OPEN, "not identifiable")):
        if those := [names[i] for i in indices if codes[i] == code]:
            parts.append(f"{listed(those)} {word}")
    parts += [
        f"{names[i]} only together with {names[int(np.argmax(partners[i]))]}" for i in indices if codes[i] == COMBINED
    ]
    return "; ".join(parts) + "."
