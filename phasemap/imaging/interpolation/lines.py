"""Orbits along lines of varying adhesion, and the pairs of points on them between which orbits change most."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phasemap._shared.arrays import Array
from phasemap.imaging.interpolation.exact_orbits import DEPTH, HEIGHT, ExactOrbits

SCAN = 17  # points on a line
HALVINGS = 7  # after which the step of a smooth function has become small
SMALLEST = 5e-12  # step of the tip offset [m] that is taken for a jump
JUMP = 0.3  # share of a step that stays in a jump
FEWEST, PLAIN = 3, 0.8  # halvings after which such a share leaves no doubt


@dataclass(frozen=True, eq=False)
class Lines:
    """Orbits along lines of varying adhesion, each array of shape (lines, points)."""

    heights: Array
    offsets: Array  # of the tip
    depths: Array  # of the contact

    def steps(self) -> Array:
        """How much the tip offset changes from point to point; infinite where only one of two orbits is held."""
        return _step(self.offsets[:, :-1], self.offsets[:, 1:])


def _step(first: Array, second: Array) -> Array:
    """How much the tip offset changes; infinite where only one of the two is held, 0 where neither is."""
    one_held = np.isfinite(first) != np.isfinite(second)
    return np.where(one_held, np.inf, np.nan_to_num(abs(second - first)))


def orbits_above(exact: ExactOrbits, bases: Array, heights: Array, function: int | list[int]) -> Array:
    """A function of the orbits at heights (lines, points) above bases (lines, 2), or several along a last axis."""
    return exact(_points(bases, heights).reshape(-1, 3)).reshape(*heights.shape, len(exact.functions))[..., function]


def _points(bases: Array, heights: Array) -> Array:
    points = np.empty((*heights.shape, 3))
    points[..., :2] = bases[:, None]
    points[..., 2] = heights
    return points


def scan(exact: ExactOrbits, bases: Array, low: Array, high: Array, few: float = np.inf) -> Lines:
    """Orbits along lines.

    Time, which is slow, is asked where it may find periodic orbits that curves do not lead to: past the last that they
    lead to there mostly are none. Where that is above the adhesion `few`, it does not matter.
    """
    share = np.linspace(0, 1, SCAN)
    heights = low[:, None] + (high - low)[:, None] * share
    points = _points(bases, heights)
    orbits = exact(points.reshape(-1, 3), in_time=False).reshape(*heights.shape, len(exact.functions))
    held = np.isfinite(orbits[..., HEIGHT])
    beside = ~held
    beside[:, 1:-1] &= held[:, 2:] | held[:, :-2]
    beside[:, 0] &= held[:, 1]
    beside[:, -1] &= held[:, -2]
    lowest = ~held & (heights == np.min(heights, where=~held, initial=np.inf))
    for where in (lowest, beside & ~lowest, ~held & ~beside & ~lowest):
        if not where.any():
            continue
        if heights[~held].min() > few:
            break
        orbits[where] = exact(points[where])
        if np.isnan(orbits[where][:, HEIGHT]).all():
            break
    return Lines(heights, orbits[..., HEIGHT], orbits[..., DEPTH])


@dataclass(frozen=True, eq=False)
class Brackets:
    """A pair of points on every line, between which a border lies."""

    low: Array
    high: Array
    offset_low: Array
    offset_high: Array

    @property
    def step(self) -> Array:
        """How much the tip offset changes between them; infinite where only one of two orbits is held."""
        return _step(self.offset_low, self.offset_high)

    def halved(self, exact: ExactOrbits, bases: Array, where: NDArray[np.bool_]) -> Brackets:
        """Keep, on the lines `where`, the half in which the tip offset changes more."""
        middle = 0.5 * (self.low + self.high)
        offset = np.full(len(bases), np.nan)
        offset[where] = orbits_above(exact, bases[where], middle[where][:, None], HEIGHT)[:, 0]
        lower = Brackets(self.low, middle, self.offset_low, offset).step
        upper = Brackets(middle, self.high, offset, self.offset_high).step
        up, down = where & (upper > lower), where & ~(upper > lower)
        return Brackets(
            np.where(up, middle, self.low),
            np.where(down, middle, self.high),
            np.where(up, offset, self.offset_low),
            np.where(down, offset, self.offset_high),
        )


def _largest_step(lines: Lines) -> Brackets:
    rows, at = np.arange(len(lines.heights)), lines.steps().argmax(axis=1)
    return Brackets(
        lines.heights[rows, at], lines.heights[rows, at + 1], lines.offsets[rows, at], lines.offsets[rows, at + 1]
    )


def jumps_on(exact: ExactOrbits, bases: Array, lines: Lines) -> tuple[Brackets, NDArray[np.bool_]]:
    """Bracket the largest step on every line, and whether it is a jump."""
    brackets = _largest_step(lines)
    before = brackets.step
    steps = where = before > 0
    for i in range(HALVINGS):
        brackets = brackets.halved(exact, bases, where)
        if i + 1 >= FEWEST:
            where = where & ~(brackets.step > PLAIN * before)
        if not where.any():
            break
    with np.errstate(invalid="ignore"):
        jumps = steps & ~(brackets.step < np.maximum(JUMP * before, SMALLEST))
    return brackets, jumps
