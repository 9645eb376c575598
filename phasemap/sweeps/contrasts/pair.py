"""Two materials under one microscope, solved at any working point."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.wide import WIDE
from phasemap._shared.notices import unquestioned
from phasemap.experiment.accuracy import MOST_PERIODS, Accuracy
from phasemap.experiment.lever import lever_of
from phasemap.experiment.material import Material
from phasemap.experiment.material_rows import film_of, properties, rows_of
from phasemap.experiment.microscope import Microscope
from phasemap.results.variables import OF_ORBITS
from phasemap.solvers.averaging import Averaging
from phasemap.solvers.both_branches import stable_branches
from phasemap.solvers.integrals import bare_rows, widened
from phasemap.solvers.orbit import Orbit
from phasemap.solvers.problem import Work, work_of_material
from phasemap.solvers.run import run
from phasemap.solvers.solver import Solver

Array = np.ndarray
Axes = tuple[Array, Array, Array]
"""Frequencies [Hz], free amplitudes [m] and setpoints [1], each rising."""

NONE, ATTRACTIVE, REPULSIVE, BISTABLE = 0, 1, 2, 3  # regimes; the last is the sum of the two before it
REGIMES = ("none", "attractive", "repulsive", "bistable")


class Engaged(NamedTuple):
    """What the controller finds after engaging from far, on each of the two materials."""

    rows: Array  # shape (2, n, COLUMNS), or (2, n, WIDE) where channels need more
    # status, solver: int8, shape (2, n)
    status: Array
    solver: Array


@dataclass(frozen=True, eq=False)
class Pair:
    """Two materials, and how they are solved."""

    materials: Work  # a row for each
    scope: Microscope  # its drive is replaced by that of the working point
    solver: Solver
    accuracy: Accuracy
    bare: Array  # the materials' rows without adhesion, shape (2, 12), as of `phasemap.solvers.integrals.bare_rows`
    needs: tuple[str, ...]  # variables of an orbit that channels are made of

    @classmethod
    def of(
        cls, first: Material, second: Material, scope: Microscope, solver: Solver, accuracy: Accuracy,
        needs: tuple[str, ...],
    ) -> Pair:  # fmt: skip
        """Make a pair."""
        one, other = (work_of_material(material, scope, 0.0, marched=True) for material in (first, second))
        law = max(
            one.law, other.law, key=lambda law: (law.memory, law.arms)
        )  # the same law, and knowing a memory if one of them has one
        both = Work(law, np.concatenate([one.rows, other.rows]), one.lever, np.zeros(2))
        given = [rows_of([material]) for material in (first, second)]
        bare = [bare_rows(properties(*row, scope)[0], scope, film_of(row[0])) for row in given]
        return cls(both, scope, solver, accuracy, np.concatenate(bare), needs)

    def microscope_at(self, frequency: float, free_amplitude: float) -> Microscope:
        """The microscope driven at a frequency [Hz] with a free amplitude at resonance [m]."""
        with unquestioned():  # the axes were looked at
            drive = replace(self.scope.drive, free_amplitude=free_amplitude, frequency=frequency)
            return replace(self.scope, drive=drive)

    def work(self, frequency: float, free_amplitude: float, setpoints: Array) -> Work:
        """Both materials at each setpoint: n rows of the first, then n of the second.

        `frequency`: of the drive [Hz].
        `free_amplitude`: at resonance [m]; the setpoints are over that at the drive frequency.
        """
        scope = self.microscope_at(frequency, free_amplitude)
        rows = np.repeat(self.materials.rows, len(setpoints), axis=0)
        return Work(self.materials.law, rows, lever_of(scope), np.tile(setpoints * scope.driven_amplitude, 2))

    @property
    def columns(self) -> int:
        """Number of columns in a row of the map."""
        return col.COLUMNS if set(OF_ORBITS).isdisjoint(self.needs) else WIDE

    def engage(self, work: Work, solver: Solver | None = None, scope: Microscope | None = None) -> Engaged:
        """The orbits that the controller finds; on one thread, for callers have theirs.

        `scope`: at this working point, where what channels need is wanted.
        """

        def widen(part: Work, rows: Array, used: Array, at: Array) -> Array:
            assert scope is not None
            return widened(rows, part, used, scope, lambda: self.bare[2 * at // len(work)], self.needs)

        more = None if scope is None or self.columns == col.COLUMNS else widen
        rows, status, used = run(solver or self.solver, work, self.accuracy, threads=1, widen=more)
        return Engaged(rows.reshape(2, -1, rows.shape[-1]), status.reshape(2, -1), used.reshape(2, -1))

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
    """In which regimes (NONE, ATTRACTIVE, REPULSIVE, BISTABLE) a stable orbit holds each setpoint, engaged or not.

    None is known of contacts that remember: there only what engaging leads to is. `periods` of the drive may be
    integrated for each.
    """
    if work.in_time:
        return np.full(len(work), NONE, np.int8)
    attractive, repulsive = stable_branches(work, Orbit(), Accuracy(periods=periods)).stable
    codes: Array = ATTRACTIVE * attractive + REPULSIVE * repulsive
    return codes.astype(np.int8)


def regime_of(rows: Array) -> Array:
    """Regime of each orbit, NONE where there is none; shape (...) of rows of shape (..., COLUMNS)."""
    stiffening = rows[..., col.STIFFENING]
    return np.where(np.isnan(stiffening), NONE, np.where(stiffening > 0, REPULSIVE, ATTRACTIVE)).astype(np.int8)
