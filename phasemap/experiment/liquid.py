"""A rectangular lever in a fluid: Sader's hydrodynamic function, J. Appl. Phys. 84, 64 (1998)."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from typing import NamedTuple

from phasemap._shared.errors import InputError
from phasemap.experiment.eigenmode import BETAS

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
    """What surrounds a lever."""

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
    fluid as wide as the lever.

    `reynolds`: density times angular frequency times square of the width, over four times the viscosity [1].
    """
    from scipy.special import kve

    if not SLOWEST <= reynolds <= FASTEST:
        raise InputError("Reynolds number of the lever", float(f"{reynolds:.3g}"), f"{SLOWEST:g} to {FASTEST:g}")
    root = cmath.sqrt(1j * reynolds)
    cylinder = 1 + 4j * complex(kve(1, -1j * root)) / (root * complex(kve(0, -1j * root)))
    decades = math.log10(reynolds)
    return complex(_rational(REAL, decades), _rational(IMAGINARY, decades)) * cylinder


def _rational(coefficients: tuple[tuple[float, ...], tuple[float, ...]], x: float) -> float:
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
        found = []
        for beta in BETAS[:count]:
            spring = 4 * self.stiffness * (beta / BETAS[0]) ** 4 / self.length
            omega, before = math.sqrt(spring / self.mass), math.inf
            for _ in range(ITERATIONS):
                if abs(omega - before) <= PRECISION * omega:
                    break
                before, added = omega, _added_mass(self.width, omega, fluid)
                omega = math.sqrt(spring / (self.mass + added.real))
            moving = self.mass + added.real
            found.append(ModeInFluid(omega, moving / added.imag, self.mass / moving))
        return found


def _added_mass(width: float, omega: float, fluid: Fluid) -> complex:
    """Mass of fluid per length that moves with a beam [kg/m]; its imaginary part is the drag."""
    disc = fluid.density * width * width
    return math.pi / 4 * disc * hydrodynamic_function(disc * omega / (4 * fluid.viscosity))
