"""The lever: given as numbers, as a preset or by its dimensions, in air or in a liquid."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from phasemap._shared.checks import number, whole
from phasemap._shared.errors import InputError
from phasemap._shared.fields import Number, Shown, known_as
from phasemap._shared.quantities import Scalar
from phasemap.experiment.beam import (
    AIR,
    BETAS,
    MOST_MODES,
    OF_FIRST,
    Beam,
    Eigenmode,
    Fluid,
    Modes,
    all_modes,
    check_modes,
    participations,
)

FREQUENCY, LENGTH = (1e3, 1e7), (1e-6, 2e-3)  # what is found in practice [Hz, m]


@known_as(k="stiffness", f="resonance_frequency", f0="resonance_frequency", Q="quality_factor", B="participation")
@dataclass(frozen=True, repr=False)
class Cantilever(Shown):
    """The lever: its first eigenmode as a damped spring, and higher ones if any.

    Parameters
    ----------
    stiffness : float
        Spring constant k [N/m], > 0.
    resonance_frequency : float
        Free resonance frequency f_c = omega_c / (2 pi) [Hz], > 0.
    quality_factor : float
        Q = 1 / (2 alpha0) [1], > 0.5 (the lever must oscillate).
    participation : float
        How strongly motion of the base drives the first mode [1], > 0: 1.566 for a uniform beam, 1 for a point mass on
        a spring. It matters with base excitation only.
    modes : tuple of Eigenmode, or int
        The modes above the first, by rising frequency; or the number of all modes, 1 to 4, of a uniform beam in a gas:
        frequencies as in vacuum, and quality factors in proportion to the root of the frequency, which is the limit of
        Sader's hydrodynamic function (J. Appl. Phys. 84, 64 (1998)) for boundary layers thinner than the lever is wide.
    length : float, optional
        Of a rectangular lever [m], > 0; `in_liquid` needs it, and nothing else does.
    width : float, optional
        Likewise.

    Examples
    --------
    >>> Cantilever(stiffness=40.0, resonance_frequency=148.5e3, quality_factor=833.0).damping_ratio
    0.0006002400960384153
    >>> [round(mode.quality_factor) for mode in Cantilever("2 N/m", "70 kHz", 150, modes=3).eigenmodes]
    [150, 376, 628]
    """

    stiffness: Number[float] = Number("N/m", above=0, usual=(1e-3, 1e3))
    resonance_frequency: Number[float] = Number("Hz", above=0, usual=FREQUENCY)
    quality_factor: Number[float] = Number("1", above=0.5, usual=(0.5, 1e6))
    participation: Number[float] = Number("1", OF_FIRST, above=0, usual=(0.1, 10))
    modes: Modes = ()
    length: Number[float | None] = Number("m", None, said="cantilever length", above=0, usual=LENGTH)
    width: Number[float | None] = Number("m", None, said="cantilever width", above=0, usual=LENGTH)

    def __post_init__(self) -> None:
        object.__setattr__(self, "modes", check_modes(self.modes))

    @classmethod
    def preset(cls, name: str, **changes: Any) -> Cantilever:
        """A commercial lever, with the nominal values of its kind.

        Parameters
        ----------
        name : str
            As ``phasemap presets`` lists them: "PPP-NCHR", "Multi75Al-G" and more.
        **changes : float, str or quantity
            Arguments that are to be other ones, such as what was measured of the lever at hand.

        Returns
        -------
        Cantilever
            The quality factor is an estimate for air; levers of one kind differ in stiffness by a factor of two. The
            numbers were not verified against the makers' data sheets.
        """
        from phasemap.experiment.presets import combined, preset_of

        return cls(**combined(preset_of("levers", name).values, changes))

    @classmethod
    def rectangular(
        cls, length: Scalar, width: Scalar, thickness: Scalar, modulus: Scalar, density: Scalar, *, modes: int = 1
    ) -> Cantilever:
        """A uniform rectangular lever in air, from its dimensions and what it is made of.

        Parameters
        ----------
        length, width, thickness : float, str or quantity
            [m], 1 nm to 1 m.
        modulus : float, str or quantity
            Young's modulus of its material [Pa], >= 1: 169 GPa of silicon along <110>, 250 GPa of silicon nitride.
        density : float, str or quantity
            Of its material [kg/m3], >= 0.001: 2330 of silicon, 3100 of silicon nitride.
        modes : int
            How many modes it has in all, 1 to 4.

        Returns
        -------
        Cantilever
            With no losses but those in air: quality factors are upper bounds, and close ones where they are below 300.

        Examples
        --------
        >>> lever = Cantilever.rectangular("225 um", "28 um", "3 um", "169 GPa", "2330 kg/m^3")
        >>> [f"{x:.3g}" for x in (lever.stiffness, lever.resonance_frequency, lever.quality_factor)]
        ['2.89', '8.12e+04', '216']
        """
        lengths = {"length": length, "width": width, "thickness": thickness}
        size = {name: number(name, value, "m", minimum=1e-9, maximum=1) for name, value in lengths.items()}
        young = number("modulus", modulus, "Pa", minimum=1, maximum=1e15)
        heavy = number("density", density, "kg/m3", minimum=1e-3, maximum=1e6)
        static = young * size["width"] * size["thickness"] ** 3 / (4 * size["length"] ** 3)
        mass = heavy * size["width"] * size["thickness"]
        beam = Beam(size["length"], size["width"], mass, static * BETAS[0] ** 4 / 12)
        return replace(_in_fluid(beam, AIR, modes), length=size["length"], width=size["width"])

    def in_liquid(
        self, density: Scalar = 998.0, viscosity: Scalar = 1.0e-3, *, modes: int = 2, liquid_pulls: bool = True
    ) -> Cantilever:
        """The lever in a liquid, by Sader's hydrodynamic function (J. Appl. Phys. 84, 64 (1998)).

        Parameters
        ----------
        density : float, str or quantity
            Of the liquid [kg/m3], > 0; that of water at 20 degrees C by default.
        viscosity : float, str or quantity
            Of the liquid [Pa s], > 0.
        modes : int
            How many modes it has in all, 1 to 4; two at least are needed for the contrast between soft and hard.
        liquid_pulls : bool
            Whether a base that moves drags the lever through a liquid at rest, which so pulls on the lever by its mass.
            If not, the liquid goes with the base, and the participations are smaller by the lever's share of the mass
            that moves with it: the base has to move further for the same amplitude.

        Returns
        -------
        Cantilever
            Its resonance frequency, its quality factor and its higher modes are those in the liquid. This one has to be
            the lever in air, and to have `length` and `width`.

        Notes
        -----
        The lever is taken to be uniform and much longer than wide: the second mode of one only four times as long as
        wide moves less liquid (Van Eysden and Sader, J. Appl. Phys. 101, 044908 (2007)). The mass of the tip and the
        drag of a surface close below are not counted. A thermal tune in the liquid is better where there is one.

        Examples
        --------
        >>> lever = Cantilever.rectangular("120 um", "30 um", "0.5 um", "250 GPa", "3100 kg/m^3").in_liquid()
        >>> round(lever.resonance_frequency), round(lever.quality_factor, 2)
        (9454, 2.24)
        >>> second = lever.eigenmodes[1]
        >>> round(second.frequency_ratio, 2), round(second.quality_factor, 2)
        (7.25, 4.64)
        """
        for name, size in (("length", self.length), ("width", self.width)):
            if size is None:
                raise InputError(f"{name} of the lever", None, "a length in m", f"Cantilever(..., {name}=...) has it.")
        assert self.length is not None and self.width is not None
        if not isinstance(liquid_pulls, bool):
            raise InputError("liquid_pulls", liquid_pulls, "True or False")
        fluid = Fluid(number("density", density, "kg/m3", above=0), number("viscosity", viscosity, "Pa s", above=0))
        omega = 2 * math.pi * self.resonance_frequency
        beam = Beam.from_resonance(self.length, self.width, self.stiffness, omega)
        return _in_fluid(beam, fluid, modes, liquid_pulls)

    @property
    def damping_ratio(self) -> float:
        """alpha0 = 1 / (2 Q), the lever's own damping [1]."""
        return 0.5 / self.quality_factor

    @property
    def eigenmodes(self) -> tuple[Eigenmode, ...]:
        """Every mode from the first on, with the numbers that a higher one leaves to the uniform beam."""
        return all_modes(self.quality_factor, self.participation, self.modes)


def _in_fluid(beam: Beam, fluid: Fluid, count: int, fluid_pulls: bool = True) -> Cantilever:
    """A beam as a lever with so many modes."""
    modes = beam.modes(whole("modes", count, 1, MOST_MODES), fluid)
    omega, quality, share = modes[0]
    higher = [
        Eigenmode(one.omega / omega, one.quality_factor, participation=None if fluid_pulls else b * one.own_mass)
        for one, b in zip(modes[1:], participations(count)[1:], strict=True)
    ]
    return Cantilever(
        beam.stiffness, omega / (2 * math.pi), quality, OF_FIRST * (1.0 if fluid_pulls else share), tuple(higher)
    )
