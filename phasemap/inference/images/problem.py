"""Least squares of materials: n problems, each of the same regions in the same images; a pixel is one region.

Phase and height are those of averaged orbits and of a defect, the difference of exact and averaged orbits at the
material found before (theory, Eq. (inversion-3)). A projection takes zeros out (theory, Eq. (inversion-6)).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels.rows.derivatives import Found
from phasemap.inference.images.model import Model, sides_of
from phasemap.inference.images.stack import HEIGHT, PHASE, Stack
from phasemap.inference.images.zeros import Projection, Zeros

Array = NDArray[np.float64]
Codes = NDArray[np.int8]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Problem:
    """The same regions and images in n problems, which differ in their data, branches, and what is expected."""

    model: Model
    unknown: NDArray[np.intp]  # regions whose material is sought, u of r
    data: Array  # shape (n, r, m, 2); phase [rad] and tip offset up to a constant [m]
    weights: Array  # shape (r, m, 2); 1 over their standard errors, 0 without a datum
    sides: Codes  # shape (n, r, m)
    fixed: Array  # shape (n, r, m, 2); of regions of known materials
    projection: Projection
    held: Array  # shape (n, p); what is known of the zeros beforehand, over its standard error
    centre: Array  # shape (n, 3 u); of the prior
    prior: Array  # shape (3 u, 3 u)

    def part(self, chosen: NDArray[Any]) -> Problem:
        """The same for some of the problems."""
        some = {name: getattr(self, name)[chosen] for name in ("data", "sides", "fixed", "held", "centre")}
        return replace(self, **some)

    def orbits(self, q: Array, places: Array, search: bool = False) -> Found:
        """Averaged orbits of these materials near `places`, which are moved to them."""
        n, m, u = len(self.sides), self.sides.shape[2], len(self.unknown)
        there = places[:, self.unknown].reshape(n * u, m)
        found = self.model.averaged(q.reshape(n * u, 3), self.sides[:, self.unknown].reshape(n * u, m), there, search)
        places[:, self.unknown] = there.reshape(n, u, m)
        values = self.fixed.copy()
        values[:, self.unknown] = found.values.reshape(n, u, m, 2)
        good = np.asarray(found.good.reshape(n, u).all(axis=1))
        return Found(values, found.slopes.reshape(n, u, m, 2, 3), good)

    def defect(self, q: Array, places: Array, values: Array) -> tuple[Array, Flags]:
        """How much exact orbits differ from these averaged values, and of which problems all are known."""
        n, r, m = self.sides.shape
        u, sides = len(self.unknown), self.sides[:, self.unknown].reshape(-1, m)
        exact, good = self.model.exact(q.reshape(n * u, 3), sides, places[:, self.unknown].reshape(n * u, m))
        defect = np.zeros((n, r, m, 2))
        defect[:, self.unknown] = np.nan_to_num(exact.reshape(n, u, m, 2) - values[:, self.unknown])
        return defect, (good | (sides == 0)).reshape(n, u * m).all(axis=1)

    def weigh(self, slopes: Array) -> Array:
        """Derivatives of the residuals, shape (n, data and zeros, 3 u)."""
        n, u = slopes.shape[:2]
        size, zeros = self.weights.size, self.held.shape[1]
        full = np.zeros((n, size + zeros, 3 * u))
        parts = full[:, :size].reshape(n, *self.weights.shape, u, 3)
        for i, region in enumerate(self.unknown):
            parts[:, region, :, :, i] = slopes[:, i] * self.weights[region, ..., None]
        full[:, :size] = parts.reshape(n, size, 3 * u)
        return self.projection.without(full)

    def residuals(self, values: Array, defect: Array) -> Array:
        """Weighted residuals at zeros of 0, shape (n, data and zeros)."""
        apart = (self.data - values - defect) * self.weights
        return np.concatenate([apart.reshape(len(apart), self.weights.size), self.held], axis=1)

    def rest(self, values: Array, defect: Array) -> Array:
        """Weighted residuals without what zeros explain."""
        return self.projection.without(self.residuals(values, defect)[..., None])[..., 0]

    def cost(self, values: Array, defect: Array, q: Array) -> Array:
        """chi2 of data and priors, shape (n,)."""
        cost: Array = (self.rest(values, defect) ** 2).sum(axis=1) + self.cost_of_prior(q)
        return cost

    def cost_of_prior(self, q: Array) -> Array:
        """chi2 of the priors, shape (n,)."""
        apart = q - self.centre
        cost: Array = ((apart @ self.prior) * apart).sum(axis=1)
        return cost

    def zeros(self, values: Array, defect: Array) -> Array:
        """The zeros that go with these orbits, shape (n, p)."""
        return self.residuals(values, defect) @ self.projection.inverse.T


def problem_of(
    model: Model, stack: Stack, sides: Codes, zeros: Zeros, fixed: dict[int, Array] | None = None
) -> Problem:
    """The problem of one stack of regions, from each set of branches.

    `sides` (shape (n, r, m)).
    `fixed` (shape (n, m, 2)): phase and tip offset of the regions of known material.
    """
    fixed = fixed or {}
    count, regions, _ = sides.shape
    unknown = np.array([r for r in range(regions) if r not in fixed])
    known = np.zeros((count, *stack.values.shape))
    for r, values in fixed.items():
        known[:, r] = values
    weights = np.where(np.isfinite(stack.errors), 1.0 / stack.errors, 0.0)
    return Problem(
        model, unknown, np.repeat(stack.values[None], count, axis=0), weights, sides, known, zeros.weighted(weights),
        np.zeros((count, len(zeros.widths))), np.tile(model.centre, (count, len(unknown))),
        np.diag(np.tile(model.widths**-2, len(unknown))),
    )  # fmt: skip


def problem_of_pixels(model: Model, stack: Stack) -> Problem:
    """The problem of each pixel, whose topography is the one zero that is unknown; all have the same errors."""
    columns = np.zeros((1, len(stack.setpoints), 2, 1))
    columns[:, :, HEIGHT] = 1.0
    zeros = Zeros(columns, np.array([np.inf]))
    sides = sides_of(stack)[:, None]
    data = stack.values[:, None].copy()
    data[..., PHASE] = (data[..., PHASE] + np.pi) % (2 * np.pi) - np.pi
    return replace(problem_of(model, stack.part(slice(1)), sides, zeros), data=data)
