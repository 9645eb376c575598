"""By how much what an image says of a pixel may differ from what is found there again."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels import columns as col
from phasemap._shared.arrays import Array
from phasemap.experiment.lever import lever_of
from phasemap.imaging.engaged import DEEPEST
from phasemap.validation.checking.picture import MEAN, Picture

Values = Mapping[str, Any]

QUANTITIES = ("phase", "height", "mean_deflection", "indentation", "dissipation", "virial")
SAMPLED = 1e-3  # of the amplitude: the deepest of the points at which a solver evaluates the force; 5e-4 was measured
OF = {"phase": "phase", "height": "amplitude"}  # whose spread goes with the mean of each
IRREGULAR = 0.1, 20e-12  # [degree, m] to which the mean of irregular motion is known, beside what its spread leaves


class Errors(NamedTuple):
    """Errors of phase [degree] and height [m] of some pixels; NaN where they are not known."""

    phase: Array
    height: Array


def stated(picture: Picture, pixels: NDArray[np.intp]) -> Errors:
    """What the image states, or what was asked for where it has no such variables; averaging states nothing."""
    claims, errors = picture.claims, []
    for name in Errors._fields:
        if f"error_{name}" in picture:
            errors.append(picture[f"error_{name}"].reshape(-1)[pixels])
        else:
            usual = np.nan if claims.solver == "averaging" else getattr(claims.accuracy, name)
            errors.append(np.full(len(pixels), usual))
    return Errors(*errors)


def allowed(
    picture: Picture, pixels: NDArray[np.intp], again: Values, errors: Errors, approximate: NDArray[np.bool_]
) -> dict[str, Array]:
    """Largest differences of `QUANTITIES`, for such errors of phase and height in all; NaN where one says nothing.

    An error e of the phase is one of the force's first harmonic, k u0 e, of the drive's work, pi k u0 A e, and of the
    virial, k u0 A e / 2; of a force that acts for a part of the period the mean is at most half the first harmonic.
    Twice as much is allowed, and more for the virial. Approximate pixels, averaged or interpolated ones, are as exact
    as the image was asked to be (`imaging.tolerances.tolerances_of`). Of irregular motion the means of phase and height
    are compared.
    """
    claims, lever = picture.claims, lever_of(picture.claims.microscope)
    base, length = lever[col.DRIVE], np.where(approximate, claims.accuracy.height, 0.0)
    phase = np.radians(np.where(approximate, np.maximum(errors.phase, claims.accuracy.phase), errors.phase))
    work = np.pi * lever[col.STIFFNESS] * base * claims.amplitude * phase
    largest = {
        "phase": errors.phase,
        "height": errors.height,
        "mean_deflection": 2 * base * phase + length,
        "indentation": errors.height + SAMPLED * claims.amplitude + DEEPEST * length,
        "dissipation": work,
        "virial": work,
    }
    irregular = picture.irregular.reshape(-1)[pixels] | (again["motion"] == 1)
    means = dict(zip(("phase", "height"), IRREGULAR, strict=True))
    for name, values in largest.items():
        mean = means[name] + MEAN * spread(picture, pixels, again, OF[name]) if name in means else np.nan
        largest[name] = np.where(irregular, mean, values) + picture.coarse(name)
    return largest


def spread(picture: Picture, pixels: NDArray[np.intp], again: Values, name: str) -> Array:
    """The larger of the spreads that the image states and that were found again."""
    return np.fmax(picture.spread(name).reshape(-1)[pixels], again[f"{name}_spread"])
