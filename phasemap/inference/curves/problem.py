"""Residuals of measured curves: each datum against the branch that it lies on."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from phasemap._shared.threads import workers_of
from phasemap.inference.curves.branches import Branches, branches
from phasemap.inference.curves.data import Data
from phasemap.inference.curves.parameters import Parameter, Setup

STEP = 3e-4  # of the scaled parameters, of central differences
COARSE = 0.03  # of the picture (largest amplitude, range of the axis): as near counts as one in the coarse comparison
COARSE_PHASE = 3.0  # the same for phases [degree]
STRICT = 0.1  # of the spacing of the data: a branch that ends as much before a datum costs one standard error


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
        """Differences of model and data and the gaps, over what counts as one."""
        return self._compare(self.choose(q, ruler), ruler)

    def jacobian(
        self, q: np.ndarray, ruler: Ruler, axes: np.ndarray | None = None, steps: float | np.ndarray = STEP
    ) -> np.ndarray:
        """Central differences of the residuals along the parameters or other axes, shape (residuals, axes).

        Each datum stays on the branch that it has at q.
        """
        along = np.eye(len(q)) if axes is None else axes
        moves = along * np.broadcast_to(steps, len(along))[:, None]
        self._prepare([q, *(q + moves), *(q - moves)])
        here = self.choose(q, ruler)
        slopes = np.zeros((self.data.size + here.gap.size, len(along)))
        for i, move in enumerate(moves):
            ahead, behind = (self._compare(self.choose(at, ruler, here), ruler) for at in (q + move, q - move))
            slopes[:, i] = (ahead - behind) / (2 * np.linalg.norm(move))
        return slopes

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
            found = pool.map(lambda q: branches(self.at(q), self.data.axis, self.data.values), new)
            kept.update(zip([q.tobytes() for q in new], found, strict=True))
        self._kept = {q.tobytes(): kept[q.tobytes()] for q in places}
        self.evaluations += len(new)


def difference(name: str, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """One less the other; phases within half a turn."""
    apart: np.ndarray = one - other
    return (apart + 180) % 360 - 180 if name == "phase" else apart
