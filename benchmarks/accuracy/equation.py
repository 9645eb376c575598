"""One pixel as plain numbers, and its equation of motion in units of the setpoint amplitude.

The formulas stand here a second time on purpose. What judges the solvers must not share code with them: an error in
`phasemap.experiment.interaction`, `phasemap.solvers.problem` or the kernels would otherwise be in the reference too,
and cancel. They are written from Wang (1999), Eqs. 1-4; a contract in pyproject.toml keeps this file and `reference`
apart from the rest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Case:
    """A pixel: microscope, material and setpoint.

    Examples
    --------
    >>> case = Case(40.0, 400.0, 20e-9, 10e-9, 2e9, 0.05, 0.01, 0.35, 0.7, decay_length=0.3e-9)
    >>> round(case.amplitude * 1e9, 6)
    14.0
    """

    stiffness: float  # k of the lever [N/m]
    quality_factor: float  # Q of the lever [1]
    free_amplitude: float  # amplitude of the free lever at resonance [m]
    radius: float  # R of the tip [m]
    modulus: float  # Young's modulus of the sample [Pa]
    adhesion: float  # work of adhesion w [J/m2]
    damping: float  # alpha1 [1]
    poisson_ratio: float  # of the sample [1]
    setpoint: float  # amplitude over free amplitude at the drive frequency [1]
    decay_length: float | None = None  # d0 [m]; none for no force before contact
    frequency_ratio: float = 1.0  # drive over resonance frequency [1]
    damping_exponent: float = 0.5  # n [1]
    contact: str = "dmt"  # "dmt" or "hertz"
    tip_modulus: float | None = None  # [Pa]; none is a rigid tip
    tip_poisson_ratio: float = 0.3  # [1]

    @property
    def amplitude(self) -> float:
        """Setpoint amplitude [m]."""
        base, omega = self.free_amplitude / self.quality_factor, self.frequency_ratio
        return self.setpoint * base / math.hypot(1 - omega**2, omega / self.quality_factor)

    def in_words(self) -> str:
        """All parameters on one line, so that a failure can be reproduced."""
        decay = "none" if self.decay_length is None else f"{self.decay_length!r} m"
        return (
            f"k {self.stiffness!r} N/m, Q {self.quality_factor!r}, free amplitude {self.free_amplitude!r} m, "
            f"drive {self.frequency_ratio!r}, R {self.radius!r} m, d0 {decay}, E {self.modulus!r} Pa, "
            f"w {self.adhesion!r} J/m2, alpha1 {self.damping!r}, nu {self.poisson_ratio!r}, setpoint {self.setpoint!r}"
        )


@dataclass(frozen=True)
class Equation:
    """Constants of z'' + 2 (alpha0 + alpha_s) z' + z + f(d) = u0 cos(omega tau), d = z - z0, lengths over A.

    In contact (d >= 0) f = stiff d^(3/2) - pull and alpha_s = loss d^exponent; before it f = -pull / (1 - d / decay)^2,
    or 0 if `decay` is 0 (Wang 1999, Eqs. 1-4).
    """

    omega: float
    alpha0: float
    base: float
    stiff: float
    pull: float
    decay: float
    loss: float
    exponent: float

    @classmethod
    def of(cls, case: Case) -> Equation:
        """Make lengths dimensionless by the setpoint amplitude, forces by stiffness times amplitude.

        Examples
        --------
        >>> case = Case(40.0, 400.0, 20e-9, 10e-9, 0.75e9, 0.0, 0.0, 0.0, 0.5, decay_length=0.3e-9)
        >>> equation = Equation.of(case)
        >>> equation.base, round(equation.stiff, 12), equation.decay  # K = 1 GPa; nothing pulls
        (0.005, 0.25, 0.0)
        """
        a, k, r = case.amplitude, case.stiffness, case.radius
        compliance = (1 - case.poisson_ratio**2) / case.modulus if case.modulus > 0 else math.inf
        if case.tip_modulus is not None:
            compliance += (1 - case.tip_poisson_ratio**2) / case.tip_modulus
        contact_stiffness = 4 / 3 / compliance
        f0 = 2 * math.pi * case.adhesion * r if case.contact == "dmt" else 0.0
        return cls(
            omega=case.frequency_ratio,
            alpha0=0.5 / case.quality_factor,
            base=case.free_amplitude / case.quality_factor / a,
            stiff=contact_stiffness * math.sqrt(r * a) / k,
            pull=f0 / (k * a),
            decay=case.decay_length / a if case.decay_length is not None and f0 > 0 else 0.0,
            loss=case.damping * (a / r) ** case.damping_exponent,
            exponent=case.damping_exponent,
        )
