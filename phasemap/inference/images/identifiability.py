"""Which materials of regions the data determine, and what else would."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from phasemap._shared.sentences import listed
from phasemap.inference.images.joint import Fitted, Joint
from phasemap.inference.images.model import PARAMETERS
from phasemap.inference.images.verdict import UNKNOWN
from phasemap.inference.images.zeros import SHARED, Plan

Array = NDArray[np.float64]

CODES = ("determined", "combination_only", "not_identifiable", "given")
DETERMINED, COMBINED, OPEN, GIVEN = range(len(CODES))


def codes_of(errors: Array, held: Array) -> NDArray[np.int8]:
    """How well each logarithm is known: by itself, only with the others, or not at all.

    `errors`: with what all others and the zeros leave open.

    Examples
    --------
    >>> codes_of(np.array([0.1, 1.0, 1.0]), np.array([0.1, 0.1, 1.0])).tolist()
    [0, 1, 2]
    """
    return np.where(errors <= UNKNOWN, DETERMINED, np.where(held <= UNKNOWN, COMBINED, OPEN)).astype(np.int8)


def errors_with(joint: Joint, slopes: Array, plan: Plan, leave_out: int | None = None) -> Array:
    """Errors of the logarithms if the zeros were as planned, to first order, shape (3 u,).

    `slopes` (shape (u, m, 2, 3)).
    `leave_out`: which of the unknown regions would be known; its errors are 0.
    """
    zeros = plan.zeros(len(joint.weights))
    other = replace(
        joint.part(np.array([0])), projection=zeros.weighted(joint.weights), held=np.zeros((1, len(zeros.widths)))
    )
    weighed = other.weigh(slopes[None])[0]
    information = weighed.T @ weighed + joint.prior
    kept = np.ones(len(information), bool)
    if leave_out is not None:
        kept[3 * leave_out : 3 * leave_out + 3] = False
    errors = np.zeros(len(information))
    errors[kept] = np.sqrt(np.diag(np.linalg.inv(information[np.ix_(kept, kept)])))
    return errors


def say_regions(names: list[int], codes: NDArray[np.int8], information: Array, unknown: NDArray[np.intp]) -> list[str]:
    """A sentence on each region; `codes` is over regions and properties."""
    said = []
    covariance = np.linalg.inv(information)
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


def advise(joint: Joint, found: Fitted, plan: Plan, names: list[int]) -> list[str]:
    """What would determine more, to first order; nothing if all is determined."""
    if (np.sqrt(np.diag(found.covariance)) <= UNKNOWN).all():
        return []
    options: list[tuple[str, Plan, int | None]] = []
    if plan.phase is not None:
        known = replace(plan, phase=None, phase_error=np.zeros_like(plan.phase_error))
        options.append(("record the phase of the free lever (phase_zero)", known, None))
        if plan.phase != SHARED:
            options.append(("keep one zero of the phase for all images (phase_zero='shared')",
                            replace(plan, phase=SHARED), None))  # fmt: skip
    if joint.weights[..., 1].any():
        if plan.height is not None:
            known = replace(plan, height=None, height_error=np.zeros_like(plan.height_error))
            options.append(("know how the zero of the height moves between images (height_zero)", known, None))
        if plan.topography_error > 0:
            flat = replace(plan, topography_error=0.0)
            options.append(("know that the surface is flat (topography_error=0)", flat, None))
    if len(names) > 1:
        options += [(f"know the material of region {names[r]} (known)", plan, i) for i, r in enumerate(joint.unknown)]
    now = errors_with(joint, found.slopes, plan)
    said = []
    for what, other, left in options:
        kept = np.arange(len(now)) // 3 != left
        then = errors_with(joint, found.slopes, other, left)
        more = int((then[kept] <= UNKNOWN).sum())
        if more > (now[kept] <= UNKNOWN).sum():
            said.append(f"It would help to {what}: {more} of {kept.sum()} properties would be determined.")
    return [*said, "It would help to add images at another free amplitude, and at setpoints farther apart."]
