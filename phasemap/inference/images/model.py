"""Orbits of materials in every image, with their derivatives, and the branches that the data tell.

Near known ones orbits are averaged, and exact ones beside these are asked for where a search ends. A lever of low Q, as
in liquid, is far from harmonic: there orbits are exact from the beginning (theory, Eq. (inversion-2)).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels import columns as col
from phasemap._kernels.columns import ErrorLimits
from phasemap._kernels.law import Law
from phasemap._kernels.lever import low_q
from phasemap._kernels.quadrature import TABLES
from phasemap._kernels.rows.collocation_derivatives import PLACE, collocation_block
from phasemap._kernels.rows.derivatives import Derivatives, Setpoints, averaged_block, averaged_phases, response_block
from phasemap._shared.arrays import Array
from phasemap._shared.errors import InputError
from phasemap._shared.notices import unquestioned
from phasemap._shared.threads import bounds_of, chunk_of, spread, workers_of
from phasemap.experiment.accuracy import Accuracy
from phasemap.experiment.lever import of_tip, virial_of
from phasemap.experiment.lever_numbers import lever_of
from phasemap.experiment.material import Material
from phasemap.experiment.material_rows import contact_stiffness, film_of, properties, rows_of
from phasemap.experiment.microscope import Microscope
from phasemap.inference.determined import REACH
from phasemap.inference.images.stack import HEIGHT, PHASE, Stack
from phasemap.solvers.problem import Work
from phasemap.solvers.run import run
from phasemap.solvers.solver import Orbit

Codes = NDArray[np.int8]

STEP = 1e-5  # of a logarithm, for derivatives of orbits: coarser ones end descents early in long valleys
LIMITS = ErrorLimits(phase=1e-5, tip_offset=1e-14)  # of exact orbits
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
    def averages(self) -> bool:
        """True if averaged orbits are near the exact ones for all levers."""
        return not any(low_q(lever) for lever in self.levers)

    @property
    def reach(self) -> float:
        """Largest logarithm that is tried."""
        return REACH * self.width

    def image(self, j: int) -> Model:
        """The model of image j alone."""
        return replace(self, levers=self.levers[j : j + 1], amplitudes=self.amplitudes[j : j + 1])

    def with_reference(self, material: Material) -> Model:
        """The model with this material as its reference."""
        row, viscous = rows_of([material])
        _, adhesion, damping = properties(row, viscous, self.scope)
        reference = np.array([material.modulus, float(adhesion[0]), float(damping[0])])
        return replace(self, reference=reference, film=film_of(row), poisson_ratio=material.poisson_ratio)

    def at_settings(self, amplitudes: Array, ratios: Array) -> Model:
        """The model for images at these free amplitudes at the drive frequency [m] and setpoints."""
        drive = self.scope.drive
        with unquestioned():
            twice = replace(self.scope, drive=replace(drive, free_amplitude=2 * drive.free_amplitude))
        once = lever_of(self.scope)
        more = (amplitudes / self.scope.driven_amplitude - 1)[:, None] * (lever_of(twice) - once)
        return replace(self, levers=once + more, amplitudes=amplitudes * ratios)

    def materials(self, q: Array) -> Array:
        """Modulus, adhesion and damping at these logarithms, shape (n, 3)."""
        return self.reference * np.exp(q)

    def rows(self, q: Array) -> Array:
        """Parameters of the kernels, shape (n, 16)."""
        modulus, adhesion, damping = self.materials(q).T
        stiffness = contact_stiffness(modulus, np.full(len(q), self.poisson_ratio), self.scope.tip)
        film = None if self.film is None else np.broadcast_to(self.film, (len(q), 2))
        return self.scope.interaction.columns(stiffness, adhesion, damping, self.scope.tip.radius, film)

    def nowhere(self, *shape: int) -> Array:
        """Places of orbits of this many materials and images, of which none is known."""
        return np.full(shape if self.averages else (*shape, PLACE), np.nan)

    def orbits(self, q: Array, sides: Codes, places: Array, search: bool = False) -> Derivatives:
        """Orbits of n materials in all images near `places`, which are moved to them, and derivatives.

        Averaged ones, on the branches `sides`; exact ones, wherever those at `places` lead, of levers that averaging is
        no guide to.
        `search`: whether to look for orbits everywhere where `places` lead nowhere.
        """
        n, m = sides.shape
        derivatives = Derivatives(np.zeros((n, m, 2)), np.zeros((n, m, 2, 3)), np.zeros(n, np.bool_))
        rows = np.stack([self.rows(q), *(self.rows(q + STEP * axis) for axis in np.eye(3))])
        setpoints = Setpoints(self.levers, self.amplitudes, sides, places)
        if self.averages:
            averaged_block(self.law, rows, STEP, setpoints, search, derivatives)
            return derivatives
        collocation_block(self.law, rows, STEP, setpoints, search, TABLES, derivatives)
        return derivatives

    def phases(self, q: Array, places: Array, asked: NDArray[np.bool_] | None = None, search: bool = False) -> Array:
        """Averaged phases [rad] of one material in each image on both branches, shape (2, m); `places` are moved.

        `asked` (shape (2, m)): where there may be an orbit at all; NaN elsewhere, and where there is none.
        """
        rows, phases = self.rows(q), np.empty_like(places)
        sides = SIDES * np.ones(places.shape, np.int8) if asked is None else SIDES * asked

        def solve(first: int, last: int) -> None:
            chunk = slice(first, last)
            levers, held = self.levers[chunk], self.amplitudes[chunk]
            for side, place, phase in zip(sides, places, phases, strict=True):
                setpoints = Setpoints(levers, held, side[chunk], place[chunk])
                averaged_phases(self.law, rows[chunk], setpoints, search, phase[chunk])

        cores = workers_of(None)
        spread(solve, bounds_of(len(rows), chunk_of(len(rows), cores, len(rows))), cores, None)
        return phases

    def exact(self, q: Array, sides: Codes, places: Array, engage: bool = True) -> tuple[Array, NDArray[np.bool_]]:
        """Exact orbits, shape (n, m, 2), and where they were found, shape (n, m).

        Those next to averaged ones at `places`; with `engage`, where there are none, those that a tip from far comes to
        if they are on the same branch, and where averaging is no guide on any.
        """
        values, good = np.zeros((*sides.shape, 2)), np.zeros(sides.shape, np.bool_)
        rows = self.rows(q)
        if self.averages:
            setpoints = Setpoints(self.levers, self.amplitudes, sides, places)
            response_block(self.law, rows, setpoints, LIMITS, values, good)
        for j in np.flatnonzero((~good & (sides != 0)).any(axis=0) & engage):
            left = np.flatnonzero(~good[:, j] & (sides[:, j] != 0))
            work = Work(self.law, rows[left], self.levers[j], np.full(len(left), self.amplitudes[j]))
            solved, status, _ = run(Orbit(in_time=not self.averages), work, Accuracy(), threads=1)
            here = col.is_repulsive(solved) == (sides[left, j] > 0)
            good[left, j] = (status == col.GOOD) & (here | (not self.averages))
            values[left, j] = solved[:, [col.PHASE, col.TIP_OFFSET]]
        return values, good

    def sides_of(self, stack: Stack) -> Codes:
        """Branch of each datum, shape (n, m), as of `branches`; 0 without a datum.

        A height without a phase is taken to be on the branch of most other images. Exact orbits are sought on any: 1.
        """
        seen, phases = np.isfinite(stack.errors[:, :, PHASE]), stack.values[:, :, PHASE]
        raised = self.branches(phases) if self.averages else np.ones(phases.shape, np.int8)
        most = np.where((raised * seen).sum(axis=1, keepdims=True) < 0, -1, 1)
        sides = np.where(seen, raised, most)
        return np.where(seen | np.isfinite(stack.errors[:, :, HEIGHT]), sides, 0).astype(np.int8)

    def branches(self, phases: Array) -> Codes:
        """Branches of orbits that the detector sees with these phases, shape (..., m): the sign of their virial."""
        virial = virial_of(self.levers, *of_tip(self.levers, self.amplitudes, phases))
        return np.where(virial > 0, -1, 1).astype(np.int8)


def make_model(scopes: Sequence[Microscope], setpoints: Sequence[float], prior: Material, factor: float) -> Model:
    """The model of images, around a prior material known within this factor."""
    scope = scopes[0]
    if scope.interaction.withdrawal != "linear":
        allowed = "'linear', for images of contacts that remember are not inverted"
        raise InputError("withdrawal", scope.interaction.withdrawal, allowed)
    if scope.interaction.law.takes_film and prior.thickness is None:
        allowed = "a number in m, of the film, where the contact is that of one"
        hint = "prior=Material(..., thickness=20e-9) has it, or with --prior NAME a material of the scene."
        raise InputError("thickness of the prior", None, allowed, hint)
    amplitudes = [ratio * one.driven_amplitude for ratio, one in zip(setpoints, scopes, strict=True)]
    model = Model(
        np.ones(3), float(np.log(factor)), None, 0.0, scope, scope.interaction.token(),
        np.array([lever_of(one) for one in scopes]), np.array(amplitudes),
    )  # fmt: skip
    return model.with_reference(prior)
