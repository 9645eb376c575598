"""A material as the tip feels it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, cast

from phasemap._shared.errors import InputError
from phasemap._shared.fields import Number, Shown, known_as

if TYPE_CHECKING:
    from phasemap.experiment.prony import Prony

MODULUS, ADHESION, VISCOSITY = (100.0, 2e12), (0.0, 2.0), (1e-5, 1e7)  # what is found in practice [Pa, J/m2, Pa s]
THICKNESS, RELAXATION, LIQUID = (0.2e-9, 1e-4), (1e-10, 1e-2), (0.05e-9, 20e-9)  # [m, s, m]


@known_as(
    E="modulus", w="adhesion", W="adhesion", alpha="damping", eta="viscosity", nu="poisson_ratio", h="thickness",
    tau="relaxation_time",
)  # fmt: skip
@dataclass(frozen=True, repr=False)
class Material(Shown):
    """A homogeneous material.

    Numbers are in SI units, or text with a unit ("3 GPa", "50 mJ/m^2"), or quantities of pint.

    Parameters
    ----------
    modulus : float
        Young's modulus E [Pa], >= 0. Zero switches the elastic force off. Of a material that relaxes it is the
        instantaneous one, which it has when it is touched; left out beside `relaxation`, which has it.
    adhesion : float
        Work of adhesion w [J/m2] between tip and material, >= 0.
    damping : float
        Damping coefficient alpha1 [1] of Wang (1999) Eq. 4, >= 0.
    viscosity : float, optional
        Kelvin-Voigt viscosity eta [Pa s] in place of `damping`; alpha1 = eta R omega_c / (2 k).
    poisson_ratio : float
        Poisson's ratio [1], between -1 and 0.5.
    thickness : float, optional
        Of a film on a rigid base [m], > 0, for the contact "film"; None is a material without a bottom. A film
        may relax, with a Poisson's ratio that stays.
    relaxed_modulus : float, optional
        E_inf [Pa], > 0 and at most `modulus`, to which a standard linear solid relaxes: E(t) = E_inf + (E - E_inf)
        exp(-t / relaxation_time), theory, Eq. (memory-1). Given together with `relaxation_time`, or None.
    relaxation_time : float, optional
        tau [s], > 0; contacts then follow Ting and are marched in time.
    relaxation : Prony, optional
        Several relaxation times in place of one, or what `Prony` takes, as a dict.
    liquid_film : float, optional
        Thickness of the film of liquid on it [m], >= 0, for the contact "capillary"; None is that of the law.
    contact_angle : float, optional
        Of that liquid on it [degree], 0 to 180; None is that of the law.

    Raises
    ------
    InputError
        If a value is out of range, both `damping` and `viscosity` are given, or one of them to a material that relaxes.

    Examples
    --------
    >>> Material(modulus=1e9, adhesion=0.1, damping=0.01).poisson_ratio
    0.35
    """

    modulus: Number[float] = Number("Pa", None, optional=False, minimum=0, usual=MODULUS)  # a spectrum has it
    adhesion: Number[float] = Number("J/m2", 0.0, minimum=0, usual=ADHESION)
    damping: Number[float] = Number("1", 0.0, minimum=0)
    viscosity: Number[float | None] = Number("Pa s", None, minimum=0, usual=VISCOSITY)
    poisson_ratio: Number[float] = Number("1", 0.35, above=-1, maximum=0.5)
    thickness: Number[float | None] = Number("m", None, above=0, usual=THICKNESS)
    relaxed_modulus: Number[float | None] = Number("Pa", None, above=0, usual=MODULUS)
    relaxation_time: Number[float | None] = Number("s", None, above=0, usual=RELAXATION)
    liquid_film: Number[float | None] = Number("m", None, minimum=0, usual=LIQUID)
    contact_angle: Number[float | None] = Number("degree", None, minimum=0, maximum=180)
    relaxation: Prony | Mapping[str, Any] | None = None

    @classmethod
    def preset(cls, name: str, **changes: Any) -> Material:
        """A usual material.

        Parameters
        ----------
        name : str
            As ``phasemap presets`` lists them: "PS", "PMMA", "mica" and more.
        **changes : float, str or quantity
            Arguments that are to be other ones.

        Returns
        -------
        Material
            Modulus and Poisson's ratio are those of the bulk. Adhesion and viscosity are estimates, for they depend on
            the tip, the humidity and the frequency: begin with them, and fit. The adhesion is for dry air; in a liquid
            it is mostly far smaller. The loss is a `viscosity`, which is the same under every lever, as a `damping` is
            not; a `damping` among the changes takes its place.
        """
        from phasemap.experiment.presets import combined, preset_of

        return cls(**combined(preset_of("materials", name).values, changes))

    def __post_init__(self) -> None:
        if self.viscosity is not None and self.damping:
            hint = f"damping is {self.damping:g}."
            raise InputError("viscosity", self.viscosity, "either damping or viscosity, not both", hint)
        self._take_spectrum()
        check_relaxation(self.modulus, self.relaxed_modulus, self.relaxation_time, self.damping or self.viscosity)

    def _take_spectrum(self) -> None:
        """Take the modulus from the spectrum, if there is one."""
        if self.relaxation is None:
            if self.modulus is None:
                raise InputError("modulus", None, "a number of Pa, or a relaxation, which has it")
            return
        from phasemap.experiment.prony import Prony, prony_of

        if isinstance(self.relaxation, Mapping):
            object.__setattr__(self, "relaxation", prony_of(self.relaxation))
        if not isinstance(self.relaxation, Prony):
            raise InputError("relaxation", self.relaxation, "a Prony, or its arguments")
        first = self.relaxation.instantaneous
        if self.modulus is not None and not math.isclose(self.modulus, first, rel_tol=1e-9):
            raise InputError("modulus", self.modulus, f"none beside a relaxation, whose modulus is {first:g} Pa")
        object.__setattr__(self, "modulus", first)
        given = [name for name in ("damping", "viscosity", "relaxed_modulus", "relaxation_time") if getattr(self, name)]
        if given:
            raise InputError(given[0], getattr(self, given[0]), "none beside a relaxation, which is the loss")


def with_modulus(material: Material, modulus: float) -> Material:
    """A material with another modulus [Pa]; what it relaxes to, or its spectrum, is multiplied by the same factor."""
    if not relaxes(material):
        return replace(material, modulus=modulus)
    factor = modulus / material.modulus
    if material.relaxed_modulus is not None:
        return replace(material, modulus=modulus, relaxed_modulus=factor * material.relaxed_modulus)
    spectrum = cast("Prony", material.relaxation).scaled(factor)
    return replace(material, modulus=spectrum.instantaneous, relaxation=spectrum)


def relaxes(material: Material) -> bool:
    """True if a material has relaxation times, which are its loss."""
    return material.relaxation is not None or material.relaxation_time is not None


def check_relaxation(modulus: float, relaxed: float | None, time: float | None, loss: float | None) -> None:
    """Refuse numbers that make no standard linear solid."""
    if relaxed is None and time is None:
        return
    if relaxed is None:
        raise InputError("relaxed_modulus", None, "a number, given together with relaxation_time")
    if time is None:
        raise InputError("relaxation_time", None, "a number, given together with relaxed_modulus")
    if relaxed > modulus:
        raise InputError("relaxed_modulus", relaxed, f"at most modulus, {modulus:g} Pa", "That is of a sudden touch.")
    if loss:
        allowed = "None where there is damping or viscosity, for relaxation is the loss"
        raise InputError("relaxation_time", time, allowed)
