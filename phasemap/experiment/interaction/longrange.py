"""Forces outside contact, each with its formula, source and equation number."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from phasemap._kernels.columns import BIAS, INVERSE_REACH, LONGRANGE
from phasemap._kernels.forces import inverse_square, inverse_square_slope
from phasemap._shared.fields import Number

if TYPE_CHECKING:
    import numpy as np

    Array = np.ndarray

CLOSEST = 0.3e-9  # gap at contact [m] where there is no decay length
VACUUM_PERMITTIVITY = 8.8541878188e-12  # [F/m], CODATA 2022

# Columns of single laws.
BIASED, CURVATURE = 6, 7  # pi eps0 V^2 [N], 1/R [1/m]
KAPPA, CHARGES = 6, 7  # 1/lambda [1/m], force of the product of the charges at d = 0 [N]
HYDRATION_DECAY = 6  # 1/lambda0 [1/m]
WAVENUMBER, SOLVATION_DECAY = 6, 7  # 2 pi/sigma [1/m], 1/lambda [1/m]


class LongRange(ABC):
    """Force between tip and surface outside contact, d <= 0 (d = minus the gap).

    `force` and `slope` are scalar formulas in plain Python as those of a `ContactLaw`: they take d [m] and a row of
    parameters p, of which p[4] ... p[7] are those of `columns`. A part of the force that stays what it is at d = 0
    while the tip is in contact is said by `in_contact`, and stands at p[11].
    """

    name: ClassVar[str] = "long-range law"
    attracts: ClassVar[bool] = False
    """True if the force attracts, the more the nearer the tip. Averaging decides the branch of such forces alone."""

    @staticmethod
    @abstractmethod
    def force(d: float, p: Array) -> float:
        """Force [N], positive repulsive."""

    @staticmethod
    @abstractmethod
    def slope(d: float, p: Array) -> float:
        """dF/dd [N/m]."""

    @abstractmethod
    def columns(self, pull: Array, decay_length: float | None, radius: float) -> tuple[Array | float, ...]:
        """Whole attraction at d = 0 [N], and 1 over the length on which it changes there [1/m]; at most two more.

        `pull`: the van der Waals attraction at d = 0 [N], which falls over `decay_length` [m] if there is one.
        """

    def in_contact(self, decay_length: float | None, radius: float) -> float:
        """Attraction [N] in contact beside that of the contact law, negative repulsive."""
        return 0.0


def vanderwaals(d: float, p: Array) -> float:
    """Inverse-square attraction [N], beside another force that is p[BIAS] at d = 0."""
    s = 1.0 - d * p[INVERSE_REACH]
    return -(p[LONGRANGE] - p[BIAS]) / (s * s)


def vanderwaals_slope(d: float, p: Array) -> float:
    """Derivative of `vanderwaals` by the indentation [N/m]."""
    s = 1.0 - d * p[INVERSE_REACH]
    return -2.0 * (p[LONGRANGE] - p[BIAS]) * p[INVERSE_REACH] / (s * s * s)


def whole_attraction(pull: Array, decay_length: float | None, other: float, scale: float) -> Array:
    """Attraction at d = 0 [N] of the van der Waals force, if there is one, and another force of this scale [N].

    It is 0 where there is no force at any d only.
    """
    import numpy as np

    attraction = (pull if decay_length is not None else 0.0 * pull) + other
    return np.where(attraction == 0.0, 1e-15 * scale, attraction)


class InverseSquare(LongRange):
    """F = -f0 / (1 - d/d0)^2 (Wang 1999, Eq. 3): van der Waals attraction of a sphere and a plane.

    With f0 = H R / (6 a0^2) and a0 = d0 it is the Hamaker form with the gap measured from a0: theory, Eq. (model-12).
    """

    name: ClassVar[str] = "inverse square"
    attracts: ClassVar[bool] = True

    def columns(self, pull: Array, decay_length: float | None, radius: float) -> tuple[Array | float, ...]:
        """p[LONGRANGE] = f0 [N], p[INVERSE_REACH] = 1/d0 [1/m]."""
        return () if decay_length is None else (pull, 1 / decay_length)

    force = staticmethod(inverse_square)
    slope = staticmethod(inverse_square_slope)


class Inverse(InverseSquare):
    """F = -f0 / (1 - d/d0): the van der Waals attraction of a cone and a plane, whose gap is measured from d0.

    See theory, Eq. (model-20).
    """

    name: ClassVar[str] = "inverse"

    @staticmethod
    def force(d: float, p: Array) -> float:
        """Falls as 1/g."""
        return -p[LONGRANGE] / (1.0 - d * p[INVERSE_REACH])

    @staticmethod
    def slope(d: float, p: Array) -> float:
        """Falls as 1/g^2."""
        s = 1.0 - d * p[INVERSE_REACH]
        return -p[LONGRANGE] * p[INVERSE_REACH] / (s * s)


@dataclass(frozen=True)
class LennardJones(InverseSquare):
    """F = -(4/3) f0 (s^-2 - s^-8/4), s = 1 - d/d0: the pressure H (z0^6/z^6 - 1)/(6 pi z^3) of two planes on a sphere.

    Attard and Parker, Phys. Rev. A 46, 7959 (1992), integrated by Derjaguin: theory, Eq. (longrange-4). Contact is at
    the largest attraction, the gap z0 = d0, where the slope is 0 as that of DMT contact: with it the force and its
    slope are continuous. f0 = H R/(8 z0^2) = 2 pi w R, for w = H/(16 pi z0^2) is the work of adhesion of the planes.
    """

    name: ClassVar[str] = "lennard-jones"

    @staticmethod
    def force(d: float, p: Array) -> float:
        """With x = s^-2."""
        x = 1.0 - d * p[INVERSE_REACH]
        x = 1.0 / (x * x)
        return -p[LONGRANGE] * x * (4.0 - x * x * x) / 3.0

    @staticmethod
    def slope(d: float, p: Array) -> float:
        """0 at contact, where attraction is largest."""
        s = 1.0 / (1.0 - d * p[INVERSE_REACH])
        x = s * s
        return -8.0 / 3.0 * p[LONGRANGE] * p[INVERSE_REACH] * x * s * (1.0 - x * x * x)


@dataclass(frozen=True)
class Biased(LongRange):
    """`InverseSquare` and F = -pi eps0 V^2 R^2 / (g (g + R)), the force of a voltage between sphere and plane.

    The second is Hudlet et al. 1998, Eur. Phys. J. B 2, 5, Eq. 15 without the cone. See theory, Eq. (model-14). The gap
    g = d0 - d is cut off in contact, where the force stays what it is at d = 0.
    """

    bias: float  # V [V]
    name: ClassVar[str] = "inverse square and electrostatic"
    attracts: ClassVar[bool] = True

    def columns(self, pull: Array, decay_length: float | None, radius: float) -> tuple[Array | float, ...]:
        """p[BIASED] = pi eps0 V^2 [N], p[CURVATURE] = 1/R [1/m]."""
        at_contact = self.in_contact(decay_length, radius)
        strength = math.pi * VACUUM_PERMITTIVITY * self.bias**2
        return (
            whole_attraction(pull, decay_length, at_contact, at_contact),
            1 / (decay_length or CLOSEST),
            strength,
            1 / radius,
        )

    def in_contact(self, decay_length: float | None, radius: float) -> float:
        """Attraction of the voltage at d = 0 [N], over the gap d0."""
        x = (decay_length or CLOSEST) / radius
        return math.pi * VACUUM_PERMITTIVITY * self.bias**2 / (x * (1 + x))

    @staticmethod
    def force(d: float, p: Array) -> float:
        """van der Waals and voltage, at the same gap."""
        x = (1.0 / p[INVERSE_REACH] - d) * p[CURVATURE]
        return vanderwaals(d, p) - p[BIASED] / (x * (1.0 + x))

    @staticmethod
    def slope(d: float, p: Array) -> float:
        """Of both forces."""
        x = (1.0 / p[INVERSE_REACH] - d) * p[CURVATURE]
        y = x * (1.0 + x)
        return vanderwaals_slope(d, p) - p[BIASED] * p[CURVATURE] * (1.0 + 2.0 * x) / (y * y)


@dataclass(frozen=True)
class DLVO(LongRange):
    """F = (2 pi R lambda/(eps eps0)) [2 s_t s_s exp(d/lambda) + (s_t^2 + s_s^2) exp(2 d/lambda)], beside van der Waals.

    Butt, Biophys. J. 60, 1438 (1991): the linear Poisson-Boltzmann equation between surfaces of constant charges s_t
    and s_s, far enough for terms of exp(3 d/lambda) to be left out, in Derjaguin's approximation; theory, Eq.
    (longrange-1). In contact the force stays what it is at d = 0. The attraction is that of `decay_length` and the
    material's adhesion, across the liquid.

    Parameters
    ----------
    surface_charge_tip, surface_charge_sample : float
        s_t and s_s [C/m2], of either sign; equal signs repel.
    debye_length : float
        lambda [m], > 0: 0.304 nm over the root of the concentration in mol/l of a 1:1 salt in water at 25 degrees.
    permittivity : float
        eps [1], >= 1, relative to vacuum; 78.5 of water.
    """

    surface_charge_tip: Number[float] = Number("C/m2", -0.01, minimum=-1e3, maximum=1e3, usual=(1e-6, 1.0))
    surface_charge_sample: Number[float] = Number("C/m2", -0.01, minimum=-1e3, maximum=1e3, usual=(1e-6, 1.0))
    debye_length: Number[float] = Number("m", 1e-9, above=0, usual=(0.1e-9, 1e-6))
    permittivity: Number[float] = Number("1", 78.5, minimum=1.0, usual=(1.0, 200.0))
    name: ClassVar[str] = "dlvo"

    def _strengths(self, radius: float) -> tuple[float, float]:
        """Forces at d = 0 [N]: of the product of the charges, and of their squares."""
        unit = 2 * math.pi * radius * self.debye_length / (self.permittivity * VACUUM_PERMITTIVITY)
        tip, sample = self.surface_charge_tip, self.surface_charge_sample
        return 2 * unit * tip * sample, unit * (tip**2 + sample**2)

    def columns(self, pull: Array, decay_length: float | None, radius: float) -> tuple[Array | float, ...]:
        """p[KAPPA] = 1/lambda [1/m], p[CHARGES] = 4 pi R lambda s_t s_s/(eps eps0) [N]."""
        product, squares = self._strengths(radius)
        attraction = whole_attraction(pull, decay_length, -(product + squares), squares)
        return attraction, 1 / (decay_length or self.debye_length), 1 / self.debye_length, product

    def in_contact(self, decay_length: float | None, radius: float) -> float:
        """Minus the double layer's force at d = 0 [N]."""
        return -sum(self._strengths(radius))

    @staticmethod
    def force(d: float, p: Array) -> float:
        """van der Waals and both exponentials of the double layer."""
        screened = math.exp(d * p[KAPPA])
        return vanderwaals(d, p) + screened * (p[CHARGES] - (p[BIAS] + p[CHARGES]) * screened)

    @staticmethod
    def slope(d: float, p: Array) -> float:
        """Of the same terms."""
        screened = math.exp(d * p[KAPPA])
        double_layer = p[KAPPA] * screened * (p[CHARGES] - 2.0 * (p[BIAS] + p[CHARGES]) * screened)
        return vanderwaals_slope(d, p) + double_layer


@dataclass(frozen=True)
class Hydration(LongRange):
    """F = 2 pi R W0 exp(d/lambda0), beside the van der Waals attraction: hydration, or another exponential force.

    Israelachvili, Intermolecular and Surface Forces, 3rd ed. (2011), chapter 15: W = W0 exp(-D/lambda0) of two planes,
    with W0 3 to 30 mJ/m2 and lambda0 0.6 to 1.1 nm, in Derjaguin's approximation; theory, Eq. (longrange-2). In contact
    the force stays what it is at d = 0.

    Parameters
    ----------
    strength : float
        W0 [J/m2], negative where the force attracts (hydrophobic surfaces).
    decay : float
        lambda0 [m], > 0.
    """

    strength: Number[float] = Number("J/m2", 10e-3, minimum=-1e3, maximum=1e3, usual=(1e-6, 1.0))
    decay: Number[float] = Number("m", 1e-9, above=0, usual=(0.05e-9, 100e-9))
    name: ClassVar[str] = "hydration"

    def columns(self, pull: Array, decay_length: float | None, radius: float) -> tuple[Array | float, ...]:
        """p[HYDRATION_DECAY] = 1/lambda0 [1/m]."""
        other = self.in_contact(decay_length, radius)
        return whole_attraction(pull, decay_length, other, abs(other)), 1 / (decay_length or self.decay), 1 / self.decay

    def in_contact(self, decay_length: float | None, radius: float) -> float:
        """Minus the exponential force at d = 0 [N]."""
        return -2 * math.pi * radius * self.strength

    @staticmethod
    def force(d: float, p: Array) -> float:
        """van der Waals and one exponential."""
        return vanderwaals(d, p) - p[BIAS] * math.exp(d * p[HYDRATION_DECAY])

    @staticmethod
    def slope(d: float, p: Array) -> float:
        """Of the same terms."""
        return vanderwaals_slope(d, p) - p[BIAS] * p[HYDRATION_DECAY] * math.exp(d * p[HYDRATION_DECAY])


@dataclass(frozen=True)
class Solvation(LongRange):
    """F = -2 pi R (w + W) cos(2 pi d/sigma) exp(d/lambda), w the material's adhesion.

    Israelachvili, Intermolecular and Surface Forces, 3rd ed. (2011), chapter 15: between layers of molecules the
    pressure oscillates with the gap, at a period of about their size, and falls exponentially. By Derjaguin: theory,
    Eq. (longrange-3). All adhesion is of this kind: there is no other attraction, and no decay length. In contact the
    force stays what it is at d = 0.

    Parameters
    ----------
    strength : float
        W [J/m2], beside the adhesion of the materials; negative where it repels at contact.
    period : float
        sigma [m], > 0.
    decay : float
        lambda [m], > 0.
    """

    strength: Number[float] = Number("J/m2", 0.0, minimum=-1e3, maximum=1e3, usual=(1e-6, 1.0))
    period: Number[float] = Number("m", 0.3e-9, above=0, usual=(0.1e-9, 10e-9))
    decay: Number[float] = Number("m", 0.3e-9, above=0, usual=(0.05e-9, 100e-9))
    name: ClassVar[str] = "solvation"

    def columns(self, pull: Array, decay_length: float | None, radius: float) -> tuple[Array | float, ...]:
        """p[WAVENUMBER] = 2 pi/sigma [1/m], p[SOLVATION_DECAY] = 1/lambda [1/m]."""
        other, wavenumber = self.in_contact(decay_length, radius), 2 * math.pi / self.period
        return pull + other, max(wavenumber, 1 / self.decay), wavenumber, 1 / self.decay

    def in_contact(self, decay_length: float | None, radius: float) -> float:
        """Attraction of W at d = 0 [N]; that of the material's adhesion is added."""
        return 2 * math.pi * radius * self.strength

    @staticmethod
    def force(d: float, p: Array) -> float:
        """A damped cosine of the gap, and nothing else."""
        return -p[LONGRANGE] * math.cos(d * p[WAVENUMBER]) * math.exp(d * p[SOLVATION_DECAY])

    @staticmethod
    def slope(d: float, p: Array) -> float:
        """Of cosine and exponential."""
        x = d * p[WAVENUMBER]
        turn = p[SOLVATION_DECAY] * math.cos(x) - p[WAVENUMBER] * math.sin(x)
        return -p[LONGRANGE] * turn * math.exp(d * p[SOLVATION_DECAY])


FORCES: dict[str, type[Any]] = {law.name: law for law in (DLVO, Hydration, Solvation, LennardJones)}
"""Laws that may stand in place of the van der Waals force."""
