"""The cases of a regime with what is known about them: the orbit that is right, and where it was found."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.accuracy.equation import Case
from benchmarks.accuracy.reference import NoOrbit, Reference, Start, find_orbit
from benchmarks.accuracy.regimes import Batch, Regime, draw
from phasemap._kernels import columns as col
from phasemap.experiment.accuracy import Accuracy
from phasemap.solvers.problem import Work
from phasemap.solvers.run import run
from phasemap.solvers.solver import by_name

Array = np.ndarray

FOUND, NOT_HELD, NOT_CONVERGED, UNSTABLE = range(4)
"""What became of a reference."""
OUTCOMES = ("found", "not_held", "not_converged", "unstable")
OUTCOMES_IN_WORDS = (
    "the reference was found",
    "no solver holds the setpoint, so there is nothing to compare",
    "the reference did not converge",
    "the reference is unstable, though a solver calls the orbit stable",
)
ENGAGERS = ("orbit", "march", "averaging")
"""Solvers that are asked, one after the other, which branch the tip engages on."""


@dataclass(frozen=True)
class Known:
    """A case, its reference, and a start for peers."""

    case: Case
    # batch, index: where it stands among the batches
    batch: int
    index: int
    outcome: int  # what became of the reference, a place in `OUTCOMES`
    reference: Reference | None = None  # none if there is none
    start: Start | None = None  # the averaged orbit; where there is none, first harmonic and mean of the exact one


@dataclass(frozen=True, eq=False)
class Field:
    """A regime with its cases drawn."""

    name: str
    works: tuple[Work, ...]  # all pixels, which are timed
    known: tuple[Known, ...]  # those that are compared with a reference: the first few of each work


def prepare(
    regime: Regime, batches: int, pixels: int, references: int, rng: np.random.Generator, tick: Callable[[], None]
) -> Field:
    """Draw a regime's cases and find the references of the first few in each batch.

    `batches`, `pixels`: how many microscopes, and how many materials under each.
    `references`: how many of these are compared with the reference.
    """
    drawn = draw(regime, batches, pixels, rng)
    known: list[Known] = []
    for number, batch in enumerate(drawn):
        named = _engaged(_head(batch, references).work())
        averaged = _solved("averaging", _head(batch, references).work())
        for index in range(min(references, len(batch))):
            known.append(_know(batch.case(index), number, index, named[index], averaged[index]))
            tick()
    return Field(regime.name, tuple(batch.work() for batch in drawn), tuple(known))


def _head(batch: Batch, count: int) -> Batch:
    return Batch(batch.scope, batch.materials[:count], batch.setpoint)


def _solved(name: str, work: Work) -> list[Start | None]:
    rows, status, _ = run(by_name(name), work, Accuracy(), threads=1)
    return [
        Start(float(row[col.TIP_OFFSET]), float(row[col.MEAN]), math.degrees(row[col.PHASE])) if good else None
        for row, good in zip(rows, status == col.GOOD, strict=True)
    ]


def _engaged(work: Work) -> list[Start | None]:
    """Where the tip engages, by the first solver that knows."""
    found: list[Start | None] = [None] * len(work)
    for name in ENGAGERS:
        if None not in found:
            break
        found = [old if old is not None else new for old, new in zip(found, _solved(name, work), strict=True)]
    return found


def _know(case: Case, batch: int, index: int, named: Start | None, averaged: Start | None) -> Known:
    if named is None:
        return Known(case, batch, index, NOT_HELD)
    try:
        reference = find_orbit(case, named)
    except (NoOrbit, np.linalg.LinAlgError):
        return Known(case, batch, index, NOT_CONVERGED)
    if not reference.floquet < 1:
        return Known(case, batch, index, UNSTABLE)
    return Known(case, batch, index, FOUND, reference, averaged or named)
