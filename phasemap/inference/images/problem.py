"""Orbits of materials in every image, and the least squares of materials.

There are n problems, each of the same regions in the same images; a pixel is one region. Phase and height are those of
averaged orbits and of a defect, the difference of exact and averaged orbits at the material found before (theory,
Eq. (inversion-2)). A projection takes zeros out (theory, Eq. (inversion-5)). Many are solved at once by
Levenberg-Marquardt steps: theory, Eq. (inversion-4).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels.columns import DYNAMIC_LOSS, DYNAMIC_STIFFNESS
from phasemap._kernels.law import Law
from phasemap._kernels.rows.derivatives import Found, Setpoints, averaged_block
from phasemap._shared.arrays import within_half_a_turn
from phasemap._shared.errors import InputError
from phasemap._shared.notices import unquestioned
from phasemap._shared.threads import bounds_of, chunk_of, spread, workers_of
from phasemap.experiment.lever import lever_of, of_tip
from phasemap.experiment.material import Material
from phasemap.experiment.material_rows import contact_stiffness, film_of, properties, rows_of
from phasemap.experiment.microscope import Microscope
from phasemap.inference.images.stack import HEIGHT, PHASE, Projection, Stack, Zeros
from phasemap.inference.verdict import REACH

Array = NDArray[np.float64]
Codes = NDArray[np.int8]
Flags = NDArray[np.bool_]

STEP = 1e-5  # of a logarithm, for derivatives of orbits: coarser ones end descents early in long valleys
LIMITS = np.array([1e-5, 1e-14])  # errors left in exact orbits: phase [rad], tip offset [m]
SIDES = np.array([[-1], [1]], np.int8)  # attractive and repulsive branch

MOST_STEPS = 40
CLOSE = 1e-4  # decrease of chi2 still to be expected where a problem is done
LONGEST = 1.0  # of a step, in a logarithm
DEFECTS = 2  # times that the difference of exact and averaged orbits is taken, if not
ENOUGH = 0.01  # of a standard error: by as much, at most, that difference is then expected to change
BESIDE = 1e-3  # of a logarithm, where exact orbits are asked for if those of a material itself are not found


@dataclass(frozen=True, eq=False)
class Model:
    """Materials by the logarithms of their properties over those of a reference."""

    reference: Array  # shape (3,); modulus [Pa], adhesion [J/m2], damping [1]
    width: float  # standard deviation of each logarithm by the prior, which is about 0
    film: Array | None  # shape (1, 2); Poisson's ratio [1] and thickness [m] of films, None of half-spaces
    poisson_ratio: float
    scope: Microscope
    law: Law
    levers: Array  # shape (m, of a lever)
    amplitudes: Array  # shape (m,); at the setpoint [m]

    @property
    def reach(self) -> float:
        """Largest logarithm that is tried."""
        return REACH * self.width

    def image(self, j: int) -> Model:
        """The same for one image only."""
        return replace(self, levers=self.levers[j : j + 1], amplitudes=self.amplitudes[j : j + 1])

    def around(self, material: Material) -> Model:
        """The same with this material as the reference."""
        row, viscous = rows_of([material])
        _, adhesion, damping = properties(row, viscous, self.scope)
        reference = np.array([material.modulus, float(adhesion[0]), float(damping[0])])
        return replace(self, reference=reference, film=film_of(row), poisson_ratio=material.poisson_ratio)

    def at_settings(self, amplitudes: Array, ratios: Array) -> Model:
        """The same for images at these free amplitudes at the drive frequency [m] and setpoints."""
        drive = self.scope.drive
        with unquestioned():
            twice = replace(self.scope, drive=replace(drive, free_amplitude=2 * drive.free_amplitude))
        once = lever_of(self.scope)
        more = (amplitudes / self.scope.driven_amplitude - 1)[:, None] * (lever_of(twice) - once)
        return replace(self, levers=once + more, amplitudes=amplitudes * ratios)

    def materials(self, q: Array) -> Array:
        """Modulus, adhesion and damping at these logarithms, shape (n, 3)."""
        materials: Array = self.reference * np.exp(q)
        return materials

    def rows(self, q: Array) -> Array:
        """Parameters of the kernels, shape (n, 16)."""
        modulus, adhesion, damping = self.materials(q).T
        stiffness = contact_stiffness(modulus, np.full(len(q), self.poisson_ratio), self.scope.tip)
        film = None if self.film is None else np.broadcast_to(self.film, (len(q), 2))
        return self.scope.interaction.columns(stiffness, adhesion, damping, self.scope.tip.radius, film)

    def averaged(self, q: Array, sides: Codes, places: Array, search: bool = False) -> Found:
        """Averaged orbits of n materials in all images near `places`, which are moved to them, and derivatives.

        `search`: whether to look for orbits everywhere where `places` lead nowhere.
        """
        n, m = sides.shape
        found = Found(np.zeros((n, m, 2)), np.zeros((n, m, 2, 3)), np.zeros(n, np.bool_))
        rows = np.stack([self.rows(q), *(self.rows(q + STEP * axis) for axis in np.eye(3))])
        averaged_block(self.law, rows, STEP, Setpoints(self.levers, self.amplitudes, sides, places), search, found)
        return found

    def phases(self, q: Array, places: Array, asked: NDArray[np.bool_] | None = None, search: bool = False) -> Array:
        """Averaged phases [rad] of one material in each image on both branches, shape (2, m); `places` are moved.

        `asked` (shape (2, m)): where there may be an orbit at all; NaN elsewhere, and where there is none.
        """
        from phasemap._kernels.rows.derivatives import averaged_phases

        rows, phases = self.rows(q), np.empty_like(places)
        sides = SIDES * np.ones(places.shape, np.int8) if asked is None else SIDES * asked

        def solve(first: int, last: int) -> None:
            some = slice(first, last)
            levers, held = self.levers[some], self.amplitudes[some]
            for side, place, phase in zip(sides, places, phases, strict=True):
                setpoints = Setpoints(levers, held, side[some], place[some])
                averaged_phases(self.law, rows[some], setpoints, search, phase[some])

        cores = workers_of(None)
        spread(solve, bounds_of(len(rows), chunk_of(len(rows), cores, len(rows))), cores, None)
        return phases

    def exact(self, q: Array, sides: Codes, places: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Exact orbits next to the averaged ones, shape (n, m, 2), and where they were found, shape (n, m)."""
        from phasemap._kernels.rows.derivatives import exact_block

        values, good = np.zeros((*sides.shape, 2)), np.zeros(sides.shape, np.bool_)
        setpoints = Setpoints(self.levers, self.amplitudes, sides, places)
        exact_block(self.law, self.rows(q), setpoints, LIMITS, values, good)
        return values, good


def make_model(scopes: Sequence[Microscope], setpoints: Sequence[float], prior: Material, factor: float) -> Model:
    """The model of images, around a prior material known within this factor."""
    scope = scopes[0]
    if scope.interaction.withdrawal != "linear":
        allowed = "'linear', for images of contacts that remember are not inverted"
        raise InputError("withdrawal", scope.interaction.withdrawal, allowed)
    if scope.interaction.law.takes_film and prior.thickness is None:
        raise InputError("thickness of the prior", None, "a number in m, of the film, where the contact is that of one")
    amplitudes = [ratio * one.driven_amplitude for ratio, one in zip(setpoints, scopes, strict=True)]
    model = Model(
        np.ones(3), float(np.log(factor)), None, 0.0, scope, scope.interaction.token(),
        np.array([lever_of(one) for one in scopes]), np.array(amplitudes),
    )  # fmt: skip
    return model.around(prior)


def sides_of(stack: Stack) -> Codes:
    """Branch of each datum, shape (n, m): the sign of the tip's phase beside the free one's; 0 without a datum.

    A height without a phase is taken to be on the branch of most other images.
    """
    seen = np.isfinite(stack.errors[:, :, PHASE])
    turn, phases = [], stack.values[:, :, PHASE].copy()
    for j, (scope, setpoint) in enumerate(zip(stack.scopes, stack.setpoints, strict=True)):
        lever = lever_of(scope)
        turn.append(np.arctan2(lever[DYNAMIC_STIFFNESS], lever[DYNAMIC_LOSS]))
        phases[:, j] = of_tip(lever, setpoint * scope.driven_amplitude, phases[:, j])[1]
    raised = np.where(phases > np.array(turn), 1, -1)
    most = np.where((raised * seen).sum(axis=1, keepdims=True) < 0, -1, 1)
    sides = np.where(seen, raised, most)
    return np.where(seen | np.isfinite(stack.errors[:, :, HEIGHT]), sides, 0).astype(np.int8)


@dataclass(frozen=True, eq=False)
class Problem:
    """The same regions and images in n problems, which differ in their data, branches, and what is expected."""

    model: Model
    unknown: NDArray[np.intp]  # regions whose material is sought, u of r
    data: Array  # shape (n, r, m, 2); phase [rad] and tip offset up to a constant [m]
    weights: Array  # shape (r, m, 2); 1 over their standard errors, 0 without a datum
    sides: Codes  # shape (n, r, m)
    fixed: Array  # shape (n, r, m, 2); of regions of known materials
    projection: Projection
    held: Array  # shape (n, p); what is known of the zeros beforehand, over its standard error
    centre: Array  # shape (n, 3 u); of the prior
    prior: Array  # shape (3 u, 3 u)

    def part(self, chosen: NDArray[Any]) -> Problem:
        """The same for some of the problems."""
        some = {name: getattr(self, name)[chosen] for name in ("data", "sides", "fixed", "held", "centre")}
        return replace(self, **some)

    def orbits(self, q: Array, places: Array, search: bool = False) -> Found:
        """Averaged orbits of these materials near `places`, which are moved to them."""
        n, m, u = len(self.sides), self.sides.shape[2], len(self.unknown)
        there = places[:, self.unknown].reshape(n * u, m)
        found = self.model.averaged(q.reshape(n * u, 3), self.sides[:, self.unknown].reshape(n * u, m), there, search)
        places[:, self.unknown] = there.reshape(n, u, m)
        values = self.fixed.copy()
        values[:, self.unknown] = found.values.reshape(n, u, m, 2)
        good = np.asarray(found.good.reshape(n, u).all(axis=1))
        return Found(values, found.slopes.reshape(n, u, m, 2, 3), good)

    def defect(self, q: Array, places: Array, values: Array) -> tuple[Array, Flags]:
        """How much exact orbits differ from these averaged values, and of which problems all are known."""
        n, r, m = self.sides.shape
        u, sides = len(self.unknown), self.sides[:, self.unknown].reshape(-1, m)
        exact, good = self.model.exact(q.reshape(n * u, 3), sides, places[:, self.unknown].reshape(n * u, m))
        defect = np.zeros((n, r, m, 2))
        defect[:, self.unknown] = np.nan_to_num(exact.reshape(n, u, m, 2) - values[:, self.unknown])
        return defect, (good | (sides == 0)).reshape(n, u * m).all(axis=1)

    def weigh(self, slopes: Array) -> Array:
        """Derivatives of the residuals, shape (n, data and zeros, 3 u)."""
        n, u = slopes.shape[:2]
        size, zeros = self.weights.size, self.held.shape[1]
        full = np.zeros((n, size + zeros, 3 * u))
        parts = full[:, :size].reshape(n, *self.weights.shape, u, 3)
        for i, region in enumerate(self.unknown):
            parts[:, region, :, :, i] = slopes[:, i] * self.weights[region, ..., None]
        full[:, :size] = parts.reshape(n, size, 3 * u)
        return self.projection.without(full)

    def residuals(self, values: Array, defect: Array) -> Array:
        """Weighted residuals at zeros of 0, shape (n, data and zeros)."""
        apart = (self.data - values - defect) * self.weights
        return np.concatenate([apart.reshape(len(apart), self.weights.size), self.held], axis=1)

    def rest(self, values: Array, defect: Array) -> Array:
        """Weighted residuals without what zeros explain."""
        return self.projection.without(self.residuals(values, defect)[..., None])[..., 0]

    def cost(self, rest: Array, q: Array) -> Array:
        """chi2 of data, of which these residuals are left, and priors, shape (n,)."""
        apart = q - self.centre
        cost: Array = (rest**2).sum(axis=1) + ((apart @ self.prior) * apart).sum(axis=1)
        return cost

    def zeros(self, values: Array, defect: Array) -> Array:
        """The zeros that go with these orbits, shape (n, p)."""
        return self.residuals(values, defect) @ self.projection.inverse.T


def problem_of(
    model: Model, stack: Stack, sides: Codes, zeros: Zeros, fixed: dict[int, Array] | None = None
) -> Problem:
    """The problem of one stack of regions, from each set of branches.

    `sides` (shape (n, r, m)).
    `fixed` (shape (n, m, 2)): phase and tip offset of the regions of known material.
    """
    fixed = fixed or {}
    count, regions, _ = sides.shape
    unknown = np.array([r for r in range(regions) if r not in fixed])
    known = np.zeros((count, *stack.values.shape))
    for r, values in fixed.items():
        known[:, r] = values
    weights = np.where(np.isfinite(stack.errors), 1.0 / stack.errors, 0.0)
    return Problem(
        model, unknown, np.repeat(stack.values[None], count, axis=0), weights, sides, known, zeros.weighted(weights),
        np.zeros((count, len(zeros.widths))), np.zeros((count, 3 * len(unknown))),
        model.width**-2 * np.eye(3 * len(unknown)),
    )  # fmt: skip


def problem_of_pixels(model: Model, stack: Stack) -> Problem:
    """The problem of each pixel, whose topography is the one zero that is unknown; all have the same errors."""
    columns = np.zeros((1, len(stack.setpoints), 2, 1))
    columns[:, :, HEIGHT] = 1.0
    zeros = Zeros(columns, np.array([np.inf]))
    sides = sides_of(stack)[:, None]
    data = stack.values[:, None].copy()
    data[..., PHASE] = within_half_a_turn(data[..., PHASE], 2 * np.pi)
    return replace(problem_of(model, stack.part(slice(1)), sides, zeros), data=data)


class Solution(NamedTuple):
    """What was found for n problems."""

    q: Array  # shape (n, 3 u)
    # places, defect: shape (n, r, m), (n, r, m, 2); where the averaged orbits are, and how much the exact ones differ
    places: Array
    defect: Array
    values: Array  # shape (n, r, m, 2); phase and tip offset of averaged orbits
    slopes: Array  # shape (n, u, m, 2, 3)
    # good, exact: shape (n,); whether there is an orbit in every image, and whether the exact ones are known
    good: Flags
    exact: Flags
    cost: Array  # shape (n,); infinite without orbits

    def part(self, chosen: NDArray[Any]) -> Solution:
        """The same for some of the problems."""
        return Solution(*(values[chosen] for values in self))

    def put(self, chosen: NDArray[Any], other: Solution) -> None:
        """Replace some of the problems."""
        for whole, part in zip(self, other, strict=True):
            whole[chosen] = part


def normal_equations(problem: Problem, slopes: Array, rest: Array, q: Array) -> tuple[Array, Array]:
    """N and J^T r - prior (q - q0) of n problems with these derivatives and residuals."""
    turned = slopes.transpose(0, 2, 1)
    return problem.prior + turned @ slopes, (problem.centre - q) @ problem.prior + (turned @ rest[..., None])[..., 0]


def descend(problem: Problem, q: Array, places: Array, defect: Array) -> Solution:
    """Go downhill from these materials and places of their orbits, with this difference of exact and averaged ones."""
    q, places = q.copy(), places.copy()
    found = problem.orbits(q, places, search=True)
    exact = np.zeros(len(q), bool)
    return _descend(problem, Solution(q, places, defect.copy(), *found, exact, np.zeros(len(q))))


def _descend(problem: Problem, found: Solution) -> Solution:
    """Go downhill from what was found; its arrays are changed."""
    q, cost, reach = found.q, found.cost, problem.model.reach
    cost[:] = np.where(found.good, problem.cost(problem.rest(found.values, found.defect), q), np.inf)
    damping = np.full(len(q), 1e-2)
    active = found.good & (problem.sides != 0).any(axis=(1, 2))
    for _ in range(MOST_STEPS):
        some = np.flatnonzero(active)
        if not len(some):
            break
        part, last = problem.part(some), found.part(some)
        rest = part.rest(last.values, last.defect)
        matrix, pull = normal_equations(part, part.weigh(last.slopes), rest, last.q)
        steep = matrix * (1 + damping[some, None, None] * np.eye(q.shape[1]))
        step = np.linalg.solve(steep, pull[..., None])[..., 0]
        expected = (step * pull).sum(axis=1)
        step *= np.minimum(1.0, LONGEST / np.maximum(np.abs(step).max(axis=1), 1e-300))[:, None]
        trial = np.clip(last.q + step, -reach, reach)
        new = part.orbits(trial, last.places)
        new_cost = np.where(new.good, part.cost(part.rest(new.values, last.defect), trial), np.inf)
        better = new_cost <= last.cost
        moved = last._replace(q=trial, values=new.values, slopes=new.slopes, cost=new_cost)
        found.put(some[better], moved.part(better))
        damping[some] = np.where(better, 0.1 * damping[some], 6.0 * damping[some])
        active[some] = ~((better & (expected < CLOSE)) | (damping[some] > 1e8))
    return found


def refine(problem: Problem, found: Solution, times: int = DEFECTS) -> Solution:
    """Go on with the difference of exact and averaged orbits where the last descent ended, until it stays."""
    left = np.arange(len(found.q))
    for _ in range(times):
        part, last = problem.part(left), found.part(left)
        defect, known = _defect(part, last)
        start = last._replace(
            q=last.q.copy(), defect=np.where(known[:, None, None, None], defect, last.defect), exact=known
        )
        again = _descend(part, start)
        found.put(left, again)
        moved = np.abs(again.q - last.q).max(axis=1)  # the defect changes by less than its share of that
        done = moved * np.abs(again.defect * problem.weights).max(axis=(1, 2, 3)) < ENOUGH
        left = left[~(known & done)]
    return found


def _defect(problem: Problem, found: Solution) -> tuple[Array, Flags]:
    """Difference of exact and averaged orbits, there or a little beside, and of which problems it is known."""
    defect, known = problem.defect(found.q, found.places, found.values)
    lost = np.flatnonzero(~known)
    part, beside, places = problem.part(lost), found.q[lost] + BESIDE, found.places[lost]
    averaged = part.orbits(beside, places)
    defect[lost], known[lost] = part.defect(beside, places, averaged.values)
    return defect, known
