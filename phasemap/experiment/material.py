"""A material as the tip feels it."""

from __future__ import annotations

from dataclasses import dataclass

from phasemap._shared.checks import number
from phasemap._shared.errors import InputError


@dataclass(frozen=True)
class Material:
    """One homogeneous material.

    Parameters
    ----------
    modulus : float
        Young's modulus E [Pa], >= 0. Zero switches the elastic force off.
    adhesion : float
        Work of adhesion w [J/m2] between tip and material, >= 0.
    damping : float
        Damping coefficient alpha1 [1] of Wang (1999) Eq. 4, >= 0.
    viscosity : float, optional
        Kelvin-Voigt viscosity eta [Pa s] in place of `damping`; alpha1 = eta R omega_c / (2 k).
    poisson_ratio : float
        Poisson's ratio [1], between -1 and 0.5.

    Raises
    ------
    InputError
        If a value is out of range, or both `damping` and `viscosity` are given.

    Examples
    --------
    >>> Material(modulus=1e9, adhesion=0.1, damping=0.01).poisson_ratio
    0.35
    """

    modulus: float
    adhesion: float = 0.0
    damping: float = 0.0
    viscosity: float | None = None
    poisson_ratio: float = 0.35

    def __post_init__(self) -> None:
        number("modulus", self.modulus, "Pa", minimum=0)
        number("adhesion", self.adhesion, "J/m2", minimum=0)
        number("damping", self.damping, "1", minimum=0)
        number("poisson_ratio", self.poisson_ratio, "1", above=-1, maximum=0.5)
        if self.viscosity is not None:
            number("viscosity", self.viscosity, "Pa s", minimum=0)
            if self.damping:
                raise InputError(
                    "viscosity",
                    self.viscosity,
                    "either damping or viscosity, not both",
                    f"damping is {self.damping:g}.",
                )
