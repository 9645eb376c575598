"""Eigenmodes of a lever: those of a uniform beam, those that are given, in vacuum, air or a liquid."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from itertools import pairwise
from typing import NamedTuple, TypeAlias

from phasemap._shared.checks import whole
from phasemap._shared.errors import InputError
from phasemap._shared.fields import Number, Shown, known_as
from phasemap._shared.notices import unquestioned

BETAS = (1.875104068711961, 4.694091132974175, 7.854757438237613, 10.995540734875467)
"""Wave number times length of a clamped beam's modes, the solutions of cos(beta) cosh(beta) = -1."""
MOST_MODES = len(BETAS)
OF_FIRST = 1.565984  # participation of a uniform beam's first mode


@known_as(f="frequency_ratio", Q="quality_factor", k="stiffness_ratio", B="participation")
@dataclass(frozen=True, repr=False)
class Eigenmode(Shown):
    """A higher eigenmode of the lever; numbers left None are those of a uniform beam's mode in the same place.

    Parameters
    ----------
    frequency_ratio : float
        Its resonance frequency over that of the first mode [1], > 1: 6.27 for the second mode of a uniform beam in
        air, 7 to 9 in a liquid.
    quality_factor : float
        Its quality factor [1], > 0.5.
    stiffness_ratio : float, optional
        Its stiffness at the tip over that of the first mode [1], > 0. A liquid does not change it.
    participation : float, optional
        How strongly motion of the base drives it [1]: integral of its shape over that of the shape squared, where the
        shape is 1 at the tip.
    slope_ratio : float, optional
        Its slope at the tip over that of the first mode, for the same deflection [1].

    Examples
    --------
    >>> import phasemap as pm
    >>> lever = pm.Cantilever(0.1, 20e3, 2.5, modes=(pm.Eigenmode(frequency_ratio=7.5, quality_factor=6.0),))
    >>> round(lever.eigenmodes[1].stiffness_ratio, 4), round(lever.eigenmodes[1].participation, 6)
    (39.2739, -0.867872)
    """

    frequency_ratio: Number[float] = Number("1", minimum=1, usual=(2, 100))
    quality_factor: Number[float] = Number("1", above=0.5, usual=(0.5, 1e6))
    stiffness_ratio: Number[float | None] = Number("1", None, above=0, usual=(0.1, 1e5))
    participation: Number[float | None] = Number("1", None, usual=(1e-3, 100))
    slope_ratio: Number[float | None] = Number("1", None, usual=(1e-2, 100))


Modes: TypeAlias = "tuple[Eigenmode, ...] | int"


def check_modes(modes: object) -> Modes:
    """Return the higher modes, or how many there are in all, if a lever can have them."""
    allowed = f"at most {MOST_MODES - 1} Eigenmodes above the first, or the number of all modes, 1 to {MOST_MODES}"
    if not isinstance(modes, (tuple, list)):
        try:
            count = whole("modes", modes, 1, MOST_MODES)
        except InputError:
            raise InputError("modes", modes, allowed) from None
        return count if count > 1 else ()
    if len(modes) >= MOST_MODES or not all(isinstance(mode, Eigenmode) for mode in modes):
        raise InputError("modes", modes, allowed)
    ratios = [1.0, *(mode.frequency_ratio for mode in modes)]
    if any(one >= other for one, other in pairwise(ratios)):
        raise InputError("frequency ratios of the modes", ratios[1:], "numbers above 1, each above the one before")
    return tuple(modes)


@lru_cache(maxsize=256)  # a fit or a map asks thousands of times for those of one lever
@unquestioned()
def all_modes(quality_factor: float, participation: float, modes: Modes) -> tuple[Eigenmode, ...]:
    """The first mode and the higher ones, with no number left open; `modes` as `check_modes` returns them.

    A number makes those of a uniform beam in a gas, whose quality factors grow as the root of the frequency.
    """
    if isinstance(modes, int):
        ratios = [(beta / BETAS[0]) ** 2 for beta in BETAS[1:modes]]
        modes = tuple(Eigenmode(ratio, quality_factor * math.sqrt(ratio)) for ratio in ratios)
    every = [Eigenmode(1.0, quality_factor, 1.0, participation, 1.0)]
    for beta, mode in zip(BETAS[1:], modes, strict=False):
        uniform = _of_uniform_beam(beta)
        every.append(replace(mode, **{name: value for name, value in uniform.items() if getattr(mode, name) is None}))
    return tuple(every)


@cache
def _of_uniform_beam(beta: float) -> dict[str, float]:
    """Stiffness, participation and slope of a uniform beam's mode, the first and the last over those of mode 1."""
    slope_of_first = _slope_and_participation(BETAS[0])[0]
    slope, participation = _slope_and_participation(beta)
    return {
        "stiffness_ratio": (beta / BETAS[0]) ** 4,
        "participation": participation,
        "slope_ratio": slope / slope_of_first,
    }


def participations(count: int) -> list[float]:
    """Participations of the first modes of a uniform beam."""
    return [_slope_and_participation(beta)[1] for beta in BETAS[:count]]


def _slope_and_participation(beta: float) -> tuple[float, float]:
    """Slope at the tip, over deflection there and length, and participation of a clamped beam's mode."""
    cosh, sinh, cos, sin = math.cosh(beta), math.sinh(beta), math.cos(beta), math.sin(beta)
    ratio = (sinh - sin) / (cosh + cos)
    tip = cosh - cos - ratio * (sinh - sin)  # the mean square of this shape is 1, and its mean 2 ratio / beta
    return beta * (sinh + sin - ratio * (cosh - cos)) / tip, 2 * ratio * tip / beta


def free_motion(modes: Sequence[Eigenmode], omega: float, drive: float, excitation: str) -> list[complex]:
    """Complex amplitude of each mode of the free lever, relative to its base, where the drive is i `drive` [m].

    `omega`: drive frequency over resonance frequency of the first mode [1].
    `drive`: amplitude of the base, or that of the force on the tip over the first mode's stiffness [m].
    """
    amplitudes = []
    for mode in modes:
        square, loss = mode.frequency_ratio**2, omega * mode.frequency_ratio / mode.quality_factor
        assert mode.participation is not None
        assert mode.stiffness_ratio is not None
        pull = mode.participation * (omega**2 - 1j * loss) if excitation == "base" else square / mode.stiffness_ratio
        amplitudes.append(1j * drive * pull / (square - omega**2 + 1j * loss))
    return amplitudes


SLOWEST, FASTEST = 1e-6, 1e6  # Reynolds numbers; above 1e4, where Sader does not state an accuracy, Gamma tends to 1
ITERATIONS = 200  # of a frequency; each at least halves its error
PRECISION = 1e-14  # of a frequency

REAL = (
    (0.91324, -0.48274, 0.46842, -0.12886, 0.044055, -0.0035117, 0.00069085),
    (1.0, -0.56964, 0.48690, -0.13444, 0.045155, -0.0035862, 0.00069085),
)
IMAGINARY = (
    (-0.024134, -0.029256, 0.016294, -0.00010961, 0.000064577, -0.000044510),
    (1.0, -0.59702, 0.55182, -0.18357, 0.079156, -0.014369, 0.0028361),
)
"""Correction of the cylinder for a rectangle, numerator and denominator, by powers of log10 Re (Sader, Eq. 21)."""


class Fluid(NamedTuple):
    """Fluid around a lever."""

    density: float  # [kg/m3]
    viscosity: float  # [Pa s]


class ModeInFluid(NamedTuple):
    """A mode of a beam in a fluid."""

    omega: float  # angular resonance frequency without damping [1/s]
    quality_factor: float
    own_mass: float  # that of the beam over all that moves with it [1]


AIR = Fluid(1.2, 1.8e-5)  # at 20 degrees C


def hydrodynamic_function(reynolds: float) -> complex:
    """Gamma of a thin rectangle that moves normal to its plane, to 0.1 %.

    The real part is the mass of fluid that moves along, the imaginary part the drag, over the mass of a cylinder of
    fluid as wide as the lever. `reynolds`: density times angular frequency times square of the width, over four times
    the viscosity [1].
    """
    from scipy.special import kve

    if not SLOWEST <= reynolds <= FASTEST:
        raise InputError("Reynolds number of the lever", float(f"{reynolds:.3g}"), f"{SLOWEST:g} to {FASTEST:g}")
    root = cmath.sqrt(1j * reynolds)
    cylinder = 1 + 4j * complex(kve(1, -1j * root)) / (root * complex(kve(0, -1j * root)))
    decades = math.log10(reynolds)
    return complex(_rational(REAL, decades), _rational(IMAGINARY, decades)) * cylinder


def _rational(coefficients: tuple[tuple[float, ...], tuple[float, ...]], x: float) -> float:
    """Quotient of two polynomials at x, with coefficients in rising order."""
    upper, lower = (sum(one * x**i for i, one in enumerate(part)) for part in coefficients)
    return upper / lower


@dataclass(frozen=True)
class Beam:
    """A uniform beam of rectangular cross section, much longer than wide and much wider than thick."""

    length: float  # [m]
    width: float  # [m]
    mass: float  # its own, per length [kg/m]
    stiffness: float  # of its first mode at the tip [N/m]

    @classmethod
    def from_resonance(cls, length: float, width: float, stiffness: float, omega: float) -> Beam:
        """The beam with an angular resonance frequency in air, where a mode moves a quarter of the beam's mass."""
        moving = 4 * stiffness / length / omega / omega
        mass = moving - _added_mass(width, omega, AIR).real
        if not 0 < mass < math.inf:
            hint = "Stiffness, resonance frequency and length do not belong to one lever of this width."
            raise InputError("mass per length of the lever", mass, "a number above 0 kg/m", hint)
        return cls(length, width, mass, stiffness)

    def modes(self, count: int, fluid: Fluid) -> list[ModeInFluid]:
        """The first modes in a fluid."""
        modes = []
        for beta in BETAS[:count]:
            spring = 4 * self.stiffness * (beta / BETAS[0]) ** 4 / self.length
            omega, before = math.sqrt(spring / self.mass), math.inf
            for _ in range(ITERATIONS):
                if abs(omega - before) <= PRECISION * omega:
                    break
                before, added = omega, _added_mass(self.width, omega, fluid)
                omega = math.sqrt(spring / (self.mass + added.real))
            moving = self.mass + added.real
            modes.append(ModeInFluid(omega, moving / added.imag, self.mass / moving))
        return modes


def _added_mass(width: float, omega: float, fluid: Fluid) -> complex:
    """Mass of fluid per length that moves with a beam [kg/m]; its imaginary part is the drag."""
    disc = fluid.density * width * width
    return math.pi / 4 * disc * hydrodynamic_function(disc * omega / (4 * fluid.viscosity))
