"""Two materials under one microscope, solved at any working point, and where their contrast jumps or passes zero.

Jumps, and zeros without a jump, are sought on the lines between neighbouring points of the map, along each of its axes,
by bisection with exact orbits. A jump is a change of phase that stays however close one comes; only what is left
between the jumps can pass through zero.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.rows.answers import Answers
from phasemap._shared.notices import unquestioned
from phasemap._shared.threads import Progress, spread
from phasemap.experiment.accuracy import MOST_PERIODS, Accuracy
from phasemap.experiment.lever_numbers import lever_of
from phasemap.experiment.material import Material
from phasemap.experiment.microscope import Microscope
from phasemap.solvers.both_branches import stable_branches
from phasemap.solvers.problem import Work, longest_memory, work_of_material
from phasemap.solvers.run import run
from phasemap.solvers.solver import Averaging, Orbit, Solver

Array = np.ndarray

Axes = tuple[Array, Array, Array]
"""Frequencies [Hz], free amplitudes [m] and setpoints [1], each rising."""
NONE, ATTRACTIVE, REPULSIVE, BISTABLE = 0, 1, 2, 3  # regimes; the last is the sum of the two before it
REGIMES = ("none", "attractive", "repulsive", "bistable")

HALVINGS = 24  # of the distance between neighbours; what is left changes a phase that ends at a fold by 0.01 degree
JUMP = 0.1  # least jump [degree], well above that
CERTAIN = 4.0  # times the accuracy of the phase: what the map's solver errs is not a jump
STANDS_OUT = 2.0  # times the larger of the steps beside it: a step worth looking into,
LARGE = 3.0  # as is any that is larger than this [degree]
SURE = 2.0  # times the accuracy of the phase: a contrast whose sign is known
SEEN = 0.5  # contrast [degree] that stands out of the noise of a phase image; below, there is no sign to turn round


@dataclass(frozen=True, eq=False)
class Pair:
    """Two materials, and how they are solved."""

    materials: Work  # a row for each
    scope: Microscope  # its drive is replaced by that of the working point
    solver: Solver
    accuracy: Accuracy

    @classmethod
    def of(cls, first: Material, second: Material, scope: Microscope, solver: Solver, accuracy: Accuracy) -> Pair:
        """Make a pair."""
        work, other_work = (work_of_material(material, scope, 0.0, marched=True) for material in (first, second))
        law = longest_memory((work.law, other_work.law))
        both = replace(work, law=law, rows=np.concatenate([work.rows, other_work.rows]), amplitudes=np.zeros(2))
        return cls(both, scope, solver, accuracy)

    def work(self, frequency: float, free_amplitude: float, setpoints: Array) -> Work:
        """Work of both materials at each setpoint: n rows of the first, then n of the second.

        `frequency`: of the drive [Hz].
        `free_amplitude`: at resonance [m]; the setpoints are over that at the drive frequency.
        """
        with unquestioned():  # the axes were looked at
            drive = replace(self.scope.drive, free_amplitude=free_amplitude, frequency=frequency)
            scope = replace(self.scope, drive=drive)
        rows = np.repeat(self.materials.rows, len(setpoints), axis=0)
        amplitudes = np.tile(setpoints * scope.driven_amplitude, 2)
        return replace(self.materials, rows=rows, lever=lever_of(scope), amplitudes=amplitudes)

    def engage(self, work: Work, solver: Solver | None = None) -> Answers:
        """The orbits that the controller finds on both, shape (2, n); on one thread, for callers have theirs."""
        rows, status, used = run(solver or self.solver, work, self.accuracy, threads=1)
        return Answers(rows.reshape(2, -1, rows.shape[-1]), status.reshape(2, -1), used.reshape(2, -1))

    def phases(self, frequency: float, free_amplitude: float, setpoint: float) -> Array:
        """Phases [degree] of both materials at one working point, shape (2,); NaN where there is no orbit.

        The orbits are exact, but averaged where those of the map are; only contacts that remember are marched, which
        takes long beside a jump.
        """
        keeps = isinstance(self.solver, Averaging) or self.materials.in_time
        solver = self.solver if keeps else Orbit()
        found = self.engage(self.work(frequency, free_amplitude, np.array([setpoint])), solver)
        return np.asarray(np.degrees(found.rows[:, 0, col.PHASE]))


def regimes(work: Work, periods: int = MOST_PERIODS) -> Array:
    """Regime (NONE, ATTRACTIVE, REPULSIVE, BISTABLE) of each setpoint: the branches on which a stable orbit holds it.

    None is known of contacts that remember or are wet: there only what engaging leads to is. `periods` of the drive may
    be integrated for each.
    """
    codes, (known, static) = np.full(len(work), NONE, np.int8), work.static()
    if len(known):
        attractive, repulsive = stable_branches(static, Orbit(), Accuracy(periods=periods)).stable
        codes[known] = ATTRACTIVE * attractive + REPULSIVE * repulsive
    return codes


def regime_of(rows: Array) -> Array:
    """Regime of each orbit, NONE where there is none; shape (...) of rows of shape (..., COLUMNS)."""
    side = np.where(col.is_repulsive(rows), REPULSIVE, ATTRACTIVE)
    return np.where(np.isnan(rows[..., col.STIFFENING]), NONE, side).astype(np.int8)


class PhaseJump(NamedTuple):
    """A jump of one material's phase."""

    point: Array  # shape (3,); frequency [Hz], free amplitude [m] and setpoint [1]
    material: int  # 0 or 1
    # before, after: shape (2,); phases of both materials on either side [degree]; `after` at the larger value of
    # what changes
    before: Array
    after: Array

    @property
    def inverts(self) -> bool:
        """True if the contrast is seen on both sides, with opposite signs."""
        before, after = (float(phases[1] - phases[0]) for phases in (self.before, self.after))
        return before * after < 0 and min(abs(before), abs(after)) > SEEN


class Inversion(NamedTuple):
    """A zero of the contrast."""

    point: Array  # shape (3,); frequency [Hz], free amplitude [m] and setpoint [1]
    phase: float  # that both materials have there [degree]


class _Place(NamedTuple):
    """Position along a line, from 0 to 1, and the phases there."""

    share: float
    phases: Array


class _Line(NamedTuple):
    """A line between two neighbours of the map, with the phases at both ends."""

    start: Array
    stop: Array
    before: Array
    after: Array

    def point(self, share: float) -> Array:
        """Frequency, free amplitude and setpoint at a share of the line."""
        return np.asarray(self.start + share * (self.stop - self.start))


def borders(
    pair: Pair, axes: Axes, phases: Array, branch: Array, workers: int, progress: Progress | None = None
) -> tuple[list[PhaseJump], list[Inversion]]:
    """Find every jump and inversion between neighbours of a map of phases [degree] and branches of both materials.

    There is none of a contrast of one sign that is seen. `progress`: called in lines that are looked into.
    """
    sure = SURE * pair.accuracy.phase
    lines = [line for axis in range(3) for line in _lines_with_jump(axis, axes, phases, branch, sure)]
    changes: list[tuple[list[PhaseJump], list[Inversion]]] = [([], [])] * len(lines)

    def follow(first: int, last: int) -> None:
        for i in range(first, last):
            changes[i] = _changes_on_line(pair, lines[i])

    spread(follow, range(len(lines) + 1), workers, progress)
    contrast = np.nan_to_num(phases[1] - phases[0])
    both = contrast.min() < -SEEN and contrast.max() > SEEN
    return [jump for jumps, _ in changes for jump in jumps], [zero for _, zeros in changes for zero in zeros if both]


def _lines_with_jump(axis: int, axes: Axes, phases: Array, branch: Array, sure: float) -> Iterator[_Line]:
    """Lines along one axis on which the contrast changes sign, or a phase changes branch or takes a large step."""
    step = np.abs(np.diff(phases, axis=axis + 1))
    known = np.isfinite(step)
    beside = np.pad(np.where(known, step, 0.0), [(int(i == axis + 1),) * 2 for i in range(4)])
    larger = np.maximum(*(np.take(beside, np.arange(step.shape[axis + 1]) + shift, axis + 1) for shift in (0, 2)))
    suspect = ((step > np.minimum(STANDS_OUT * larger + JUMP, LARGE)) | (np.diff(branch, axis=axis + 1) != 0)).any(0)
    contrast = phases[1] - phases[0]
    clear = np.abs(contrast) > sure
    before, after = (np.delete(clear, end, axis) for end in (-1, 0))
    suspect |= (np.diff(np.sign(contrast), axis=axis) != 0) & (before | after)
    for place in np.argwhere(suspect & known.all(0)):
        begin, end = tuple(place), tuple(place + np.eye(3, dtype=int)[axis])
        start, stop = (np.array([values[i] for values, i in zip(axes, at, strict=True)]) for at in (begin, end))
        yield _Line(start, stop, phases[(slice(None), *begin)], phases[(slice(None), *end)])


def _changes_on_line(pair: Pair, line: _Line) -> tuple[list[PhaseJump], list[Inversion]]:
    """Jumps and inversions on one line."""
    least = max(JUMP, CERTAIN * pair.accuracy.phase)
    begin, end = _Place(0.0, line.before), _Place(1.0, line.after)
    broken = []
    for material in (0, 1):
        phase_of = itemgetter(material)
        low, high = _close_in(pair, line, begin, end, phase_of, least)
        if abs(phase_of(high.phases) - phase_of(low.phases)) > least:
            broken.append((low, high, material))
    broken.sort(key=lambda item: item[0].share)
    jumps = [
        PhaseJump(line.point((low.share + high.share) / 2), material, low.phases, high.phases)
        for low, high, material in broken
    ]
    inversions = []
    begins, ends = [begin, *(high for _, high, _ in broken)], [*(low for low, _, _ in broken), end]
    for begin, end in zip(begins, ends, strict=True):
        signs = _sign(begin.phases), _sign(end.phases)
        clear = max(abs(phases[1] - phases[0]) for phases in (begin.phases, end.phases)) > SURE * pair.accuracy.phase
        if begin.share < end.share and clear and signs[0] != 0 and signs[0] != signs[1]:
            low, high = _close_in(pair, line, begin, end, _sign, 0.0)
            if np.abs(high.phases - low.phases).max() <= least:
                inversions.append(Inversion(line.point(high.share), float(high.phases.mean())))
    return jumps, inversions


def _close_in(
    pair: Pair, line: _Line, low: _Place, high: _Place, value: Callable[[Array], float], least: float
) -> tuple[_Place, _Place]:
    """Halve the line around where a value of the phases changes most, until it changes by no more than `least`.

    Where no orbit is found in between, the phases last seen are kept on either side.
    """
    for _ in range(HALVINGS):
        change = abs(value(high.phases) - value(low.phases))
        if change <= least:
            break
        share = (low.share + high.share) / 2
        phases = pair.phases(*line.point(share))
        if np.isnan(phases).any():
            high = _Place(share, high.phases)
        elif abs(value(phases) - value(low.phases)) < change / 2:
            low = _Place(share, phases)
        else:
            high = _Place(share, phases)
    return low, high


def _sign(phases: Array) -> float:
    """Sign of the contrast."""
    return float(np.sign(phases[1] - phases[0]))
