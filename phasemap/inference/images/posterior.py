"""Mean and covariance of what the data leave possible, where a parabola is too simple.

What is weakly determined is mostly one combination of the properties: chi2 has a long valley, curved and skewed. It is
followed to both sides of the best material, and the posterior integrated along it; across it, it is taken as normal.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasemap.inference.images.descent import normal_equations
from phasemap.inference.images.search import Block, Solution

Array = NDArray[np.float64]

SHARP = 0.05  # standard error of every logarithm below which the parabola will do
FIRST, GROWTH, STEPS = 0.5, 1.3, 7  # steps along the valley: in its standard deviations, each longer, to either side
DEEP = 20.0  # chi2 above the least, at which a side is done
SHALLOW = 6.0  # the same, above which a side that ends is cut off
LONGEST = 1.0  # of a correction across the valley, in a logarithm


class Moments(NamedTuple):
    """Mean, shape (n, 3), and covariance, shape (n, 3, 3), of the logarithms; mean of the residuals, shape (n, 2 m)."""

    mean: Array
    covariance: Array
    rest: Array


class _Valleys(NamedTuple):
    """Directions along and across the valleys of n pixels, places along them, and what is found at k of them.

    Shapes (n, 3), (n, 3, 2), (n, k); logarithms of the density, (n, k), conditional means, (n, k, 3), and covariances,
    (n, k, 3, 3), and residuals, (n, k, 2 m).
    """

    along: Array
    across: Array
    places: Array
    logs: Array
    points: Array
    spreads: Array
    rests: Array


def moments(block: Block, found: Solution) -> Moments:
    """What the data leave possible."""
    mean, covariance, rest = found.q.copy(), np.asarray(np.linalg.inv(found.information), np.float64), found.rest.copy()
    wide = (np.einsum("nii->ni", covariance) > SHARP**2).any(axis=1)
    wide = np.flatnonzero(wide & found.good & (block.sides != 0).any(axis=1))
    if len(wide):
        parts = _integrate(block.part(wide), found.part(wide), covariance[wide])
        mean[wide], covariance[wide], rest[wide] = parts
    return Moments(mean, covariance, rest)


def _integrate(block: Block, found: Solution, covariance: Array) -> Moments:
    """Moments along the valleys of some pixels."""
    sizes, axes = np.linalg.eigh(covariance)
    along, across = axes[:, :, 2], axes[:, :, :2]
    unit = np.sqrt(sizes[:, 2])
    count = 2 * STEPS + 1
    lengths = unit[:, None] * np.cumsum(FIRST * GROWTH ** np.arange(STEPS))
    places = np.concatenate([-lengths[:, ::-1], np.zeros((len(unit), 1)), lengths], axis=1)
    logs = np.full((len(unit), count), -np.inf)
    points, spreads = np.zeros((len(unit), count, 3)), np.zeros((len(unit), count, 3, 3))
    rests = np.zeros((len(unit), count, found.rest.shape[1]))
    for sign in (-1, 1):
        _walk(block, found, _Valleys(along, across, places, logs, points, spreads, rests), sign)
    weights = _trapezoids(places)
    lost = np.isneginf(logs).all(axis=1)
    logs[lost, STEPS], points[lost, STEPS], spreads[lost, STEPS] = 0.0, found.q[lost], covariance[lost]
    rests[lost, STEPS] = found.rest[lost]
    weights = weights * np.exp(logs - logs.max(axis=1, keepdims=True))
    weights /= weights.sum(axis=1, keepdims=True)
    mean = np.einsum("nk,nki->ni", weights, points)
    apart = points - mean[:, None]
    spread = np.einsum("nk,nkij->nij", weights, spreads + apart[..., None] * apart[..., None, :])
    # Where the valley could not be followed to its sides, it may go on: the parabola's width is the least.
    cut = ~(_fallen(logs) & _fallen(logs[:, ::-1]))
    apart = found.q - mean
    wider = spread + covariance + apart[:, :, None] * apart[:, None, :]
    return Moments(mean, np.where(cut[:, None, None], wider, spread), np.einsum("nk,nka->na", weights, rests))


def _walk(block: Block, found: Solution, valleys: _Valleys, sign: int) -> None:
    """Follow the valleys to one side, and fill in what is found there."""
    along, across, places, logs, points, spreads, rests = valleys
    some, q = np.arange(len(along)), found.q.copy()
    roots = found.places.copy()
    for k in range(STEPS + 1):
        at = STEPS + sign * k
        part = block.part(some)
        there = roots[some]
        orbits = block.model.averaged(q[some], part.sides, there)
        inside = orbits.good & (np.abs(q[some]) < block.model.reach).all(axis=1)
        some, part, there = some[inside], part.part(inside), there[inside]
        if not len(some):
            return
        roots[some] = there
        slopes = part.weigh(orbits.slopes[inside])
        rest = part.rest(orbits.values[inside], found.defect[some])
        matrix, pull = normal_equations(block.prior, slopes, rest, part.apart(q[some]))
        plane, line = across[some], along[some, :, None]
        to_plane = plane.transpose(0, 2, 1)
        inner, determinant = _inverse(to_plane @ matrix @ plane)
        cross = to_plane @ pull[..., None]
        step = inner @ cross
        cost = (rest**2).sum(axis=1) + part.cost_of_prior(q[some]) - (cross * step).sum(axis=(1, 2))
        move = (plane @ step)[..., 0]
        move *= np.minimum(1.0, LONGEST / np.maximum(np.abs(move).max(axis=1), 1e-300))[:, None]
        logs[some, at] = -0.5 * cost - 0.5 * np.log(determinant)
        points[some, at] = q[some] + move
        rests[some, at] = rest - (slopes @ move[..., None])[..., 0]
        spread = plane @ inner
        spreads[some, at] = spread @ to_plane
        if k == STEPS:
            return
        tangent = (line - spread @ (to_plane @ (matrix @ line)))[..., 0]
        width = places[some, at + sign] - places[some, at]
        q[some] = points[some, at] + width[:, None] * tangent
        least = logs[some].max(axis=1)
        some = some[logs[some, at] > least - 0.5 * DEEP]


def _inverse(matrix: Array) -> tuple[Array, Array]:
    """Inverse and determinant of matrices, shape (n, 2, 2), symmetric."""
    a, b, d = matrix[:, 0, 0], matrix[:, 0, 1], matrix[:, 1, 1]
    determinant = a * d - b * b
    inverse = np.stack([d, -b, -b, a], axis=1) / determinant[:, None]
    return inverse.reshape(-1, 2, 2), determinant


def _fallen(logs: Array) -> NDArray[np.bool_]:
    """Whether the density falls far enough before its last value that is known."""
    last = logs.shape[1] - 1 - np.argmax(np.isfinite(logs[:, ::-1]), axis=1)
    fallen: NDArray[np.bool_] = logs[np.arange(len(logs)), last] < logs.max(axis=1) - 0.5 * SHALLOW
    return fallen


def _trapezoids(places: Array) -> Array:
    """Weights of values at these places in their integral."""
    steps = np.diff(places, axis=1)
    weights = np.zeros_like(places)
    weights[:, :-1] += 0.5 * steps
    weights[:, 1:] += 0.5 * steps
    return weights
