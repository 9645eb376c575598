"""Borders between orbits of different kind, as surfaces over stiffness and damping.

Along the adhesion, with all else fixed, the orbits follow one another in layers: the tip presses deep into the surface;
at some adhesion it stays on the attractive branch, where the orbit changes by a jump; and with still more adhesion it
does not touch any more. There the orbit is continuous, but has a kink. Both borders change smoothly with stiffness and
damping. The first is the fold at which the attractive branch ends, the second a zero of the depth; both are located
with exact orbits and interpolated.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial.chebyshev import chebval2d
from numpy.typing import NDArray

from phasemap._shared.arrays import Array
from phasemap.imaging.interpolation import chebyshev, folds
from phasemap.imaging.interpolation.chebyshev import clipped, unscaled
from phasemap.imaging.interpolation.exact_orbits import (
    DEPTH,
    HEIGHT,
    AdhesionLines,
    Brackets,
    ExactOrbits,
    jumps_on,
    orbits_above,
    orbits_on_lines,
)

LEAST_BELOW = 4  # steps between them that make a layer of their own
ROUGH = 1e-4  # last coefficients of a border, over the adhesion
FOUND = 2e-5  # step, over the adhesion, after which it is known where the tip just touches
TRUSTED = 1e-6  # error of a border at its nodes, over the adhesion
BESIDE = 1e-4  # distance from a border, over the adhesion, that is surely on one side
WIDEN = 4.0  # how far beyond the adhesions met a border is followed
SIZES = (3, 5, 9)
FINEST = 17  # nodes of a border along one coordinate


@dataclass(frozen=True, eq=False)
class Border:
    """A surface x2 = s(x0, x1)."""

    box: tuple[float, float, float, float]  # low and high of x0, and of x1
    coefficients: Array  # shape (n0, n1)
    error: float  # of s, estimated
    sudden: bool  # whether the orbit jumps there; else it has a kink

    def height(self, x0: Array, x1: Array) -> Array:
        """x2 of the border."""
        t0, t1 = clipped(x0, *self.box[:2]), clipped(x1, *self.box[2:])
        return np.asarray(chebval2d(t0, t1, self.coefficients))


class Undecided(Exception):
    """The borders over this box do not form whole layers, or are not worth it.

    `below`: adhesion up to which there are none.
    `worth`: whether there are enough materials to look again in the halves of the box.
    """

    def __init__(self, below: float | None = None, worth: bool = True) -> None:
        super().__init__()
        self.below, self.worth = below, worth


def find_borders(
    exact: ExactOrbits, box: tuple[float, float, float, float], low: float, high: float, few: float = np.inf
) -> list[Border]:
    """Borders above a box of (x0, x1) that matter for adhesions between low and high, from below.

    Above the adhesion `few` are so few materials that a border there is not located; that is -inf if it is so of all.
    Raises Undecided if a border exists over a part of the box only, or is not smooth, or is for few materials only.
    """
    bases = _bases(box)
    lines = orbits_on_lines(exact, bases, np.full(len(bases), low), np.full(len(bases), high), few)
    worth = few > -np.inf
    lost = np.diff(np.isfinite(lines.offsets), axis=1)
    if lost.any():  # beside the attractive branch's end orbits are held on both sides
        raise Undecided(_point_below(lines, float(lines.heights[:, :-1][lost].min())), worth)
    brackets, jumps = jumps_on(exact, bases, lines)
    if jumps.any():
        below = _point_below(lines, float(brackets.low[jumps].min()))
        if not worth or (below is not None and below > few):
            raise Undecided(below, worth)
    touching = lines.depths > 0
    grazing = np.isfinite(lines.depths).all() and bool(touching.any() and not touching.all())
    if grazing and not worth:
        raise Undecided(_point_below(lines, float(lines.heights[:, 1:][np.diff(touching, axis=1)].min())), worth)
    borders: list[Border] = []
    if jumps.any():
        if not jumps.all():
            brackets = _followed(exact, bases, brackets, jumps, low, high)
        jump = _Located(exact, box, low, high).jump(brackets)
        borders.append(jump.border)
        above = jump.depth_above
        if not (np.isfinite(above).all() or np.isnan(above).all()) or (above > 0).any() != (above > 0).all():
            raise Undecided
        grazing = bool((above > 0).all() and (lines.depths[:, -1] < 0).any())
    if grazing:
        borders.append(_Located(exact, box, low, high).graze(borders[0] if borders else None))
    for lower, upper in itertools.pairwise(borders):
        _check_order(lower, upper)
    return borders


def _point_below(lines: AdhesionLines, height: float) -> float | None:
    """The point of a scan next below this adhesion, if a layer of its own lies below."""
    at = int(np.searchsorted(lines.heights[0], height, "right")) - 1
    return float(lines.heights[0, at]) if at >= LEAST_BELOW else None


def _bases(box: tuple[float, float, float, float]) -> Array:
    """Centre and corners of a box of stiffness and damping, each once: along the adhesion, a line stands on each."""
    middle = (0.5 * (box[0] + box[1]), 0.5 * (box[2] + box[3]))
    corners = [(x0, x1) for x0 in box[:2] for x1 in box[2:]]
    return np.array(list(dict.fromkeys([middle, *corners])))


def _followed(
    exact: ExactOrbits, bases: Array, brackets: Brackets, jumps: NDArray[np.bool_], low: float, high: float
) -> Brackets:
    """Look for the jump beyond the adhesions met, on the lines that have none among them."""
    missing = np.flatnonzero(~jumps)
    count = len(missing)
    lines = orbits_on_lines(exact, bases[missing], np.full(count, low / WIDEN), np.full(count, high * WIDEN))
    more, found = jumps_on(exact, bases[missing], lines)
    if not found.all():
        raise Undecided
    joined = []
    for old, new in (
        (brackets.low, more.low), (brackets.high, more.high), (brackets.offset_low, more.offset_low),
        (brackets.offset_high, more.offset_high),
    ):  # fmt: skip
        old = old.copy()
        old[missing] = new
        joined.append(old)
    return Brackets(*joined)


def _check_order(lower: Border, upper: Border) -> None:
    """Raise Undecided where one border comes too near to another, or crosses it."""
    grid = [chebyshev.nodes(9) if lower.box[2 * i] < lower.box[2 * i + 1] else np.zeros(1) for i in (0, 1)]
    x0, x1 = np.meshgrid(unscaled(grid[0], *lower.box[:2]), unscaled(grid[1], *lower.box[2:]), indexing="ij")
    below, above = lower.height(x0.ravel(), x1.ravel()), upper.height(x0.ravel(), x1.ravel())
    if ((above - below) < 0.01 * above).any():
        raise Undecided


@dataclass(frozen=True, eq=False)
class _Jump:
    border: Border
    depth_above: Array


@dataclass(frozen=True, eq=False)
class _Located:
    """A border over a box, by interpolation between the nodes at which it is located."""

    exact: ExactOrbits
    box: tuple[float, float, float, float]
    low: float
    high: float

    def _nodes(self, sizes: tuple[int, int]) -> Array:
        """Nodes (x0, x1) of a grid on the box, shape (n, 2)."""
        x0 = unscaled(chebyshev.nodes(sizes[0]), *self.box[:2])
        x1 = unscaled(chebyshev.nodes(sizes[1]), *self.box[2:])
        return np.stack(np.meshgrid(x0, x1, indexing="ij"), -1).reshape(-1, 2)

    def _sizes(self, size: int) -> tuple[int, int]:
        """Size of a grid: one node along a coordinate that does not vary."""
        box = self.box
        return (size if box[1] > box[0] else 1), (size if box[3] > box[2] else 1)

    def jump(self, brackets: Brackets) -> _Jump:
        """Locate a jump as the end of the attractive branch, from the brackets at centre and corners."""
        border = self._end_of_branch(brackets)
        if border is None:
            raise Undecided
        # Engagement must jump there, too: below resonance attraction may raise the amplitude by a jump of its own.
        bases = _bases(self.box)
        height = border.height(bases[:, 0], bases[:, 1])
        room = max(BESIDE, 4 * border.error / float(height.min())) * height
        sides = orbits_above(self.exact, bases, np.column_stack([height - room, height + room]), [HEIGHT, DEPTH])
        offsets = sides[..., 0]
        found = Brackets(height - room, height + room, offsets[:, 0], offsets[:, 1])
        if not (found.step > 0.5 * float(np.min(brackets.step))).all():
            raise Undecided
        return _Jump(border, sides[:, 1, 1])

    def _end_of_branch(self, brackets: Brackets) -> Border | None:
        """The border as the end of the attractive branch, if that can be followed."""
        bases = _bases(self.box)
        known = folds.start(self.exact, bases, brackets.high)
        if known is None:
            return None
        sizes, finer = self._sizes(2), self._sizes(3)
        corners = slice(-sizes[0] * sizes[1], None)
        ends = [folds.Ends.of(one.table[corners]) for one in known]
        middle, _ = folds.interpolated(ends, sizes, bases[:1], self.box)
        off = max(abs(float(one.adhesion[0] / true.adhesion[0] - 1)) for one, true in zip(middle, known, strict=True))
        while max(finer) <= FINEST:
            nodes = self._nodes(finer)
            guess, tail = folds.interpolated(ends, sizes, nodes, self.box)
            followed, sizes = folds.follow_all(self.exact, nodes, guess, min(off, tail)), finer
            heights = None if followed is None else folds.adhesion_at_end_of_branch(followed)
            if followed is None or heights is None:
                return None
            ends = followed
            border = self._border(heights.reshape(sizes), True, 0.0)
            finer = self._finer(border, ROUGH * float(heights.max()))
            if finer == sizes:
                return self._measured(border, ends, sizes)
        return None

    def _measured(self, border: Border, ends: list[folds.Ends], sizes: tuple[int, int]) -> Border | None:
        """The border with its error, from the true one at some points between the nodes."""
        between = _between(self.box)
        followed = folds.follow_all(self.exact, between, folds.interpolated(ends, sizes, between, self.box)[0], 0.0)
        heights = None if followed is None else folds.adhesion_at_end_of_branch(followed)
        if heights is None:
            return None
        error = 3 * float(abs(border.height(between[:, 0], between[:, 1]) - heights).max())
        return replace(border, error=error + TRUSTED * float(heights.max()))

    def _finer(self, border: Border, enough: float) -> tuple[int, int]:
        """Numbers of nodes along x0 and x1, larger along the one that is not resolved yet."""
        tails = [float(chebyshev.tail(border.coefficients, axis, 2)) for axis in (0, 1)]
        rows, columns = border.coefficients.shape
        return (2 * rows - 1 if tails[0] > enough else rows), (2 * columns - 1 if tails[1] > enough else columns)

    def graze(self, below: Border | None) -> Border:
        """Border where the tip just touches: the depth of the contact passes zero."""
        border = None
        for size in SIZES:
            sizes = self._sizes(size)
            nodes = self._nodes(sizes)
            floor = np.zeros(len(nodes)) if below is None else below.height(nodes[:, 0], nodes[:, 1]) + 2 * below.error
            if border is None:
                low, high = np.maximum(floor, self.low / WIDEN), np.full(len(nodes), self.high * WIDEN)
            else:
                centre = border.height(nodes[:, 0], nodes[:, 1])
                low, high = np.maximum(floor, centre - 8 * border.error), centre + 8 * border.error
            heights = self._root(nodes, low, high)
            border = self._border(heights.reshape(sizes), False, 1e-9 * float(heights.max()))
            if border.error < ROUGH * float(heights.max()):
                return border
        raise Undecided

    def _root(self, bases: Array, low: Array, high: Array) -> Array:
        """Zeros of the depth between low, where the tip touches, and high, where it does not (Illinois)."""
        depths = orbits_above(self.exact, bases, np.column_stack([low, high]), DEPTH)
        f_low, f_high = depths[:, 0].copy(), depths[:, 1].copy()
        if not ((f_low > 0) & (f_high < 0)).all():
            raise Undecided
        low, high, at = low.copy(), high.copy(), low.copy()
        left = np.arange(len(bases))
        for _ in range(40):
            before = at[left]
            at[left] = ((low * f_high - high * f_low) / (f_high - f_low))[left]
            left = left[abs(at[left] - before) > FOUND * at[left]]
            if not len(left):
                return at
            f = orbits_above(self.exact, bases[left], at[left, None], DEPTH)[:, 0]
            if not np.isfinite(f).all():
                break
            touches, outside = left[f > 0], left[~(f > 0)]
            # The end that stays counts half, so that it does not stay for ever.
            low[touches], f_low[touches], f_high[touches] = at[touches], f[f > 0], 0.5 * f_high[touches]
            high[outside], f_high[outside], f_low[outside] = at[outside], f[~(f > 0)], 0.5 * f_low[outside]
        raise Undecided

    def _border(self, heights: Array, sudden: bool, error: float) -> Border:
        """Interpolant through heights at nodes, whose error is at least its last coefficients."""
        coefs = chebyshev.coefficients(heights, [0, 1])
        tails = [float(chebyshev.tail(coefs, axis, 2)) for axis in (0, 1)]
        return Border(self.box, coefs, max(error, *tails), sudden)


def _between(box: tuple[float, float, float, float]) -> Array:
    """A few more points of a box, where no node of an interpolant is."""
    shares = np.array([[0.31, 0.72], [0.62, 0.17], [0.11, 0.41], [0.83, 0.88]])
    low, high = np.array(box[::2]), np.array(box[1::2])
    return np.asarray(low + (high - low) * shares)
