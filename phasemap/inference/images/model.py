"""What a material gives in every image, and how that changes with its properties.

Integrals of the force over c are tabulated where the law allows it: theory, Eq. (inversion-2).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels.columns import DRIVE, DYNAMIC_LOSS, DYNAMIC_STIFFNESS
from phasemap._kernels.law import Law
from phasemap._kernels.rows.derivatives import Found, Setpoints, averaged_block
from phasemap._kernels.rows.tabulated import (
    AXES,
    FIRST_OCTAVE,
    LAST_OCTAVE,
    OCTAVE_SHARES,
    PARTS,
    TABLE_INTERVALS,
    TABLE_MEAN,
    TABLE_SUMS,
    TABLE_TERMS,
    Table,
    harmonics_rows,
)
from phasemap._shared.errors import InputError
from phasemap.experiment.excitation import of_tip, sees_tip
from phasemap.experiment.lever import lever_of
from phasemap.experiment.material import Material
from phasemap.experiment.material_rows import rows_of
from phasemap.experiment.microscope import Microscope
from phasemap.experiment.properties import contact_stiffness, film_of, properties
from phasemap.inference.images.stack import HEIGHT, PHASE, Stack

Array = NDArray[np.float64]
Codes = NDArray[np.int8]

WRONG = 1e-9  # of an integral, above which an interval is left out
MOST = 0.9  # of the intervals hold for a law that is affine; for another, those where it has no force
SMALL = 1e-3  # of the amplitude, below which a mean deflection need not be better than this share of it
NODES = np.cos((np.arange(TABLE_TERMS) + 0.5) * np.pi / TABLE_TERMS)  # in an interval
CHECKED = np.array([-0.93, 0.11, 0.97])  # where the table is compared with the integrals
STEP, NEAR = 1e-3, 1e-6  # of a logarithm, for derivatives of orbits and of the kernels' parameters
LIMITS = np.array([1e-5, 1e-14])  # errors left in exact orbits: phase [rad], tip offset [m]
REACH = 3.0  # prior standard deviations within which a material is sought
CORNERS = np.array([[1, 1, -1], [1, -1, 1], [-1, 1, 1], [-1, -1, -1]])  # materials to check tables, in half reaches


class Axes(NamedTuple):
    """Along which materials differ: stiffness, adhesion and damping, in units of their change at the reference."""

    columns: NDArray[np.intp]  # shape (AXES,); column of the kernels' rows that tells the place along an axis
    origin: Array  # shape (AXES,); its value for the reference
    units: Array  # shape (AXES,); what it changes by a unit; 0 where the law does not ask for a property

    def along(self, rows: Array) -> Array:
        """Places of the materials of these rows, shape (n, AXES)."""
        moved = np.ascontiguousarray(rows[:, self.columns]) - self.origin
        return np.divide(moved, self.units, out=np.zeros_like(moved), where=self.units != 0)


class Tables(NamedTuple):
    """Table of the integrals, and the axes that it is for."""

    table: Table
    axes: Axes


def make_tables(law: Law, rows: Array, levers: Array, amplitudes: Array) -> Tables | None:
    """Tables for a law that is affine in what materials change; None for another law.

    Whether it is, and where polynomials do, is told by the integrals of other materials at other places.

    Parameters
    ----------
    law : Law
    rows : ndarray, shape (1 + AXES + checks, ROW)
        Parameters of a reference, of it with each property changed, and of materials to compare with.
    levers, amplitudes : ndarray, shape (m, numbers of a lever), (m,)
        Of images whose detector sees the tip.
    """
    columns = np.argmax(rows[1 : 1 + AXES] != rows[0], axis=1)
    axes = Axes(columns, rows[0, columns], rows[np.arange(1, 1 + AXES), columns] - rows[0, columns])
    ends = np.concatenate(
        [
            [0.0],
            np.ldexp(
                1 + np.arange(OCTAVE_SHARES) / OCTAVE_SHARES, np.arange(FIRST_OCTAVE, LAST_OCTAVE)[:, None]
            ).ravel(),
        ]
    )
    widths = np.diff(ends, append=2.0**LAST_OCTAVE)
    table = Table(
        np.empty((len(levers), 2, TABLE_INTERVALS, TABLE_TERMS, PARTS)),
        np.empty((len(levers), 2, TABLE_INTERVALS), np.bool_),
        np.stack([ends + 0.5 * widths, 2.0 / widths], axis=1), np.empty(len(levers)),
    )  # fmt: skip
    for image, (lever, amplitude) in enumerate(zip(levers, amplitudes, strict=True)):
        _fill(table, image, law, rows, axes, lever, float(amplitude))
    return Tables(table, axes) if table.sound.mean() > MOST else None


def _fill(table: Table, image: int, law: Law, rows: Array, axes: Axes, lever: Array, amplitude: float) -> None:
    """Integrate at one amplitude, fit the polynomials, and see where they hold."""
    x = table.spans[:, :1] + np.concatenate([NODES, CHECKED]) / table.spans[:, 1:]
    sums = np.empty((len(rows), 2 * x.size, TABLE_SUMS))
    table.reaches[image] = harmonics_rows(
        law, rows, lever, amplitude, np.concatenate([1.0 - x.ravel(), 1.0 + x.ravel()]), sums
    )
    sums = sums.reshape(len(rows), 2, *x.shape, TABLE_SUMS)
    parts = np.concatenate(
        [sums[:1], sums[1 : 1 + AXES] - sums[0]]
    )  # (1 + AXES, 2, TABLE_INTERVALS, nodes, TABLE_SUMS)
    to_powers = np.linalg.inv(np.vander(NODES, increasing=True))
    powers = np.einsum("tn,asknv->sktav", to_powers, parts[..., :TABLE_TERMS, :])
    table.coefficients[image] = powers.reshape(2, TABLE_INTERVALS, TABLE_TERMS, PARTS)
    weights = np.concatenate([np.ones((len(rows), 1)), axes.along(rows)], axis=1)
    told = np.einsum(
        "ra,nt,sktav->rsknv", weights, np.vander(CHECKED, TABLE_TERMS, increasing=True), powers, optimize=True
    )
    size = np.einsum("ra,asknv->rsknv", np.abs(weights), np.abs(parts[..., TABLE_TERMS:, :]))
    size += lever[DRIVE]
    size[..., TABLE_MEAN] += SMALL * amplitude - lever[DRIVE]
    table.sound[image] = (np.abs(told - sums[..., TABLE_TERMS:, :]) < WRONG * size).all(axis=(0, 3, 4))


@dataclass(frozen=True, eq=False)
class Model:
    """Materials by the logarithms of their properties over those of a reference."""

    reference: Array  # shape (3,); modulus [Pa], adhesion [J/m2], damping [1]
    # centre, widths: shape (3,); mean and standard deviation of the logarithms by the prior
    centre: Array
    widths: Array
    reach: float  # largest logarithm that is tried
    film: Array | None  # shape (1, 2); Poisson's ratio [1] and thickness [m] of films, None of half-spaces
    poisson_ratio: float
    scope: Microscope
    law: Law
    levers: Array  # shape (m, of a lever)
    amplitudes: Array  # shape (m,); at the setpoint [m]
    tables: Tables | None = None  # where the law and the detector allow them

    def image(self, j: int) -> Model:
        """The same for one image only."""
        return replace(self, levers=self.levers[j : j + 1], amplitudes=self.amplitudes[j : j + 1], tables=None)

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
        """Averaged orbits near `places`, which are moved to them."""
        if self.tables is None:
            return self._integrated(q, sides, places, search)
        from phasemap._kernels.rows.tabulated import tabulated_block

        table, axes = self.tables
        x = axes.along(self.rows(q))
        rates = (axes.along(self.rows(q + NEAR)) - x) / NEAR  # a place depends on its own property only
        found, beyond, before = _unfilled(*sides.shape), np.zeros(len(q), np.bool_), places.copy()
        tabulated_block(table, x, rates, Setpoints(self.levers, self.amplitudes, sides, places), found, beyond)
        again = np.flatnonzero(~found.good & (beyond | search))
        if len(again):
            there = before[again]
            others = self._integrated(q[again], sides[again], there, search)
            places[again] = there
            for whole, part in zip(found, others, strict=True):
                whole[again] = part
        return found

    def _integrated(self, q: Array, sides: Codes, places: Array, search: bool) -> Found:
        """The same by integrals of the force, for any law."""
        found = _unfilled(*sides.shape)
        rows = np.stack([self.rows(q), *(self.rows(q + STEP * axis) for axis in np.eye(3))])
        averaged_block(self.law, rows, STEP, Setpoints(self.levers, self.amplitudes, sides, places), search, found)
        return found

    def exact(self, q: Array, sides: Codes, places: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Exact orbits next to the averaged ones, shape (n, m, 2), and where they were found, shape (n, m)."""
        from phasemap._kernels.rows.branch_known import exact_block

        values, good = np.zeros((*sides.shape, 2)), np.zeros(sides.shape, np.bool_)
        rows = self.rows(q)
        exact_block(self.law, rows, self.levers, self.amplitudes, sides, LIMITS, places.copy(), values, good)
        return values, good


def make_model(stack: Stack, prior: Material, factor: float) -> Model:
    """The model of a stack, around a prior material known within this factor."""
    scope = stack.scopes[0]
    if scope.interaction.withdrawal != "linear":
        allowed = "'linear', for images of contacts that remember are not inverted"
        raise InputError("withdrawal", scope.interaction.withdrawal, allowed)
    row, viscous = rows_of([prior])
    if scope.interaction.law.takes_film and prior.thickness is None:
        raise InputError("thickness of the prior", None, "a number in m, of the film, where the contact is that of one")
    _, adhesion, damping = properties(row, viscous, scope)
    levers = [lever_of(one) for one in stack.scopes]
    amplitudes = [ratio * one.driven_amplitude for ratio, one in zip(stack.setpoints, stack.scopes, strict=True)]
    model = Model(
        np.array([prior.modulus, float(adhesion[0]), float(damping[0])]),
        np.zeros(3), np.full(3, np.log(factor)), REACH * float(np.log(factor)), film_of(row), prior.poisson_ratio,
        scope, scope.interaction.token(), np.array(levers), np.array(amplitudes),
    )  # fmt: skip
    if not sees_tip(model.levers):  # the amplitude of the tip then depends on the material
        return model
    rows = model.rows(np.concatenate([np.zeros((1, 3)), np.eye(3), 0.5 * model.reach * CORNERS]))
    return replace(model, tables=make_tables(model.law, rows, model.levers, model.amplitudes))


def _unfilled(n: int, m: int) -> Found:
    return Found(np.zeros((n, m, 2)), np.zeros((n, m, 2, 3)), np.zeros(n, np.bool_))


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
