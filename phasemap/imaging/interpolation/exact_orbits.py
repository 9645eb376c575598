"""The exact orbits that an atlas is made of, at points of its coordinates and along lines of varying adhesion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels import columns as col
from phasemap._kernels.columns import ADHESION_LOSS
from phasemap._kernels.quadrature import TABLES
from phasemap._kernels.rows.by_collocation import nearby_rows
from phasemap._shared.arrays import Array
from phasemap._shared.threads import bounds_of, chunk_of, spread
from phasemap.experiment.accuracy import ERROR_HEIGHT, ERROR_PHASE, Accuracy
from phasemap.experiment.lever import of_tip, rows_as_seen
from phasemap.experiment.microscope import Microscope
from phasemap.results.variables import OF_ORBITS
from phasemap.solvers.integrals import bare_rows, widened
from phasemap.solvers.problem import Work, work_of
from phasemap.solvers.run import run
from phasemap.solvers.solver import Auto, Orbit

SHARE = 0.05  # of the largest damping, below which the damping axis is about linear


@dataclass(frozen=True)
class Axes:
    """Map from (stiffness K [Pa], adhesion w [J/m2], damping alpha1 [1]) to coordinates and back.

    x0 = ln K, or K^(1/4) where some K is 0: the depth of the contact goes with a power of K. x1 = ln(alpha1 + a): the
    phase goes with alpha1 over a constant plus alpha1. x2 = w: forces are linear in it. See theory,
    Eq. (interpolation-1). Under films of liquid x2 may be their thickness or contact angle.
    """

    logarithmic: bool  # whether x0 is ln K
    offset: float  # a [1]; 0 where nothing is damped, and then x1 = alpha1
    third: int = 0  # which of the following x2 is
    same: tuple[float, ...] = (0.0, np.inf, np.inf)  # adhesion [J/m2], film of liquid [m] and its angle [degree]

    @classmethod
    def covering(cls, stiffness: Array, damping: Array) -> Axes:
        """Axes whose scales suit all of these materials."""
        return cls(bool(stiffness.min() > 0), SHARE * float(damping.max()))

    def points(self, stiffness: Array, adhesion: Array, damping: Array, liquid: Array | None = None) -> Array:
        """Coordinates, shape (3, n)."""
        points = np.empty((3, len(adhesion)))
        with np.errstate(divide="ignore", invalid="ignore"):
            points[0] = np.log(stiffness) if self.logarithmic else np.sqrt(np.sqrt(stiffness))
            points[1] = np.log(damping + self.offset) if self.offset else damping
        points[2] = adhesion if liquid is None or not self.third else liquid[:, self.third - 1]
        return points

    def materials(self, points: Array) -> tuple[Array, Array, Array]:
        """Stiffness [Pa], adhesion [J/m2], damping [1] of coordinates, shape (3, n)."""
        stiffness = np.exp(points[0]) if self.logarithmic else points[0] ** 4
        damping = np.maximum(np.exp(points[1]) - self.offset, 0.0) if self.offset else points[1]
        return stiffness, self._each(points)[0], damping

    def liquid(self, points: Array) -> Array | None:
        """Thickness [m] and contact angle [degree] of films of liquid at coordinates, shape (n, 2), or None."""
        films = np.column_stack(self._each(points)[1:])
        return films if np.isfinite(films).any() else None

    def _each(self, points: Array) -> list[Array]:
        """Adhesion, thickness and contact angle at coordinates: x2 is one of them, the others are `same` everywhere."""
        return [points[2] if i == self.third else np.full(points.shape[1], one) for i, one in enumerate(self.same)]

    @property
    def lowest(self) -> Array:
        """Lower end of each coordinate, for want of smaller materials; a film that is there does not end at 0."""
        least = np.inf if self.third else 0.0
        return np.array([-np.inf if self.logarithmic else 0.0, np.log(self.offset) if self.offset else 0.0, least])


FUNCTIONS = (col.TIP_OFFSET, col.PHASE, col.MEAN, col.INDENTATION, col.DISSIPATION, col.VIRIAL)
"""Result columns that are interpolated, besides those of integrals that are asked for; the others follow from these."""
HEIGHT, PHASE, MEAN, DEPTH = 0, 1, 2, 3  # places in FUNCTIONS

CHUNK = 400  # orbits that a thread takes at a time


class ExactOrbits:
    """Exact orbits at points of the coordinates, and how many were asked for.

    `amplitude`: at the setpoint [m].
    `names`: image variables; of those in `phasemap.results.variables.OF_ORBITS` the columns are functions, too.
    `film` (shape (1, 2)): Poisson's ratio [1] and thickness [m] of the film on a rigid base that all materials are.
    `relaxation` (shape (1, 4)): how all of them relax, see `phasemap.experiment.material_rows.relaxation_of`.
    """

    def __init__(
        self, scope: Microscope, amplitude: float, axes: Axes, workers: int, accuracy: Accuracy | None = None,
        names: tuple[str, ...] = (), film: Array | None = None, relaxation: Array | None = None,
    ) -> None:  # fmt: skip
        self.film, self.relaxation = film, relaxation
        self.scope, self.amplitude, self.axes = scope, amplitude, axes
        self.asked = 0
        self.functions = functions_of(names)
        self._names = names
        # The same orbits without the integrals, which borders do not ask for
        self.bare = (
            self if self.functions == FUNCTIONS
            else ExactOrbits(scope, amplitude, axes, workers, accuracy, film=film, relaxation=relaxation)
        )  # fmt: skip
        self._workers, self._accuracy = workers, accuracy or Accuracy()
        self.marched = scope.interaction.law.in_time or relaxation is not None
        self.errors = np.array([ERROR_HEIGHT, ERROR_PHASE]) if self.marched else np.zeros(2)  # of orbits [m, rad]

    def _work(self, points: Array, amplitude: float | None) -> Work:
        """Work at points, which are counted in `asked`."""
        self.asked += len(points)
        given = *self.axes.materials(points.T), self.scope, amplitude or self.amplitude
        alike = _repeated(self.film, len(points)), _repeated(self.relaxation, len(points))
        return work_of(*given, *alike, self.axes.liquid(points.T), marched=self.marched)

    def __call__(self, points: Array, amplitude: float | None = None, *, in_time: bool = True) -> Array:
        """Functions after engagement at n points, shape (n, functions); `in_time` takes a thousand times as long."""
        work = self._work(points, amplitude)
        solver = Auto() if self.marched else Orbit(in_time=in_time)
        rows, status, used = run(solver, work, self._accuracy, threads=self._workers)
        return self._functions(work, points, rows, status, used)

    def near(self, points: Array, guesses: Array, away: Array, amplitude: float, group: int) -> Array:
        """Functions of the orbits next to guesses, NaN without one: without engagement, which is cheaper near a jump.

        Of guesses as from exact orbits tip offset, phase and mean deflection are used; the tip offset may be so far
        `away` [m]. `group`: so many points, one after another, are close to each other.
        """
        # On a driven base the amplitude of the tip that is held is not known before its phase.
        if self.scope.drive.excitation == "base":
            return self(points, amplitude)
        work, count = self._work(points, amplitude), len(points)
        rows, status = np.full((count, col.COLUMNS), np.nan), np.full(count, col.NOT_CONVERGED, np.int8)
        rows[:, [col.TIP_OFFSET, col.MEAN]] = guesses[:, [HEIGHT, MEAN]]
        rows[:, col.AMPLITUDE], rows[:, col.PHASE] = of_tip(work.lever, work.amplitudes, guesses[:, PHASE])

        def solve(first: int, last: int) -> None:
            chunk = slice(first, last)
            nearby_rows(work.part(chunk).pixels, TABLES, away[chunk], group, rows[chunk], status[chunk])

        # Threads take whole groups, so that what an orbit starts from does not depend on their number.
        size = group * max(1, chunk_of(count, self._workers, CHUNK) // group)
        spread(solve, bounds_of(count, size), self._workers, None)
        return self._functions(work, points, rows_as_seen(rows, work.lever), status, np.full(count, col.ORBIT, np.int8))

    def _functions(
        self, work: Work, points: Array, rows: Array, status: NDArray[np.int8], used: NDArray[np.int8]
    ) -> Array:
        """Values of the functions from result rows; NaN where no periodic orbit was found."""

        def bare() -> Array:
            return bare_rows(self.axes.materials(points.T)[0], self.scope, _repeated(self.film, len(points)))

        values: Array = widened(rows, work, used, self.scope, bare, self._names)[:, self.functions]
        values[(status != col.GOOD) | col.is_mean(rows)] = np.nan
        return values


def _repeated(row: Array | None, count: int) -> Array | None:
    """A row repeated for n materials, or None without one."""
    return None if row is None else np.repeat(row, count, axis=0)


def functions_of(names: tuple[str, ...]) -> tuple[int, ...]:
    """Columns to interpolate for an image with these variables."""
    more = {column for name in names for column in OF_ORBITS.get(name, ())}
    return *FUNCTIONS, *sorted(more - {ADHESION_LOSS})  # no neck is interpolated


SCAN = 17  # points on a line
HALVINGS = 7  # after which the step of a smooth function has become small
SMALLEST = 5e-12  # step of the tip offset [m] that is taken for a jump
JUMP = 0.3  # share of a step that stays in a jump
FEWEST, PLAIN = 3, 0.8  # halvings after which such a share leaves no doubt


@dataclass(frozen=True, eq=False)
class AdhesionLines:
    """Orbits along lines of varying adhesion, each array of shape (lines, points)."""

    heights: Array
    offsets: Array  # of the tip
    depths: Array  # of the contact

    def steps(self) -> Array:
        """Change of the tip offset from point to point; infinite where only one of two orbits is held."""
        return _step(self.offsets[:, :-1], self.offsets[:, 1:])


def _step(first: Array, second: Array) -> Array:
    """Change of the tip offset; infinite where only one of the two orbits is held, 0 where neither is."""
    one_held = np.isfinite(first) != np.isfinite(second)
    return np.where(one_held, np.inf, np.nan_to_num(abs(second - first)))


def orbits_above(exact: ExactOrbits, bases: Array, heights: Array, function: int | list[int]) -> Array:
    """A function of the orbits at heights (lines, points) above bases (lines, 2), or several along a last axis."""
    return exact(_points(bases, heights).reshape(-1, 3)).reshape(*heights.shape, len(exact.functions))[..., function]


def _points(bases: Array, heights: Array) -> Array:
    """Points (lines, points, 3) of heights above bases."""
    points = np.empty((*heights.shape, 3))
    points[..., :2] = bases[:, None]
    points[..., 2] = heights
    return points


def orbits_on_lines(exact: ExactOrbits, bases: Array, low: Array, high: Array, few: float = np.inf) -> AdhesionLines:
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
    # The lost point of least adhesion, then those next to an orbit, then the rest; where one step finds none, no more.
    for where in (lowest, beside & ~lowest, ~held & ~beside & ~lowest):
        if not where.any():
            continue
        if heights[~held].min() > few:
            break
        orbits[where] = exact(points[where])
        if np.isnan(orbits[where][:, HEIGHT]).all():
            break
    return AdhesionLines(heights, orbits[..., HEIGHT], orbits[..., DEPTH])


@dataclass(frozen=True, eq=False)
class Brackets:
    """A pair of points on every line, between which a border lies."""

    low: Array
    high: Array
    offset_low: Array
    offset_high: Array

    @property
    def step(self) -> Array:
        """Change of the tip offset within each pair; infinite where only one of two orbits is held."""
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


def _largest_step(lines: AdhesionLines) -> Brackets:
    """Bracket the largest step of the tip offset on each line."""
    rows, at = np.arange(len(lines.heights)), lines.steps().argmax(axis=1)
    return Brackets(
        lines.heights[rows, at], lines.heights[rows, at + 1], lines.offsets[rows, at], lines.offsets[rows, at + 1]
    )


def jumps_on(exact: ExactOrbits, bases: Array, lines: AdhesionLines) -> tuple[Brackets, NDArray[np.bool_]]:
    """Bracket the largest step on every line, and say whether it is a jump: much of it stays as lines are halved."""
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
