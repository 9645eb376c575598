"""What the data say about each pixel, and where they say nothing."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasemap.inference.images.descent import normal_equations, refine
from phasemap.inference.images.grid import Grid, descend_from_grid
from phasemap.inference.images.model import Model
from phasemap.inference.images.posterior import moments
from phasemap.inference.images.problem import problem_of_pixels
from phasemap.inference.images.stack import Stack
from phasemap.inference.verdict import PARAMETERS, UNITS, UNKNOWN, UNLIKELY, chance

Array = NDArray[np.float64]

FLAGS = (
    "modulus_not_determined", "adhesion_not_determined", "damping_not_determined", "poor_fit", "no_orbit", "no_data",
    "averaged_only",
)  # fmt: skip
POOR, NO_ORBIT, NO_DATA, AVERAGED = (1 << FLAGS.index(name) for name in FLAGS[3:])


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
    """Fill a part of the answer, pixels with the same errors at a time."""
    numbers = np.arange(len(stack))[part]
    kinds, kind_of = np.unique(stack.errors[part].reshape(len(numbers), -1), axis=0, return_inverse=True)
    for kind in range(len(kinds)):
        _solve(model, grid, stack, numbers[kind_of.reshape(-1) == kind], answer)


def _solve(model: Model, grid: Grid, stack: Stack, some: NDArray[np.intp], answer: Answer) -> None:
    """Fill the answer for pixels with the same errors."""
    stack = stack.part(some)
    problem = problem_of_pixels(model, stack)
    found = refine(problem, descend_from_grid(problem, grid))
    slopes, rest = problem.weigh(found.slopes), problem.rest(found.values, found.defect)
    covariance = np.asarray(np.linalg.inv(normal_equations(problem, slopes, rest, found.q)[0]), np.float64)
    learnt = np.einsum("nij,naj,nai->n", covariance, slopes, slopes)  # parameters that the data determine
    mean, covariance = moments(problem, found, covariance)
    errors = np.sqrt(np.einsum("nii->ni", covariance))
    data = int((problem.weights > 0).sum())
    degrees = data - problem.projection.basis.shape[1] - learnt
    chi2 = (rest**2).sum(axis=1)
    flags = ((errors > UNKNOWN) << np.arange(3)).sum(axis=1)
    flags |= POOR * ((degrees > 0.5) & (chance(chi2, np.maximum(degrees, 0.5)) < UNLIKELY)) | AVERAGED * ~found.exact
    flags = np.full_like(flags, NO_DATA | 7) if not data else np.where(found.good, flags, NO_ORBIT | 7)
    values = model.materials(mean), errors, chi2, degrees, flags, (found.values + found.defect)[:, 0]
    wholes: tuple[Any, ...] = answer
    for whole, one in zip(wholes, values, strict=True):
        whole[some] = one
    for whole in (answer.materials, answer.errors, answer.chi2, answer.degrees, answer.values):
        whole[some[~found.good | (data == 0)]] = np.nan


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
