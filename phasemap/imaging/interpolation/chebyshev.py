"""Chebyshev interpolation on tensor grids of nested nodes."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.polynomial.chebyshev import chebpts2, chebvander

from phasemap._shared.arrays import Array


def nodes(count: int) -> Array:
    """Points cos(pi k / (count - 1)) from -1 to 1; those of count are among those of 2 count - 1."""
    return np.zeros(1) if count == 1 else chebpts2(count)


@cache
def _transform(count: int) -> Array:
    """Matrix that takes values at the nodes to coefficients."""
    return np.asarray(np.linalg.inv(chebvander(nodes(count), count - 1)))


def coefficients(values: Array, axes: Sequence[int]) -> Array:
    """Coefficients of the interpolant, from values on a grid of `nodes` along `axes`."""
    for axis in axes:
        values = np.moveaxis(np.tensordot(_transform(values.shape[axis]), values, (1, axis)), 0, axis)
    return np.ascontiguousarray(values) + 0.0


def tail(coefs: Array, axis: int, axes: int) -> Array:
    """Size of the last coefficients along one of the first `axes` axes; an estimate of what is cut off there.

    Of the last two, since every other one vanishes in a function that is even or odd. 0 for a single node: along that
    axis there is nothing to cut off.
    """
    if coefs.shape[axis] == 1:
        return np.zeros(coefs.shape[axes:])
    last = np.take(abs(coefs), (-2, -1), axis=axis)
    others = tuple(other for other in range(axes) if other != axis)
    summed = np.sqrt((last**2).sum(axis=others))
    return np.asarray(summed.sum(axis=0))


def coordinates(x: Array, low: float, high: float) -> Array:
    """Coordinates of [low, high] in [-1, 1]; 0 where the interval is a point."""
    return (2 * x - low - high) / (high - low) if high > low else np.zeros(len(x))


def clipped(x: Array, low: float, high: float) -> Array:
    """Coordinates of [low, high] in [-1, 1]; points outside are moved to the nearer end."""
    return np.clip(coordinates(x, low, high), -1, 1)


def unscaled(t: Array, low: float, high: float) -> Array:
    """The reverse of `scaled`."""
    return 0.5 * (low + high) + 0.5 * (high - low) * t
