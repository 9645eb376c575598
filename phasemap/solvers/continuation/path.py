"""The parameter that a sweep moves, and how the law's parameters and the lever depend on it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from phasemap._shared.errors import InputError
from phasemap._shared.fields import number_of
from phasemap._shared.notices import unquestioned
from phasemap._shared.units import UDUNITS
from phasemap.experiment.material import Material, relaxes, with_modulus
from phasemap.experiment.material_rows import MORE_NUMBERS
from phasemap.experiment.microscope import PARTS as CLASSES
from phasemap.experiment.microscope import Microscope
from phasemap.solvers.problem import Work, work_of_material

if TYPE_CHECKING:
    from phasemap._kernels.orbits.collocation.path import Path

MATERIAL = ("modulus", "adhesion", "damping", "viscosity", "poisson_ratio", *MORE_NUMBERS)
PARTS = {
    "stiffness": "cantilever", "quality_factor": "cantilever", "radius": "tip", "free_amplitude": "drive",
    "frequency": "drive", "decay_length": "interaction", "bias": "interaction",
}  # fmt: skip
NUMBERS = {name: number_of(Material, name) for name in MATERIAL} | {
    name: number_of(CLASSES[part], name) for name, part in PARTS.items()
}
UNITS = {name: UDUNITS.get(number.unit, number.unit) for name, number in NUMBERS.items()}
ORDERS = (5, 9, 17, 33, 65)  # of the series tried, one after the other: a drive's frequency enters linearly
PRECISION = 3e-13  # of the last coefficients, over the largest value
MOST_SAMPLES = 65536  # of a time trace
WIDE = 8.0  # a sweep over a larger ratio is followed on a logarithmic scale
NEGLIGIBLE = 1e-17  # of the largest value: coefficients below are left out
SMALL_CHANGE = 0.05  # of m in [-1, 1]: the natural length of a sweep
SMALL_DETUNING = 0.3  # the same of the drive's frequency, in half linewidths f0/(2Q)


@dataclass(frozen=True)
class Question:
    """A material under a microscope, of which a sweep changes one parameter."""

    material: Material
    scope: Microscope

    def with_parameter(self, name: str, value: float) -> Question:
        """The material and microscope with one parameter changed."""
        if name == "modulus":
            with unquestioned():
                return Question(with_modulus(self.material, value), self.scope)
        if name in MATERIAL:
            other = {"damping": "viscosity", "viscosity": "damping"}.get(name)
            changes: dict[str, Any] = {name: value}
            if other is not None:
                changes[other] = 0.0 if other == "damping" else None
            with unquestioned():
                return Question(replace(self.material, **changes), self.scope)
        if name not in PARTS:
            raise InputError("parameter", name, "one of " + ", ".join((*MATERIAL, *PARTS)))
        part = PARTS[name]
        with unquestioned():
            changed = replace(getattr(self.scope, part), **{name: value})
        return Question(self.material, replace(self.scope, **{part: changed}))

    def work(self, amplitude: float = 1e-9, *, marched: bool = False) -> Work:
        """Work of one row of parameters; `marched` as for `phasemap.solvers.problem.work_of`."""
        return work_of_material(self.material, self.scope, amplitude, marched=marched)

    @property
    def only_in_time(self) -> bool:
        """True if only the march in time knows the contacts of this material: they remember or are wet."""
        viscous = bool(self.material.viscosity or self.material.damping)
        interaction = self.scope.interaction
        ting = interaction.withdrawal == "ting" and viscous
        return relaxes(self.material) or ting or interaction.law.in_time


def path_of(question: Question) -> Path:
    """The path of a sweep in tip offset or setpoint: nothing else moves."""
    from phasemap._kernels.orbits.collocation.path import fixed_path

    return fixed_path(question.work().oscillator(0))


@dataclass(frozen=True)
class Spacing:
    """Dependence of a parameter on m in [-1, 1]: linear or logarithmic."""

    low: float
    high: float
    logarithmic: bool

    @classmethod
    def over(cls, values: np.ndarray) -> Spacing:
        """The scale for a sweep over these values."""
        low, high = float(values.min()), float(values.max())
        return cls(low, high, low > 0 and high > WIDE * low)

    def value(self, m: np.ndarray | float) -> np.ndarray:
        """The parameter at m."""
        share = (np.asarray(m) + 1) / 2
        if self.logarithmic:
            return np.asarray(self.low * (self.high / self.low) ** share)
        return np.asarray(self.low + (self.high - self.low) * share)

    def m(self, value: np.ndarray | float) -> np.ndarray:
        """m at a value of the parameter."""
        if self.logarithmic:
            return np.asarray(2 * np.log(np.asarray(value) / self.low) / np.log(self.high / self.low) - 1)
        return np.asarray(2 * (np.asarray(value) - self.low) / (self.high - self.low) - 1)


def path_over(
    question: Question, name: str, scale: Spacing, held: Callable[[Microscope], float], of_amplitude: bool
) -> Path:
    """The path of a sweep in a parameter, with z0 or A held.

    `held`: tip offset or amplitude [m] that is held under a microscope.
    """
    from phasemap._kernels.orbits.collocation.path import HELD_AMPLITUDE, HELD_OFFSET, swept_path

    work = question.with_parameter(name, float(scale.value(0.0))).work()
    table = np.zeros((0, 0))
    for order in ORDERS:
        nodes = np.cos(np.pi * (np.arange(order) + 0.5) / order)
        columns = np.stack([_column(question.with_parameter(name, float(scale.value(m))), held) for m in nodes], axis=1)
        if not np.isfinite(columns).all():
            raise InputError(name, (scale.low, scale.high), "values at which the law has finite parameters")
        table = np.polynomial.chebyshev.chebfit(nodes, columns.T, order - 1).T
        constant = np.ptp(columns, axis=1) == 0
        table[constant, 0], table[constant, 1:] = columns[constant, 0], 0
        size = np.abs(columns).max(axis=1)
        if (np.abs(table[:, -2:]).max(axis=1) <= PRECISION * size).all():
            break
    else:
        raise InputError(name, (scale.low, scale.high), "a narrower range: split the sweep in two")
    kept = np.abs(table) > NEGLIGIBLE * size[:, None]
    last = int(np.flatnonzero(kept.any(axis=0)).max()) + 1
    lever, width = question.scope.cantilever, SMALL_CHANGE
    if name == "frequency":  # which m moves by half the range
        width = 2 * SMALL_DETUNING * lever.damping_ratio / (scale.high - scale.low) * lever.resonance_frequency
    kind = HELD_AMPLITUDE if of_amplitude else HELD_OFFSET
    series = np.ascontiguousarray(table[:, : max(last, 2)])
    return swept_path(work.law, series, kind, min(width, SMALL_CHANGE))


def _column(question: Question, held: Callable[[Microscope], float]) -> np.ndarray:
    """Column of a sweep's table: parameters of the law, the lever, and the value held."""
    work = question.work()
    return np.concatenate([work.rows[0], work.lever, [held(question.scope)]])
