"""Measured curves beside the stable orbits at every point of an axis: each datum against the branch that it lies on."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from phasemap._kernels import columns as col
from phasemap._shared.errors import InputError
from phasemap._shared.threads import workers_of
from phasemap.experiment.excitation import seen
from phasemap.inference.curves.data import Data, Parameter, Setup
from phasemap.solvers.continuation.complete import FAINT, complete
from phasemap.solvers.continuation.path import BEYOND, Question, Scale, fixed_path, swept_path
from phasemap.solvers.continuation.pieces import Curves
from phasemap.solvers.continuation.visit import segments
from phasemap.sweeps.follow import STARTS, begin
from phasemap.sweeps.in_time import there_and_back

MARGIN = 1e-3  # of the range of tip offsets, by which a curve goes beyond
STEP = 1e-4  # of the prior's standard deviations, of central differences
COARSE = 0.03  # of the picture (largest amplitude, range of the axis): as near counts as one in the coarse comparison
COARSE_PHASE = 3.0  # the same for phases [degree]
STRICT = 0.1  # of the spacing of the data: a branch that ends as much before a datum costs one standard error


@dataclass(frozen=True, eq=False)
class Branches:
    """Stable branches, each continued at its ends as a constant."""

    amplitude: np.ndarray  # shape (branches, n) [m]
    phase: np.ndarray  # shape (branches, n) [degree]
    # shape (branches, n); how far the point is beyond the branch's end [units of the axis]; 0 on the branch
    gap: np.ndarray


def branches(setup: Setup, axis: str, values: np.ndarray) -> Branches:
    """The branches of a sweep.

    `values`: [Hz or m].
    """
    if axis == "frequency":
        return _of_frequency(setup, values)
    return _of_distance(setup, values)


def _of_frequency(setup: Setup, frequencies: np.ndarray) -> Branches:
    from phasemap._kernels.continuation.path import ENTRY_M

    scale = Scale.over(frequencies)
    question = Question(setup.material, setup.scope)
    path = swept_path(question, "frequency", scale, lambda _: setup.height, False)
    x = scale.m(frequencies)
    curves = Curves(path, ENTRY_M, np.sort(np.concatenate([x, STARTS])), (-BEYOND, BEYOND, 0.0), 0)
    for m in STARTS:
        begin(curves, m, False)
    return _collect(curves, col.PARAMETER, x, np.ptp(frequencies) / 2)


def _of_distance(setup: Setup, tip_offsets: np.ndarray) -> Branches:
    from phasemap._kernels.continuation.path import ENTRY_Z0

    question = Question(setup.material, setup.scope)
    if question.only_in_time:
        return _of_passage(question, tip_offsets + setup.height)
    path = fixed_path(question)
    x = np.sort(tip_offsets + setup.height)
    beyond = MARGIN * (x[-1] - x[0])
    curves = Curves(path, ENTRY_Z0, x, (x[0] - beyond, np.inf, FAINT * setup.scope.driven_amplitude), 0)
    curves.from_far(x[-1] + beyond)
    complete(curves, x[0])
    return _collect(curves, col.TIP_OFFSET, tip_offsets + setup.height, 1.0)


def _of_passage(question: Question, tip_offsets: np.ndarray) -> Branches:
    """Branches on which a tip is that comes and goes in time: parts of its way on one side of the resonance."""
    order = np.argsort(tip_offsets)
    x, work, found = tip_offsets[order], question.work(marched=True), []
    for visit in there_and_back(work, x):
        rows = seen(visit.rows, np.broadcast_to(work.lever, (len(x), len(work.lever))))
        repelled = rows[:, col.STIFFENING] > 0
        for side in (repelled, ~repelled):
            part = np.flatnonzero(side & np.isfinite(rows[:, col.AMPLITUDE]))
            if len(part):
                gap = np.maximum(0, np.maximum(x[part[0]] - tip_offsets, tip_offsets - x[part[-1]]))
                values = [np.interp(tip_offsets, x[part], rows[part, one]) for one in (col.AMPLITUDE, col.PHASE)]
                found.append((*values, gap))
    if not found:
        return _nothing(len(x), float(np.ptp(x)))
    amplitude, phase, gap = (np.stack(each) for each in zip(*found, strict=True))
    return Branches(amplitude, np.degrees(phase), gap)


def _collect(curves: Curves, column: int, x: np.ndarray, unit: float) -> Branches:
    """Values at x, which are rows of the curves, so that the interpolation between rows changes nothing."""
    parts = segments(curves.pieces, column)
    if not parts:  # nothing oscillates
        return _nothing(len(x), float(np.ptp(x)) * unit)
    seen = [curves.seen(part.rows) for part in parts]
    amplitude, phase = (
        np.stack([np.interp(x, part.x, rows[:, column]) for part, rows in zip(parts, seen, strict=True)])
        for column in (col.AMPLITUDE, col.PHASE)
    )
    gap = np.stack([np.maximum(0, np.maximum(part.x[0] - x, x - part.x[-1])) for part in parts])
    return Branches(amplitude, np.degrees(phase), gap * unit)


@dataclass(frozen=True, eq=False)
class Ruler:
    """What counts as one in the comparison: for amplitude [m] and phase [degree] of each datum, and along the axis.

    The data's own errors make it strict; a few percent of the picture make it coarse, so that curves which are far
    from the data are compared as the eye does it, by their distance in any direction.
    """

    size: dict[str, np.ndarray]
    gap: float

    @classmethod
    def strict(cls, data: Data) -> Ruler:
        """The data's errors."""
        return cls(data.errors, STRICT * data.spacing)

    @classmethod
    def coarse(cls, data: Data) -> Ruler:
        """A few percent of the picture, with the data's errors."""
        size = {}
        for name, errors in data.errors.items():
            size[name] = np.hypot(errors, COARSE_PHASE if name == "phase" else COARSE * data.measured[name].max())
        return cls(size, COARSE * float(np.ptp(data.values)))


@dataclass(frozen=True, eq=False)
class Choice:
    """An orbit for each datum."""

    read: dict[str, np.ndarray]  # amplitude [m] and phase [degree] as they would be read, or one of them
    gap: np.ndarray  # shape (directions, n); how far the datum is beyond the end of the branch [units of the axis]


class Problem:
    """Residuals and their derivatives, by scaled parameters q.

    A datum is compared with the stable branch that is nearest to it. A branch that has ended stays in the comparison
    as its last orbit, at a price that rises from 0 with the distance from its end: residuals are continuous in q while
    jumps pass data, and pull them back.
    """

    def __init__(self, data: Data, setup: Setup, parameters: tuple[Parameter, ...]) -> None:
        self.data, self.setup, self.parameters = data, setup, parameters
        self.evaluations = 0
        self._kept: dict[bytes, Branches] = {}

    def at(self, q: np.ndarray) -> Setup:
        """The setup at q."""
        setup = self.setup
        for parameter, number in zip(self.parameters, q, strict=True):
            setup = setup.at(parameter.name, parameter.value(float(number)))
        return setup

    def choose(self, q: np.ndarray, ruler: Ruler, near: Choice | None = None) -> Choice:
        """The orbits at q that are nearest to others, or to the data."""
        wanted = near or Choice(self.data.measured, np.zeros(self._shape))
        setup, found = self.at(q), self._branches(q)
        read = {
            "amplitude": setup.amplitude_scale * found.amplitude[:, None],
            "phase": found.phase[:, None] + setup.phase_offset,
        }
        apart = ((found.gap[:, None] - wanted.gap) / ruler.gap) ** 2
        for name, numbers in wanted.read.items():
            apart = apart + (difference(name, read[name], numbers) / ruler.size[name]) ** 2
        best = np.argmin(apart, axis=0)[None]

        def chosen(values: np.ndarray) -> np.ndarray:
            taken: np.ndarray = np.take_along_axis(np.broadcast_to(values, apart.shape), best, axis=0)[0]
            return taken

        return Choice({name: chosen(read[name]) for name in wanted.read}, chosen(found.gap[:, None]))

    def residuals(self, q: np.ndarray, ruler: Ruler) -> np.ndarray:
        """Differences of model and data and the gaps, over what counts as one, and what the prior says against q."""
        return np.concatenate([self._compare(self.choose(q, ruler), ruler), q])

    def jacobian(
        self, q: np.ndarray, ruler: Ruler, axes: np.ndarray | None = None, steps: float | np.ndarray = STEP
    ) -> np.ndarray:
        """Central differences of the residuals along the parameters or other axes, shape (residuals, axes).

        Each datum stays on the branch that it has at q. The derivatives of the prior are the axes themselves.
        """
        along = np.eye(len(q)) if axes is None else axes
        moves = along * np.broadcast_to(steps, len(along))[:, None]
        self._prepare([q, *(q + moves), *(q - moves)])
        here = self.choose(q, ruler)
        slopes = np.zeros((self.data.size + here.gap.size, len(along)))
        for i, move in enumerate(moves):
            ahead, behind = (self._compare(self.choose(at, ruler, here), ruler) for at in (q + move, q - move))
            slopes[:, i] = (ahead - behind) / (2 * np.linalg.norm(move))
        return np.concatenate([slopes, along.T])

    @property
    def _shape(self) -> tuple[int, int]:
        return len(self.data.directions), len(self.data.values)

    def _compare(self, choice: Choice, ruler: Ruler) -> np.ndarray:
        parts = [
            difference(name, choice.read[name], wanted) / ruler.size[name]
            for name, wanted in self.data.measured.items()
        ]
        return np.concatenate([part.ravel() for part in (*parts, choice.gap / ruler.gap)])

    def _branches(self, q: np.ndarray) -> Branches:
        key = q.tobytes()
        if key not in self._kept:
            self._prepare([q])
        return self._kept[key]

    def _prepare(self, places: list[np.ndarray]) -> None:
        """Compute the branches at these q, on all cores, and forget those elsewhere."""
        kept, self._kept = self._kept, {}
        new = [q for q in places if q.tobytes() not in kept]
        with ThreadPoolExecutor(workers_of(None)) as pool:
            found = pool.map(self._solve, new)
            kept.update(zip([q.tobytes() for q in new], found, strict=True))
        self._kept = {q.tobytes(): kept[q.tobytes()] for q in places}
        self.evaluations += len(new)

    def _solve(self, q: np.ndarray) -> Branches:
        try:
            return branches(self.at(q), self.data.axis, self.data.values)
        except InputError:  # a law that cannot have this material
            return _nothing(len(self.data.values), float(np.ptp(self.data.values)))


def _nothing(count: int, away: float) -> Branches:
    """No branch at all, as far away as this."""
    return Branches(np.zeros((1, count)), np.zeros((1, count)), np.full((1, count), away))


def difference(name: str, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """One less the other; phases within half a turn."""
    apart: np.ndarray = one - other
    return (apart + 180) % 360 - 180 if name == "phase" else apart
