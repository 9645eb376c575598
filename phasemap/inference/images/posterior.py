"""Mean and covariance of what the data of a pixel leave possible, where a parabola is too simple.

What is weakly determined is mostly one combination of the properties: chi2 has a long valley, curved and skewed. It is
followed to both sides of the best material, and the posterior integrated along it; across it, it is taken as normal.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasemap.inference.images.problem import Problem, Solution, normal_equations

Array = NDArray[np.float64]

SHARP = 0.05  # standard error of every logarithm below which the parabola will do
FIRST, GROWTH, STEPS = 0.5, 1.3, 7  # steps along the valley: in its standard deviations, each longer, to either side
DEEP = 20.0  # chi2 above the least, at which a side is done
SHALLOW = 6.0  # the same, above which a side that ends is cut off
LONGEST = 1.0  # of a correction across the valley, in a logarithm


class _Valleys(NamedTuple):
    """Of n pixels: directions along, (n, 3), and across, (n, 3, 2), the valley, and places along it, (n, k).

    There, logarithms of the density, (n, k), conditional means, (n, k, 3), and covariances, (n, k, 3, 3).
    """

    along: Array
    across: Array
    places: Array
    logs: Array
    points: Array
    spreads: Array


def moments(problem: Problem, found: Solution, covariance: Array) -> tuple[Array, Array]:
    """Means, shape (n, 3), and covariances, shape (n, 3, 3), of the logarithms.

    `covariance`: those of the parabola.
    """
    mean, covariance = found.q.copy(), covariance.copy()
    wide = (np.einsum("nii->ni", covariance) > SHARP**2).any(axis=1)
    wide = np.flatnonzero(wide & found.good & (problem.sides != 0).any(axis=(1, 2)))
    if len(wide):
        mean[wide], covariance[wide] = _integrate(problem.part(wide), found.part(wide), covariance[wide])
    return mean, covariance


def _integrate(problem: Problem, found: Solution, covariance: Array) -> tuple[Array, Array]:
    """Moments along the valleys of some pixels."""
    sizes, axes = np.linalg.eigh(covariance)
    n, k = len(sizes), 2 * STEPS + 1
    lengths = np.sqrt(sizes[:, 2:]) * np.cumsum(FIRST * GROWTH ** np.arange(STEPS))
    places = np.concatenate([-lengths[:, ::-1], np.zeros((n, 1)), lengths], axis=1)
    logs, points, spreads = np.full((n, k), -np.inf), np.zeros((n, k, 3)), np.zeros((n, k, 3, 3))
    for sign in (-1, 1):
        _walk(problem, found, _Valleys(axes[:, :, 2], axes[:, :, :2], places, logs, points, spreads), sign)
    lost = np.isneginf(logs).all(axis=1)
    logs[lost, STEPS], points[lost, STEPS], spreads[lost, STEPS] = 0.0, found.q[lost], covariance[lost]
    steps = np.pad(np.diff(places, axis=1), ((0, 0), (1, 1)))
    weights = (steps[:, 1:] + steps[:, :-1]) * np.exp(logs - logs.max(axis=1, keepdims=True))
    weights /= weights.sum(axis=1, keepdims=True)
    mean = np.einsum("nk,nki->ni", weights, points)
    apart = points - mean[:, None]
    spread = np.einsum("nk,nkij->nij", weights, spreads + apart[..., None] * apart[..., None, :])
    # Where the valley could not be followed to its sides, it may go on: the parabola's width is the least.
    cut = ~(_fallen(logs) & _fallen(logs[:, ::-1]))
    apart = found.q - mean
    wider = spread + covariance + apart[:, :, None] * apart[:, None, :]
    return mean, np.where(cut[:, None, None], wider, spread)


def _walk(problem: Problem, found: Solution, valleys: _Valleys, sign: int) -> None:
    """Follow the valleys to one side, and fill in what is found there."""
    along, across, places, logs, points, spreads = valleys
    some, q, roots = np.arange(len(along)), found.q.copy(), found.places.copy()
    for k in range(STEPS + 1):
        at, there = STEPS + sign * k, roots[some]
        orbits = problem.part(some).orbits(q[some], there)
        inside = orbits.good & (np.abs(q[some]) < problem.model.reach).all(axis=1)
        some = some[inside]
        if not len(some):
            return
        roots[some], part = there[inside], problem.part(some)
        rest = part.rest(orbits.values[inside], found.defect[some])
        matrix, pull = normal_equations(part, part.weigh(orbits.slopes[inside]), rest, q[some])
        plane, line = across[some], along[some, :, None]
        to_plane = plane.transpose(0, 2, 1)
        inner = np.linalg.inv(to_plane @ matrix @ plane)
        cross = to_plane @ pull[..., None]
        step = inner @ cross
        cost = part.cost(rest, q[some]) - (cross * step).sum(axis=(1, 2))
        move = (plane @ step)[..., 0]
        move *= np.minimum(1.0, LONGEST / np.maximum(np.abs(move).max(axis=1), 1e-300))[:, None]
        logs[some, at] = -0.5 * cost + 0.5 * np.log(np.linalg.det(inner))
        points[some, at] = q[some] + move
        spread = plane @ inner
        spreads[some, at] = spread @ to_plane
        if k == STEPS:
            return
        tangent = (line - spread @ (to_plane @ (matrix @ line)))[..., 0]
        q[some] = points[some, at] + (places[some, at + sign] - places[some, at])[:, None] * tangent
        some = some[logs[some, at] > logs[some].max(axis=1) - 0.5 * DEEP]


def _fallen(logs: Array) -> NDArray[np.bool_]:
    """Whether the density falls far enough before its last value that is known."""
    last = logs.shape[1] - 1 - np.argmax(np.isfinite(logs[:, ::-1]), axis=1)
    fallen: NDArray[np.bool_] = logs[np.arange(len(logs)), last] < logs.max(axis=1) - 0.5 * SHALLOW
    return fallen
