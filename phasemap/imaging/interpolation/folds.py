"""Folds: the adhesion at which the attractive branch ends, extrapolated from orbits beside its end.

At fixed amplitude, two orbits meet where the branch ends, the stable one and one nearer to the surface, and beyond that
adhesion there is none. So the adhesion is a smooth function of the tip offset with a minimum there, w = w_f + c (z -
z_f)^2 + ..., and a few orbits on the branch tell where the end is. They are found from one another, without engagement.

The branch is lost where it ends at any amplitude between the free one and the setpoint. Its end needs the most adhesion
at the amplitude of theory, Eq. (engagement-4), for harmonic orbits, 3^(-1/2) of the free one at resonance; for a lower
setpoint the largest of the values around that amplitude counts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial.chebyshev import chebval2d

from phasemap._kernels.engagement.by_averaging import narrowest_amplitude_ratio
from phasemap._shared.arrays import Array
from phasemap.experiment.lever_numbers import lever_of
from phasemap.imaging.interpolation import chebyshev
from phasemap.imaging.interpolation.chebyshev import clipped
from phasemap.imaging.interpolation.exact_orbits import HEIGHT, ExactOrbits

Rectangle = tuple[float, float, float, float]

SHARES = (4.5, 3.0, 2.0, 1.2)
"""Distances beyond the end at which orbits are looked for, over the error that the end may have."""
STEPS = (0.1, 0.035, 0.012, 3e-3, 6e-4)  # on the way there
WIDEST, NEAREST = 0.2, 1e-4  # how far off, over the adhesion: where the search gives up, and where it ends
ENOUGH = 4e-4  # where it may end, if orbits nearer to the end are not found
MOST = 20  # steps of it
FIRST = (1e-3, 4e-3, 0.01, 0.02)  # how far beyond the end orbits are engaged to begin with, over the adhesion
SPREAD = 0.04  # between the amplitudes around the narrowest one, over it


@dataclass(frozen=True, eq=False)
class Ends:
    """Ends of the attractive branch above some points of (x0, x1)."""

    adhesion: Array  # shape (n,); w_f [J/m2]
    orbit: Array  # shape (n, functions); the orbit there
    curvature: Array  # shape (n,); c [J/m2 per m2]

    @property
    def table(self) -> Array:
        """Ends in columns, each smooth and of one sign or none; shape (n, 2 + functions)."""
        return np.column_stack([self.adhesion, np.log(self.curvature), self.orbit])

    @classmethod
    def of(cls, table: Array) -> Ends:
        """Ends from the columns of `table`."""
        return cls(table[:, 0], table[:, 2:], np.exp(table[:, 1]))


def follow(exact: ExactOrbits, bases: Array, guess: Ends, off: float, amplitude: float) -> Ends | None:
    """Find the ends above bases (n, 2) from guesses that are `off` at most, relatively; None if that fails anywhere."""
    ends, off, nearest = guess, max(off, 10 * NEAREST), NEAREST
    for _ in range(MOST):
        beside = _ends_beside(exact, bases, ends, off * np.array(SHARES), amplitude)
        if beside is None:
            off *= 1.6
            if off < ENOUGH:
                nearest = max(nearest, off)
            if off > WIDEST:
                return None
            continue
        moved, ends = float(abs(beside.adhesion / ends.adhesion - 1).max()), beside
        if off <= nearest:
            return ends
        off = max(nearest, min(max(0.5 * moved, 0.1 * off), 0.9 * off))
    return None


def _ends_beside(exact: ExactOrbits, bases: Array, ends: Ends, shares: Array, amplitude: float) -> Ends | None:
    """Ends from orbits at these shares beyond them, largest first.

    Next to the end, Newton's method needs an orbit from slightly farther away to start from.
    """
    if not (ends.adhesion > 0).all():
        return None
    steps = [step for step in STEPS if step > 2 * shares[0]]
    chain = np.concatenate([steps, shares])
    count, tries = len(bases), len(chain)
    adhesion = ends.adhesion[:, None] * (1 + chain)
    points = np.column_stack([np.repeat(bases, tries, axis=0), adhesion.reshape(-1)])
    above = np.sqrt(ends.adhesion[:, None] * chain / ends.curvature[:, None])
    guesses = np.repeat(ends.orbit, tries, axis=0)
    guesses[:, HEIGHT] += above.reshape(-1)
    away = 3 * above.reshape(-1)
    values = exact.near(points, guesses, away, amplitude, tries).reshape(count, tries, -1)
    used = slice(None, len(steps) - 1 if steps else None, -1)
    return minimum(adhesion[:, used], values[:, used]) if np.isfinite(values[:, used]).all() else None


def amplitudes_of_ends(exact: ExactOrbits) -> tuple[float, ...]:
    """Amplitudes [m] at which the end of the branch counts: one, or three around the narrowest."""
    worst = narrowest_amplitude_ratio(lever_of(exact.scope)) * exact.scope.driven_amplitude
    if exact.amplitude >= worst:
        return (exact.amplitude,)
    return (1 - SPREAD) * worst, worst, (1 + SPREAD) * worst


def start(exact: ExactOrbits, bases: Array, adhesion: Array) -> list[Ends] | None:
    """Find the ends above bases (n, 2) at these amplitudes, from adhesions slightly beyond them."""
    amplitudes = amplitudes_of_ends(exact)
    middle = amplitudes[len(amplitudes) // 2]
    tried = adhesion[:, None] * (1 + np.array(FIRST))
    points = np.column_stack([np.repeat(bases, len(FIRST), axis=0), tried.reshape(-1)])
    values = exact(points, middle).reshape(*tried.shape, -1)
    rough = minimum(tried, values) if np.isfinite(values).all() else None
    ends = None if rough is None else follow(exact, bases, rough, 0.0, middle)
    if ends is None:
        return None
    moved = []
    for amplitude in amplitudes:
        orbit = ends.orbit.copy()
        orbit[:, HEIGHT] += amplitude - middle
        moved.append(Ends(ends.adhesion, orbit, ends.curvature))
    return follow_all(exact, bases, moved, 0.0 if len(amplitudes) == 1 else SPREAD**2)


def follow_all(exact: ExactOrbits, bases: Array, guesses: list[Ends], off: float) -> list[Ends] | None:
    """`follow` at each of the amplitudes."""
    every = [follow(exact, bases, guess, off, a) for guess, a in zip(guesses, amplitudes_of_ends(exact), strict=True)]
    followed = [ends for ends in every if ends is not None]
    return followed if len(followed) == len(every) else None


def adhesion_at_end_of_branch(every: list[Ends]) -> Array | None:
    """Smallest adhesion at which the attractive branch still reaches the setpoint, by its ends at all amplitudes.

    The tip has to pass all amplitudes on its way, so that it is the largest of the ends: the vertex of the parabola
    through three, which opens downwards.
    """
    if len(every) == 1:
        return every[0].adhesion
    below, middle, above = (ends.adhesion for ends in every)
    slope, bend = 0.5 * (above - below), 0.5 * (above + below) - middle
    return middle - 0.25 * slope**2 / bend if (bend < 0).all() else None


def minimum(adhesion: Array, values: Array) -> Ends | None:
    """The end of the branch, where adhesion is least as a cubic of the tip offset, from orbits at four adhesions."""
    heights = values[..., HEIGHT]
    origin, scale = heights[:, :1], np.ptp(heights, axis=1, keepdims=True)
    if not (scale > 0).all():
        return None
    t = (heights - origin) / scale
    if not (np.diff(t, axis=1) > 0).all():
        return None
    matrix = t[..., None] ** np.arange(4)
    cubic = np.linalg.solve(matrix, adhesion[..., None])[..., 0]
    square = np.zeros_like(cubic)
    square[:, :3] = np.linalg.solve(matrix[:, :3, :3], adhesion[:, :3, None])[..., 0]
    # Far from the end, a cubic may have no minimum.
    b = np.where((_discriminant(cubic) > 0)[:, None], cubic, square)
    with np.errstate(divide="ignore", invalid="ignore"):  # a straight line has no minimum
        at = -b[:, 1] / (b[:, 2] + np.sqrt(np.maximum(_discriminant(b), 0.0)))
        curvature = (b[:, 2] + 3 * b[:, 3] * at) / scale[:, 0] ** 2
    if not (np.isfinite(at).all() and (curvature > 0).all() and (at < 0).all()):
        return None
    at = np.maximum(at, -2.0)
    powers = at[:, None] ** np.arange(4)
    orbit = np.einsum("np,npf->nf", powers, np.linalg.solve(matrix, values))
    return Ends((powers * b).sum(axis=1), orbit, curvature)


def _discriminant(b: Array) -> Array:
    """A quarter of that of b1 + 2 b2 t + 3 b3 t^2."""
    return np.asarray(b[:, 2] ** 2 - 3 * b[:, 3] * b[:, 1])


def interpolated(known: list[Ends], sizes: tuple[int, int], nodes: Array, box: Rectangle) -> tuple[list[Ends], float]:
    """Ends of the branch above nodes, from those on a coarser grid, and how far off they may be, relatively."""
    every = np.column_stack([ends.table for ends in known])
    coefs = chebyshev.coefficients(every.reshape(*sizes, -1), [0, 1])
    off = sum(float(abs(np.take(coefs[..., 0], -1, axis=axis)).max()) for axis in (0, 1) if sizes[axis] > 1)
    t0, t1 = clipped(nodes[:, 0], *box[:2]), clipped(nodes[:, 1], *box[2:])
    found: Array = np.asarray(chebval2d(t0, t1, coefs), dtype=np.float64).T
    return _ends_at_each_amplitude(found, len(known)), off / float(known[0].adhesion.min())


def _ends_at_each_amplitude(table: Array, count: int) -> list[Ends]:
    """Ends of the branch at each amplitude, from a table with all side by side."""
    return [Ends.of(part) for part in np.split(table, count, axis=1)]
