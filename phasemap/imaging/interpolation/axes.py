"""The coordinates of an atlas: stiffness, damping and adhesion, each taken so that orbits change evenly along it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phasemap._shared.arrays import Array

SHARE = 0.05  # of the largest damping, below which the damping axis is about linear


@dataclass(frozen=True)
class Axes:
    """From (stiffness K [Pa], adhesion w [J/m2], damping alpha1 [1]) to coordinates and back.

    x0 = ln K, or K^(1/4) where some K is 0: the depth of the contact goes with a power of K. x1 = ln(alpha1 + a): the
    phase goes with alpha1 over a constant plus alpha1. x2 = w: forces are linear in it. See theory,
    Eq. (interpolation-1).

    Examples
    --------
    >>> axes = Axes.around(np.array([1e9, 4e9]), np.array([0.0, 0.1]))
    >>> x = axes.points(np.array([2e9]), np.array([0.05]), np.array([0.02]))
    >>> [f"{v[0]:.6g}" for v in axes.materials(x)]
    ['2e+09', '0.05', '0.02']
    """

    logarithmic: bool  # whether x0 is ln K
    offset: float  # a [1]; 0 where nothing is damped, and then x1 = alpha1

    @classmethod
    def around(cls, stiffness: Array, damping: Array) -> Axes:
        """Axes for these materials."""
        return cls(bool(stiffness.min() > 0), SHARE * float(damping.max()))

    def points(self, stiffness: Array, adhesion: Array, damping: Array) -> Array:
        """Coordinates, shape (3, n)."""
        points = np.empty((3, len(adhesion)))
        with np.errstate(divide="ignore", invalid="ignore"):
            points[0] = np.log(stiffness) if self.logarithmic else np.sqrt(np.sqrt(stiffness))
            points[1] = np.log(damping + self.offset) if self.offset else damping
        points[2] = adhesion
        return points

    def materials(self, points: Array) -> tuple[Array, Array, Array]:
        """Stiffness [Pa], adhesion [J/m2], damping [1] of coordinates, shape (3, n)."""
        stiffness = np.exp(points[0]) if self.logarithmic else points[0] ** 4
        damping = np.maximum(np.exp(points[1]) - self.offset, 0.0) if self.offset else points[1]
        return stiffness, points[2], damping

    @property
    def lowest(self) -> Array:
        """Where each coordinate ends for want of smaller materials."""
        return np.array([-np.inf if self.logarithmic else 0.0, np.log(self.offset) if self.offset else 0.0, 0.0])
