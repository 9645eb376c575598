"""What the data say about each pixel, and where they say nothing."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasemap.inference.images.model import PARAMETERS, Model
from phasemap.inference.images.posterior import moments
from phasemap.inference.images.search import Block, Grid
from phasemap.inference.images.stack import HEIGHT, PHASE, Stack

Array = NDArray[np.float64]

UNKNOWN = 0.5  # standard error of a logarithm above which a property is not determined: a factor of 1.6
UNLIKELY = 1e-4  # chance of a chi2 as large, below which the model does not describe a pixel
FLAGS = (
    "modulus_not_determined", "adhesion_not_determined", "damping_not_determined", "poor_fit", "no_orbit", "no_data",
    "averaged_only",
)  # fmt: skip
POOR, NO_ORBIT, NO_DATA, AVERAGED = (1 << FLAGS.index(name) for name in FLAGS[3:])
UNITS = {"modulus": "Pa", "adhesion": "J m-2", "damping": "1"}


class Answer(NamedTuple):
    """Of n pixels."""

    # materials, errors: shape (n, 3); Properties, and standard errors of their logarithms
    materials: Array
    errors: Array
    # chi2, degrees: shape (n,)
    chi2: Array
    degrees: Array
    flags: NDArray[np.uint8]  # shape (n,)
    values: Array  # shape (n, m, 2); phase [rad] and tip offset [m] of these materials in every image

    @classmethod
    def empty(cls, count: int, images: int) -> Answer:
        """To be filled."""
        return cls(
            np.full((count, 3), np.nan), np.full((count, 3), np.nan), np.full(count, np.nan), np.full(count, np.nan),
            np.zeros(count, np.uint8), np.full((count, images, 2), np.nan),
        )  # fmt: skip


def solve_part(model: Model, grid: Grid, stack: Stack, part: slice, answer: Answer) -> None:
    """Fill a part of the answer."""
    from scipy.special import chdtrc

    some = stack.part(part)
    block = Block(model, grid, some)
    found = block.solve()
    covariance = np.linalg.inv(found.information)
    learnt = np.einsum("nij,naj,nai->n", covariance, found.slopes, found.slopes)  # parameters that the data determine
    mean, covariance, _ = moments(block, found)
    errors = np.sqrt(np.einsum("nii->ni", covariance))
    data = np.isfinite(some.errors)
    heights = data[:, :, HEIGHT].sum(axis=1)
    degrees = data[:, :, PHASE].sum(axis=1) + np.maximum(heights - 1, 0) - learnt
    chi2 = (found.rest**2).sum(axis=1)
    flags = ((errors > UNKNOWN) << np.arange(3)).sum(axis=1)
    flags |= (
        POOR * ((degrees > 0.5) & (chdtrc(np.maximum(degrees, 0.5), chi2) < UNLIKELY)) | AVERAGED * ~found.corrected
    )
    lost = ~data.any(axis=(1, 2)), ~found.good
    flags = np.where(lost[0], NO_DATA | 7, np.where(lost[1], NO_ORBIT | 7, flags))
    materials = model.materials(mean)
    failed = lost[0] | lost[1]
    for one in (materials, errors, chi2, degrees, found.values):
        one[failed] = np.nan
    wholes: tuple[Any, ...] = answer
    for whole, values in zip(wholes, (materials, errors, chi2, degrees, flags, found.values), strict=True):
        whole[part] = values


def variables_of(
    answer: Answer, dims: tuple[str, ...], shape: tuple[int, ...], flags: tuple[str, ...] = FLAGS
) -> dict[str, Any]:
    """Variables of a Dataset."""
    found: dict[str, Any] = {}
    for i, name in enumerate(PARAMETERS):
        about = {"long_name": name, "units": UNITS[name], "ancillary_variables": f"{name}_error flag"}
        found[name] = (dims, answer.materials[:, i].reshape(shape), about)
        said = f"standard error of the natural logarithm of the {name}"
        found[f"{name}_error"] = (dims, answer.errors[:, i].reshape(shape), {"long_name": said, "units": "1"})
    found["misfit"] = (
        dims, (answer.chi2 / answer.degrees).reshape(shape),
        {"long_name": "chi2 over degrees of freedom, about 1 where the model describes the data", "units": "1"},
    )  # fmt: skip
    found["flag"] = (
        dims, answer.flags.reshape(shape),
        {
            "long_name": "what the data do not determine, or what went wrong",
            "flag_masks": np.array([1 << i for i in range(len(flags))], np.uint8), "flag_meanings": " ".join(flags),
        },
    )  # fmt: skip
    return found


def settings_of(stack: Stack) -> dict[str, Any]:
    """Variables over the images."""
    amplitudes = [one.drive.free_amplitude for one in stack.scopes]
    return {
        "setpoint": ("image", list(stack.setpoints), {"long_name": "setpoint", "units": "1"}),
        "free_amplitude": ("image", amplitudes, {"long_name": "free amplitude at resonance", "units": "m"}),
    }


def say(answer: Answer) -> str:
    """The flags in one sentence."""
    count = len(answer.flags)
    parts = [f"{name.replace('_', ' ')} {100 * np.mean(answer.flags >> i & 1):.3g} %" for i, name in enumerate(FLAGS)]
    parts = [part for i, part in enumerate(parts) if (answer.flags >> i & 1).any()]
    return f"Of {count}: " + (", ".join(parts) if parts else "everything is determined") + "."
