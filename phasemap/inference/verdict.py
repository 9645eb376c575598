"""When a model does not describe data, how far data determine a property, and the words for it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasemap._shared.sentences import listed

Array = NDArray[np.float64]

PARAMETERS = ("modulus", "adhesion", "damping")
UNITS = {"modulus": "Pa", "adhesion": "J m-2", "damping": "1"}
UNKNOWN = 0.5  # standard error of a logarithm above which a property is not determined: a factor of 1.6
UNLIKELY = 1e-4  # chance of a chi2 as large, below which the model does not describe the data
CODES = ("determined", "combination_only", "not_identifiable", "given")
DETERMINED, COMBINED, OPEN, GIVEN = range(len(CODES))


def chance(chi2: Any, degrees: Any) -> Any:
    """Chance that errors as stated make chi2 at least as large."""
    from scipy.special import chdtrc

    return chdtrc(degrees, chi2)


def codes_of(errors: Array, held: Array) -> NDArray[np.int8]:
    """How well each logarithm is known: by itself, only with the others, or not at all.

    `errors`: with what all others and the zeros leave open; `held`: with all others known.

    Examples
    --------
    >>> codes_of(np.array([0.1, 1.0, 1.0]), np.array([0.1, 0.1, 1.0])).tolist()
    [0, 1, 2]
    """
    return np.where(errors <= UNKNOWN, DETERMINED, np.where(held <= UNKNOWN, COMBINED, OPEN)).astype(np.int8)


def say_regions(
    names: list[int], codes: NDArray[np.int8], covariance: NDArray[Any], unknown: NDArray[np.intp]
) -> list[str]:
    """A sentence on each region; `codes` is over regions and properties."""
    said = []
    correlation = np.abs(covariance / np.sqrt(np.outer(np.diag(covariance), np.diag(covariance))))
    np.fill_diagonal(correlation, 0.0)
    if (codes == COMBINED).sum() > 1:
        correlation[:, codes[unknown].ravel() != COMBINED] = 0.0  # the partner is to be of those in the same case
    every = [(int(region), name) for region in unknown for name in PARAMETERS]
    for region, label in enumerate(names):
        own = codes[region]
        if (own == GIVEN).all():
            said.append(f"Region {label}: given.")
            continue
        parts = []
        for code, word in ((DETERMINED, "determined"), (OPEN, "not identifiable")):
            those = [name for name, one in zip(PARAMETERS, own, strict=True) if one == code]
            if those:
                parts.append(f"{listed(those)} {word}")
        for k, name in enumerate(PARAMETERS):
            if own[k] == COMBINED:
                other, partner = every[int(np.argmax(correlation[every.index((region, name))]))]
                with_it = partner if other == region else f"the {partner} of region {names[other]}"
                parts.append(f"{name} only together with {with_it}")
        said.append(f"Region {label}: {'; '.join(parts)}.")
    return said
