"""Residuals of a measured curve, each datum compared with the stable branch next to it, and their derivatives."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.continuation.point import ENTRY_Z0
from phasemap._kernels.orbits.collocation.path import Path
from phasemap._shared.arrays import within_half_a_turn
from phasemap._shared.errors import InputError
from phasemap._shared.threads import workers_of
from phasemap.experiment.lever import rows_as_seen
from phasemap.inference.curves.data import CurveSetting, Data, Parameter
from phasemap.solvers.continuation.curves import Curves
from phasemap.solvers.continuation.path import Question, Spacing, path_of, path_over
from phasemap.solvers.continuation.visit import stable_segments
from phasemap.solvers.continuation.whole_curves import distance_curves, swept_curves
from phasemap.sweeps.follow import there_and_back

NEARER = 4  # tip offsets between the nearest datum and half of the free amplitude
MARGIN = 1e-3  # of the range of tip offsets, by which a curve goes beyond

SCALES = ("amplitude_scale", "phase_offset")  # parameters of how a motion is read
STEP = 1e-4  # of the prior's standard deviations, of central differences
COARSE = 0.03  # of the picture (largest amplitude, range of the axis): as near counts as one in the coarse comparison
COARSE_PHASE = 3.0  # the same for phases [degree]
STRICT = 0.1  # of the spacing of the data: a branch that ends as much before a datum costs one standard error
NEAR, NEAR_PHASE = 0.02, 3.0  # of the amplitude, and [degree], by which an orbit moves that is differentiated


@dataclass(frozen=True, eq=False)
class CurveBranches:
    """Stable branches, each continued at its ends as a constant."""

    amplitude: np.ndarray  # shape (branches, n) [m]
    phase: np.ndarray  # shape (branches, n) [degree]
    # shape (branches, n); how far the point is beyond the branch's end [units of the axis]; 0 on the branch
    gap: np.ndarray
    rows: np.ndarray | None = None  # shape (branches, n, FULL); the orbits of tips; None of what is marched, or nothing


class Course(NamedTuple):
    """The path of a sweep, and where its values are on it."""

    path: Path
    tip_offsets: np.ndarray  # [m]
    m: np.ndarray

    @classmethod
    def of(cls, setup: CurveSetting, axis: str, values: np.ndarray) -> Course:
        """The course of a sweep over these values [Hz or m]."""
        question = Question(setup.material, setup.scope)
        if axis != "frequency":
            return cls(path_of(question), values + setup.height, np.zeros(len(values)))
        scale = Spacing.over(values)
        path = path_over(question, "frequency", scale, lambda _: setup.height, False)
        return cls(path, np.full(len(values), setup.height), scale.m(values))


def branches(setup: CurveSetting, axis: str, values: np.ndarray) -> CurveBranches:
    """The branches of a sweep over these values [Hz or m]."""
    question = Question(setup.material, setup.scope)
    try:
        if axis != "frequency" and question.only_in_time:
            return _branches_in_time(question, values + setup.height)
        path, x, m = Course.of(setup, axis, values)
        if axis == "frequency":
            return _collect(swept_curves(path, m), m, np.ptp(values) / 2)
        curves = distance_curves(path, np.sort(x), beyond=MARGIN * float(np.ptp(x)))
        return _collect(curves, x, 1.0)
    except InputError:  # a law that cannot have this material
        return _no_branches(values)


def moved(setup: CurveSetting, axis: str, values: np.ndarray, rows: np.ndarray, at: np.ndarray) -> np.ndarray | None:
    """Stable orbits at values[at], each near one of another setup, as the detector sees them; None if one is missing.

    That is what a derivative needs, by Newton's method for each datum, in a tenth of the time that all branches take.
    """
    path, x, m = Course.of(setup, axis, values)
    curves = Curves(path, ENTRY_Z0, x, (0.0, np.inf, 0.0), 0)
    solved = curves.stable_rows_at(rows, m[at], x[at])
    if solved is None or (np.abs(solved[:, col.AMPLITUDE] / rows[:, col.AMPLITUDE] - 1) > NEAR).any():
        return None
    turned = within_half_a_turn(np.degrees(solved[:, col.PHASE] - rows[:, col.PHASE]))
    return None if (np.abs(turned) > NEAR_PHASE).any() else curves.seen(solved)


def _branches_in_time(question: Question, tip_offsets: np.ndarray) -> CurveBranches:
    """Branches of a tip that approaches and retracts in time: parts of its motion on one side of the resonance.

    It comes nearer than the data, where it turns repulsive if it had not before, so that its way back is that branch.
    """
    nearest, half = float(tip_offsets.min()), 0.5 * question.scope.driven_amplitude
    nearer = np.linspace(half, nearest, NEARER if half < nearest else 0, endpoint=False)
    x, work, branches = np.concatenate([nearer, np.sort(tip_offsets)]), question.work(marched=True), []
    for visit in there_and_back(work, x):
        rows = rows_as_seen(visit.rows, np.broadcast_to(work.lever, (len(x), len(work.lever))))
        repelled = col.is_repulsive(rows)
        for side in (repelled, ~repelled):
            on_side = np.flatnonzero(side & np.isfinite(rows[:, col.AMPLITUDE]))
            for part in np.split(on_side, 1 + np.flatnonzero(np.diff(on_side) > 1)) if len(on_side) else ():
                gap = np.maximum(0, np.maximum(x[part[0]] - tip_offsets, tip_offsets - x[part[-1]]))
                values = [np.interp(tip_offsets, x[part], rows[part, column]) for column in (col.AMPLITUDE, col.PHASE)]
                branches.append((*values, gap))
    if not branches:
        return _no_branches(tip_offsets)
    amplitude, phase, gap = (np.stack(each) for each in zip(*branches, strict=True))
    return CurveBranches(amplitude, np.degrees(phase), gap)


def _no_branches(values: np.ndarray) -> CurveBranches:
    """Branches without any orbit: amplitude 0, at a gap as wide as the axis."""
    count = len(values)
    return CurveBranches(np.zeros((1, count)), np.zeros((1, count)), np.full((1, count), float(np.ptp(values))))


def _collect(curves: Curves, x: np.ndarray, unit: float) -> CurveBranches:
    """Values at x, which are rows of the curves, so that the interpolation between rows changes nothing."""
    parts = stable_segments(curves)
    if not parts:  # nothing oscillates
        return _no_branches(x * unit)
    rows = np.stack([np.stack([np.interp(x, part.x, one) for one in part.rows.T], axis=1) for part in parts])
    read = curves.seen(rows)
    gap = np.stack([np.maximum(0, np.maximum(part.x[0] - x, x - part.x[-1])) for part in parts])
    return CurveBranches(read[..., col.AMPLITUDE], np.degrees(read[..., col.PHASE]), gap * unit, rows)


@dataclass(frozen=True, eq=False)
class Ruler:
    """Scales that make differences of curve and data dimensionless: amplitude [m], phase [degree], gap along the axis.

    The data's own errors make it strict; a few percent of the picture make it coarse, so that curves which are far
    from the data are compared as the eye does it, by their distance in any direction.
    """

    size: dict[str, np.ndarray]
    gap: float

    @classmethod
    def strict(cls, data: Data) -> Ruler:
        """Scales by the errors of the data."""
        return cls(data.errors, STRICT * data.spacing)

    @classmethod
    def coarse(cls, data: Data) -> Ruler:
        """Scales by the errors of the data and a few percent of the range of the curve."""
        size = {}
        for name, errors in data.errors.items():
            size[name] = np.hypot(errors, COARSE_PHASE if name == "phase" else COARSE * data.measured[name].max())
        return cls(size, COARSE * float(np.ptp(data.values)))


@dataclass(frozen=True, eq=False)
class Choice:
    """An orbit for each datum."""

    read: dict[str, np.ndarray]  # amplitude [m] and phase [degree] as they would be read, or one of them
    gap: np.ndarray  # shape (directions, n); how far the datum is beyond the end of the branch [units of the axis]
    branch: np.ndarray | None = None  # shape (directions, n); its number


class CurveProblem:
    """Residuals and their derivatives, by scaled parameters q.

    A datum is compared with the stable branch that is nearest to it. A branch that has ended stays in the comparison
    as its last orbit, at a price that rises from 0 with the distance from its end: residuals are continuous in q while
    jumps pass data, and pull them back.
    """

    def __init__(self, data: Data, setup: CurveSetting, parameters: tuple[Parameter, ...]) -> None:
        self.data, self.setup, self.parameters = data, setup, parameters
        self.evaluations = 0
        self._kept: dict[bytes, CurveBranches] = {}

    def setup_at(self, q: np.ndarray) -> CurveSetting:
        """Material and microscope at the fitted parameters q."""
        setup = self.setup
        for parameter, number in zip(self.parameters, q, strict=True):
            setup = setup.with_parameter(parameter.name, parameter.value(float(number)))
        return setup

    def choose(self, q: np.ndarray, ruler: Ruler, near: Choice | None = None) -> Choice:
        """The orbits at q that are nearest to others, or to the data."""
        wanted = near or Choice(self.data.measured, np.zeros(self._shape))
        setup, branches = self.setup_at(q), self._branches(q)
        read = setup.read(branches.amplitude[:, None], branches.phase[:, None])
        apart = ((branches.gap[:, None] - wanted.gap) / ruler.gap) ** 2
        for name, numbers in wanted.read.items():
            apart = apart + (difference(name, read[name], numbers) / ruler.size[name]) ** 2
        best = np.argmin(apart, axis=0)

        def chosen(values: np.ndarray) -> np.ndarray:
            return np.take_along_axis(np.broadcast_to(values, apart.shape), best[None], axis=0)[0]

        return Choice({name: chosen(read[name]) for name in wanted.read}, chosen(branches.gap[:, None]), best)

    def residuals(self, q: np.ndarray, ruler: Ruler) -> np.ndarray:
        """Differences of model and data and the gaps, over what counts as one, and what the prior says against q."""
        return np.concatenate([self._compare(self.choose(q, ruler), ruler), q])

    def chi2_and_growth(self, q: np.ndarray) -> tuple[float, float]:
        """chi2 of the data by their errors as stated, and the factor by which these have to be larger, 1 at least."""
        chi2 = float((self.residuals(q, Ruler.strict(self.data))[: self.data.size] ** 2).sum())
        return chi2, math.sqrt(max(1.0, chi2 / (self.data.size - len(q))))

    def jacobian(
        self, q: np.ndarray, ruler: Ruler, axes: np.ndarray | None = None, steps: float | np.ndarray = STEP
    ) -> np.ndarray:
        """Central differences of the residuals along the parameters or other axes, shape (residuals, axes).

        Each datum stays on the branch that it has at q. The derivatives of the prior are the axes themselves.
        """
        along = np.eye(len(q)) if axes is None else axes
        moves = along * np.broadcast_to(steps, len(along))[:, None]
        here, places = self.choose(q, ruler), [*(q + moves), *(q - moves)]
        beside = _map_in_threads(lambda at: self._orbits_near(at, q, here), places)
        self._prepare([q, *(at for at, found in zip(places, beside, strict=True) if found is None)])
        chosen = [found or self.choose(at, ruler, here) for at, found in zip(places, beside, strict=True)]
        ahead, behind = np.split(np.array([self._compare(one, ruler) for one in chosen]), 2)
        slopes = (ahead - behind) / (2 * np.linalg.norm(moves, axis=1))[:, None]
        return np.concatenate([slopes.T, along.T])

    def _orbits_near(self, at: np.ndarray, q: np.ndarray, here: Choice) -> Choice | None:
        """Orbits at parameters near q on the branches chosen at q, each by Newton's method from that at q (`moved`).

        None where branches have to be followed first: where one ended before a datum (`gap`), one is lost, or no
        parameter that moves the tip differs (`_motion_key`), for then the branches at q are those of both.
        """
        branches, count = self._branches(q), len(self.data.values)
        if (
            branches.rows is None
            or here.branch is None
            or here.gap.any()
            or self._motion_key(at) == self._motion_key(q)
        ):
            return None
        setup, wanted = self.setup_at(at), here.branch * count + np.arange(count)
        distinct, which = np.unique(wanted, return_inverse=True)
        rows = branches.rows.reshape(-1, col.FULL)[distinct]
        solved = moved(setup, self.data.axis, self.data.values, rows, distinct % count)
        if solved is None:
            return None
        orbits = solved[which.reshape(wanted.shape)]
        read = setup.read(orbits[..., col.AMPLITUDE], np.degrees(orbits[..., col.PHASE]))
        return Choice({name: read[name] for name in here.read}, here.gap)

    @property
    def _shape(self) -> tuple[int, int]:
        """Shape of the data: directions, values."""
        return len(self.data.directions), len(self.data.values)

    def _compare(self, choice: Choice, ruler: Ruler) -> np.ndarray:
        """Residuals of what was chosen, over the ruler, with the gaps to branches that end."""
        parts = [
            difference(name, choice.read[name], wanted) / ruler.size[name]
            for name, wanted in self.data.measured.items()
        ]
        return np.concatenate([part.ravel() for part in (*parts, choice.gap / ruler.gap)])

    def _branches(self, q: np.ndarray) -> CurveBranches:
        """Branches of the curve at q, solved once for all parameters with the same motion."""
        key = self._motion_key(q)
        if key not in self._kept:
            self._prepare([q])
        return self._kept[key]

    def _motion_key(self, q: np.ndarray) -> bytes:
        """Bytes of those parameters in q that change the motion: a key for branches that are kept."""
        return np.array([one for p, one in zip(self.parameters, q, strict=True) if p.name not in SCALES]).tobytes()

    def _prepare(self, places: list[np.ndarray]) -> None:
        """Compute the branches at these q, on all cores, and forget those elsewhere."""
        wanted = {self._motion_key(q): q for q in places}
        new = {key: q for key, q in wanted.items() if key not in self._kept}
        found = _map_in_threads(lambda q: branches(self.setup_at(q), self.data.axis, self.data.values), new.values())
        kept = self._kept | dict(zip(new, found, strict=True))
        self._kept = {key: kept[key] for key in wanted}
        self.evaluations += len(new)


def _map_in_threads(function: Callable[[np.ndarray], Any], places: Iterable[np.ndarray]) -> list[Any]:
    """Results of a function at each of these parameters q, computed on all cores."""
    with ThreadPoolExecutor(workers_of(None)) as pool:
        return list(pool.map(function, places))


def difference(name: str, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Difference of two arrays, the first less the second; phases [degree] within half a turn."""
    apart: np.ndarray = first - second
    return within_half_a_turn(apart) if name == "phase" else apart
