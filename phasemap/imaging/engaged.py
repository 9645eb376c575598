"""Images of pixels that are engaged one by one: each distinct material is solved once, or comes from an atlas."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels import columns as col
from phasemap._kernels.columns import ADHESION_LOSS, DRAG, GRADIENT, SIDEBANDS, WIDE
from phasemap._shared.arrays import Array
from phasemap._shared.threads import Progress, bounds_of, spread
from phasemap.experiment.accuracy import Accuracy
from phasemap.experiment.lever import of_tip
from phasemap.experiment.lever_numbers import lever_of
from phasemap.experiment.material_rows import film_of, liquid_of, relaxation_of
from phasemap.experiment.microscope import Microscope
from phasemap.imaging.canvas import PENDING, Canvas, Values, values_of
from phasemap.imaging.interpolation.atlas import Atlas, build
from phasemap.imaging.interpolation.exact_orbits import FUNCTIONS, PHASE, Axes, ExactOrbits, functions_of
from phasemap.imaging.job import Job, Simulator
from phasemap.imaging.materials import BLOCK, Distinct, Survey, films_alike
from phasemap.results.quantities import OF_SECOND, motion_seen
from phasemap.results.variables import OF_ORBITS
from phasemap.solvers.energy_balance import fill_energy_closure

MaterialNumbers = Callable[[slice], NDArray[np.int32]]
"""Function that gives the number of the distinct material of each pixel of a range."""

FEW = 1 << 13  # distinct materials up to which an atlas does not pay
MOST = 1 << 19  # distinct materials that are kept at a time
FINER = 0.1  # accuracy of what an atlas is made of, over that of the image
MANY, KINDS = 500, 30  # materials that are marched for which an atlas pays, and values that are no continuum
MANY_DRY = 5000  # the same of materials that relax under no liquid, whose orbits cost a tenth
DIGITS = 13  # behind the point, to which relaxation is the same in a kind
REST = 1 << 16  # pixels without an interpolant that are solved together


@dataclass(frozen=True, eq=False)
class Interpolants:
    """Orbits after engagement, interpolated between materials."""

    # axes, atlas: coordinates of materials, and interpolants in them
    axes: Axes
    atlas: Atlas

    def rows(self, job: Job, materials: Array, names: tuple[str, ...]) -> Array:
        """Result rows of materials, shape (n, COLUMNS or more), with what these variables need.

        NaN where nothing is interpolated, where the amplitude is NaN too; integrals that are not needed are left out.
        """
        functions = functions_of(job.needs)
        wanted = np.array([functions.index(column) for column in _columns_of(names)], np.int64)
        piece, values = self.atlas(self.axes.points(*job.properties(materials), liquid_of(materials)), wanted)
        rows = np.empty((WIDE if set(names) & set(OF_ORBITS) else col.COLUMNS, len(materials)))
        rows[: col.COLUMNS] = np.nan
        rows[np.array(functions)[wanted]] = values
        if "adhesion_loss" in names:
            rows[ADHESION_LOSS] = np.where(piece >= 0, 0.0, np.nan)
        rows[col.AMPLITUDE] = np.where(piece >= 0, job.amplitude, np.nan)
        errors = np.vstack([self.atlas.errors, [np.nan, np.nan]])  # the last where there is no piece, which is -1
        rows[col.ERROR_HEIGHT], rows[col.ERROR_PHASE] = errors[piece].T
        rows[col.STIFFENING] = stiffening(job.scope, job.amplitude, rows[col.PHASE])
        lever, shown = lever_of(job.scope), rows[[col.AMPLITUDE, col.PHASE]]
        rows[col.AMPLITUDE], rows[col.PHASE] = of_tip(lever, *shown)
        fill_energy_closure(rows.T, lever)
        rows[[col.AMPLITUDE, col.PHASE]] = shown
        return rows.T


class Block(NamedTuple):
    """Lines of an image that are worked on together."""

    # first, last: from this line to before that one
    first: int
    last: int
    materials: Array  # shape (n, 4); what they are made of, each once
    numbers: MaterialNumbers  # which of these each pixel of a range is made of


@dataclass(frozen=True, eq=False)
class PixelPlan:
    """Plan for all pixels of an image: a table of its materials, or an atlas of more, or neither."""

    materials: Array | None = None  # shape (n, 4) or (n, 10), or None; all that the image has
    values: Values | None = None  # their variables
    interpolants: Interpolants | None = None


def interpolates(job: Job) -> bool:
    """An atlas knows folds and grazing as borders, not ends of necks or memories.

    Materials differ in three properties in it: films are alike.
    """
    plain = films_alike(job.surface) and not job.scope.interaction.law.hysteretic
    return job.solver.name == "auto" and plain and not job.only_in_time


def _plan(job: Job, survey: Survey, _before: PixelPlan | None) -> PixelPlan:
    """Plan of an image: its materials solved if they are few, or an atlas of them."""
    if survey.materials is not None:
        return PixelPlan(survey.materials, solved(job, survey.materials, job.progress))
    if not interpolates(job):
        return PixelPlan()
    return PixelPlan(interpolants=make_atlas(job, survey.sample, survey.count))


def solved(job: Job, materials: Array, progress: Progress | None = None) -> Values:
    """Variables of distinct materials; of many that are marched in time most are interpolated, kind by kind.

    A kind has everything in common but what has more than `KINDS` values: stiffness, damping, and one of adhesion, film
    of liquid and its contact angle. Of materials that relax it has the same times and shares under this tip.
    """
    interaction = job.scope.interaction
    ting, many = job.remembers and interaction.withdrawal == "ting", MANY if interaction.law.in_time else MANY_DRY
    if len(materials) < many or job.solver.name != "auto" or not job.only_in_time or ting:
        return job.solve(materials, progress)
    kind, third, thirds = _kinds_of(job, materials)
    rows = np.full((len(materials), col.COLUMNS), np.nan)
    for number in np.flatnonzero(np.bincount(kind) >= many):
        of = np.flatnonzero(kind == number)
        same = tuple(float(one[of[0]]) for one in thirds)
        mine = make_atlas(job, materials[of], len(of), {"third": third, "same": same})
        if mine.atlas.pieces:
            rows[of] = mine.rows(job, materials[of], job.needs)
    held = ~np.isnan(rows[:, col.AMPLITUDE])
    done, used = int(np.count_nonzero(held)), np.full(len(rows), col.INTERPOLATED, np.int8)
    values = values_of(job.names, rows, np.where(held, col.GOOD, PENDING).astype(np.int8), used, job.scope)
    if done < len(held):
        beyond = None if progress is None else lambda more, _: progress(done + more, len(held))
        for name, part in job.solve(materials[~held], beyond).items():
            values[name][..., ~held] = part
    elif progress is not None:
        progress(done, done)
    return values


def _kinds_of(job: Job, materials: Array) -> tuple[NDArray[np.intp], int, list[Array]]:
    """Number of the kind of each material, as `solved` has them, and what else they may differ in.

    That is adhesion, film of liquid and contact angle: which of them it is, and all three.
    """
    stiffness, adhesion, damping = job.properties(materials)
    wet, none = liquid_of(materials), np.full(len(materials), np.inf)
    columns = [stiffness, damping, adhesion, *((none, none) if wet is None else wet.T)]
    counts = [len(np.unique(one)) for one in columns]
    third = int(np.argmax(counts[2:]))
    differs = {i for i in (0, 1, 2 + third) if counts[i] > KINDS}
    film, relaxation = film_of(materials), relaxation_of(materials, job.scope)
    alike = film, None if relaxation is None else np.round(relaxation, DIGITS)
    keys = [
        columns[3] == 0.0,  # dry: no neck is the limit of small ones
        *(one for i, one in enumerate(columns) if i not in differs),
        *(one for part in alike if part is not None for one in part.T),
    ]
    _, kind = np.unique(np.column_stack(keys), axis=0, return_inverse=True)
    return kind.reshape(-1), third, columns[2:]


def _fill(job: Job, plan: PixelPlan, canvas: Canvas, _state: None) -> None:
    """Fill the canvas with the pixels of an image or a part of it."""
    if plan.materials is not None and plan.values is not None:
        _put(job, canvas, plan.values, material_numbers(job, plan.materials), 0, job.pixels)
    elif plan.interpolants is not None:
        _fill_from_atlas(job, canvas, plan.interpolants)
        _fill_rest(job, canvas)
    else:
        for block in blocks(job, MOST):
            first, last = (line * job.surface.shape[1] for line in (block.first, block.last))
            _put(job, canvas, solved(job, block.materials), block.numbers, first, last)
            job.report(last)


def material_numbers(job: Job, materials: Array) -> MaterialNumbers:
    """Function that gives the number, among all materials of the surface, of each pixel of a range."""
    distinct = job.surface.found
    if distinct is not None and distinct[0] is materials:
        inverse = distinct[1].reshape(-1)
        return lambda part: inverse[part]
    known = Distinct(len(materials))
    known.add(materials)
    return known_numbers(job, known)


def known_numbers(job: Job, known: Distinct) -> MaterialNumbers:
    """Function that gives the number, among the known materials, of each pixel of a range."""
    return lambda part: known.numbers(job.surface.materials(part))


def blocks(job: Job, most: int) -> Iterator[Block]:
    """Yield blocks of lines with at most so many distinct materials, or of a single line."""
    lines, pixels = job.surface.shape
    first = 0
    while first < lines:
        known = Distinct(max(most, pixels))
        last, count = first, 0
        while last < lines and known.add(job.surface.materials(slice(last * pixels, (last + 1) * pixels))) == pixels:
            last, count = last + 1, len(known)
        yield Block(first, last, known.materials[:count], known_numbers(job, known))
        first = last


def _put(job: Job, canvas: Canvas, values: Values, numbers: MaterialNumbers, first: int, last: int) -> None:
    """Give each pixel of a range the values of its material."""

    def put(start: int, stop: int) -> None:
        part = slice(first + start, first + stop)
        canvas.put_solved(part, values, numbers(part))

    spread(put, [*range(0, last - first, BLOCK), last - first], job.workers, None)


def _fill_from_atlas(job: Job, canvas: Canvas, interpolants: Interpolants) -> None:
    """Interpolate pixels that the atlas has; the others stay pending."""
    filled: list[int] = []

    def fill(first: int, last: int) -> None:
        part = slice(first, last)
        materials = job.surface.materials(part)
        rows = interpolants.rows(job, materials, job.needs)
        held = ~np.isnan(rows[:, col.AMPLITUDE])
        status = np.where(held, col.GOOD, PENDING).astype(np.int8)
        used = np.full(last - first, col.INTERPOLATED, np.int8)
        canvas.put(part, values_of(job.names, rows, status, used, job.scope))
        filled.append(int(np.count_nonzero(held)))

    def report(_done: int, _total: int) -> None:
        job.report(sum(filled))

    if interpolants.atlas.pieces:
        spread(fill, bounds_of(job.pixels, BLOCK), job.workers, report)


def make_atlas(job: Job, materials: Array, count: int, liquid: dict[str, Any] | None = None) -> Interpolants:
    """An atlas for `count` materials, of which these are some; `liquid` has fields of `Axes` for films of liquid."""
    properties = job.properties(materials)
    valid = np.isfinite(sum(properties))
    stiffness, adhesion, damping = (one[valid] for one in properties)
    axes = Axes.covering(stiffness, damping) if valid.any() else Axes(False, 0.0)
    wet = liquid_of(materials)
    axes = replace(axes, **liquid or {})
    sample = axes.points(stiffness, adhesion, damping, None if wet is None else wet[valid]).T
    finer = Accuracy(FINER * job.accuracy.phase, FINER * job.accuracy.height, job.accuracy.periods)
    alike = film_of(materials[:1]), relaxation_of(materials[:1], job.scope)
    exact = ExactOrbits(job.scope, job.amplitude, axes, job.workers, finer, job.needs, *alike)
    shuffled = np.ascontiguousarray(sample[np.random.default_rng(1).permutation(len(sample))])
    return Interpolants(axes, build(exact, shuffled, count, tolerances_of(job, exact, shuffled)))


def _columns_of(names: tuple[str, ...]) -> list[int]:
    """Result columns to interpolate for these variables."""
    needed = {
        "height": (col.TIP_OFFSET,), "phase": (col.PHASE,), "tip_offset": (col.TIP_OFFSET,),
        "mean_deflection": (col.MEAN,), "indentation": (col.INDENTATION,), "dissipation": (col.DISSIPATION,),
        "virial": (col.VIRIAL,), "branch": (col.PHASE,), "energy_closure": (col.PHASE, col.DISSIPATION),
        **OF_ORBITS,
    }  # fmt: skip
    return sorted({column for name in names for column in needed.get(name, ())} - {ADHESION_LOSS})


def stiffening(scope: Microscope, amplitude: float | Array, phase: Array) -> Array:
    """omega_e^2 - 1 [1] that goes with what is seen [m, rad], since u0 sin(phase) = P + A kappa' of the tip."""
    lever = lever_of(scope)
    amplitude, phase = of_tip(lever, amplitude, phase)
    return lever[col.DRIVE] / amplitude * np.sin(phase) - lever[col.DYNAMIC_STIFFNESS]


def _fill_rest(job: Job, canvas: Canvas) -> None:
    """Solve the pixels that are pending, each distinct material once in so many of them."""
    done = job.pixels - int(np.count_nonzero(canvas.status == PENDING))
    held: list[NDArray[np.intp]] = []
    for start in range(0, job.pixels, BLOCK):
        held.append(np.flatnonzero(canvas.status[start : start + BLOCK] == PENDING) + start)
        waiting = sum(map(len, held))
        if waiting == 0 or (waiting < REST and start + BLOCK < job.pixels):
            continue
        pixels, held = np.concatenate(held), []
        materials = job.surface.materials(pixels)
        known = Distinct(len(pixels))
        known.add(materials)
        numbers = known.numbers(materials)
        values = job.solve(known.materials)
        canvas.put(pixels, {name: value[numbers] for name, value in values.items()})
        done += len(pixels)
        job.report(done)


SIMULATOR = Simulator(lambda job: FEW if interpolates(job) else MOST, _plan, _fill)


DEEPEST = 30.0  # error of the indentation, over that of the height
SHARE, SOME, TINY = 1e-3, 64, 1e-300  # error of an integral over its size, points that tell that, and the least of it
COLUMNS = (GRADIENT, DRAG, SIDEBANDS, SIDEBANDS + 1)  # those of OF_SECOND
OF_ANSWER = 3e-3
"""Error of the second mode's answer over its usual size: a third of what its quadrature is good to."""


def tolerances_of(job: Job, exact: ExactOrbits, sample: Array) -> Array:
    """Largest errors of functions: of lengths that of the height, of energies the effect of the phase's error.

    Those of integrals over orbits are a share of what they are on average at some points of the sample, or, where only
    a second mode needs them, of what its answer is.

    The indentation is allowed more: the solvers give the deepest of the points at which they evaluate the force, and
    which one that is changes from material to material.
    """
    phase, height = math.radians(job.accuracy.phase), job.accuracy.height
    # The drive's work per cycle is pi k u0 A cos(phase), the virial of the harmonic orbit k u0 A sin(phase) / 2.
    energy = job.scope.cantilever.stiffness * job.scope.base_amplitude * job.amplitude * phase
    limits = {
        col.TIP_OFFSET: height, col.MEAN: height, col.INDENTATION: DEEPEST * height, col.PHASE: phase,
        col.DISSIPATION: math.pi * energy, col.VIRIAL: 0.5 * energy,
    }  # fmt: skip
    if exact.functions != FUNCTIONS and len(sample):
        known = exact(sample[:SOME], in_time=False)
        known = known[np.isfinite(known).all(axis=1)]
        limits |= _integral_limits(exact.functions, known)
        asked = {column for name in job.names for column in OF_ORBITS.get(name, ())}
        limits |= {column: limit for column, limit in _answer_limits(job, exact, known).items() if column not in asked}
    return np.array([limits.get(column, TINY) for column in exact.functions])


def _integral_limits(functions: tuple[int, ...], known: Array) -> dict[int, float]:
    """Tolerance of integrals: a share of their usual size, of both parts of a complex number alike."""
    usual = abs(known).mean(axis=0) if len(known) else np.ones(len(functions))
    size = dict(zip(functions, usual.tolist(), strict=True))
    pairs = {pair for pair in OF_ORBITS.values() if pair[0] in size}
    return {part: SHARE * max(*(size[one] for one in pair), TINY) for pair in pairs for part in pair if part in size}


def _answer_limits(job: Job, exact: ExactOrbits, known: Array) -> dict[int, float]:
    """Tolerance of the integrals that a second mode needs: errors that change its response by so much.

    What the surface adds to its stiffness and damping counts over k2, and together with its own 1/Q2 unless a loop
    holds its phase.
    """
    mode, scope = job.scope.second_mode, job.scope
    if mode is None or not set(OF_SECOND) <= set(job.needs) or not len(known):
        return {}
    values = dict(zip(exact.functions, known.T, strict=True))
    orbit = dict(zip(OF_SECOND, (values[column] for column in COLUMNS), strict=True))
    motion = motion_seen(scope, np.full(len(known), job.amplitude), np.degrees(known[:, PHASE]), orbit)
    answer = motion.second_answer
    usual = float(np.mean(abs(answer.real if mode.detection == "fm" else answer)))
    stiffness = OF_ANSWER * mode.stiffness * max(usual, TINY)
    drag = stiffness * scope.cantilever.resonance_frequency / (scope.cantilever.stiffness * mode.frequency)
    return dict(zip(COLUMNS, (stiffness, drag, stiffness, stiffness), strict=True))
