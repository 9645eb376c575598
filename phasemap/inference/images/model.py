"""Orbits of materials in every image, averaged and exact, and how the averaged ones change with the properties."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels.columns import DYNAMIC_LOSS, DYNAMIC_STIFFNESS
from phasemap._kernels.law import Law
from phasemap._kernels.rows.derivatives import Found, Setpoints, averaged_block
from phasemap._shared.errors import InputError
from phasemap._shared.notices import unquestioned
from phasemap._shared.threads import bounds_of, chunk_of, spread, workers_of
from phasemap.experiment.lever import lever_of, of_tip
from phasemap.experiment.material import Material
from phasemap.experiment.material_rows import contact_stiffness, film_of, properties, rows_of
from phasemap.experiment.microscope import Microscope
from phasemap.inference.images.stack import HEIGHT, PHASE, Stack
from phasemap.inference.verdict import REACH

Array = NDArray[np.float64]
Codes = NDArray[np.int8]

STEP = 1e-5  # of a logarithm, for derivatives of orbits: coarser ones end descents early in long valleys
LIMITS = np.array([1e-5, 1e-14])  # errors left in exact orbits: phase [rad], tip offset [m]
SIDES = np.array([[-1], [1]], np.int8)  # attractive and repulsive branch


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
