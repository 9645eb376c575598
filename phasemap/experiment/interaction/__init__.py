"""Forces between tip and surface: one law per class, each with its formula, paper and equation number.

`Interaction` names the laws; `Interaction.columns` turns material maps into the parameter rows that the kernels read
and `Interaction.token` into the compiled formulas. Everything here is SI.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.forces import hertzian
from phasemap._shared.arrays import Array
from phasemap._shared.checks import check_choice
from phasemap._shared.errors import InputError, Word
from phasemap._shared.fields import Number, Shown, known_as
from phasemap.experiment.interaction.base import ContactLaw, is_own
from phasemap.experiment.interaction.capillary import Capillary
from phasemap.experiment.interaction.contact import DMT, JKR, LAWS, Cone, FlatPunch, Hertz, LossyDMT, Neck
from phasemap.experiment.interaction.film import Film
from phasemap.experiment.interaction.longrange import (
    DLVO,
    FORCES,
    Biased,
    Hydration,
    InverseSquare,
    LennardJones,
    LongRange,
    Solvation,
)
from phasemap.experiment.interaction.maugis import MaugisDugdale
from phasemap.experiment.interaction.table import Table

if TYPE_CHECKING:
    from phasemap._kernels.law import Law

__all__ = [
    "DLVO", "DMT", "JKR", "Capillary", "Cone", "ContactLaw", "Film", "FlatPunch", "Hertz", "Hydration",
    "Interaction", "LennardJones", "LossyDMT", "MaugisDugdale", "Neck", "Solvation",
    "Table",
]  # fmt: skip

WITH_PARAMETERS: dict[str, type[ContactLaw]] = {
    law.name: law for law in (Capillary, Cone, Film, FlatPunch, Table, LossyDMT, MaugisDugdale, Neck)
}
"""Contact laws that have parameters, by name; those without are `contact.LAWS`."""
WITHDRAWALS = ("linear", "ting")
VAN_DER_WAALS = "van der waals"
TRIED = (0.0, 1e-12, 1e-10, 1e-9, 1e-8)  # depths [m] at which the formula of a user's law is tried before work starts


@known_as(d0="decay_length", n="damping_exponent", V="bias", law="contact")
@dataclass(frozen=True, repr=False)
class Interaction(Shown):
    """Laws of the forces between tip and surface.

    Parameters
    ----------
    contact : str or ContactLaw
        "hertz" (no adhesion), "dmt", "jkr", "maugis" (Maugis-Dugdale, its range the decay length), "punch" (flat),
        "cone", "film" (on a rigid base, which it sticks to), "slipping film" or "capillary" (under films of liquid), in
        capitals or not; or a law object: `FlatPunch`, `Cone`, `MaugisDugdale`, `Neck` and `Capillary` take parameters,
        and a law of your own is a class derived from `ContactLaw`.
    decay_length : float, optional
        d0 [m], > 0, of the inverse-square attraction outside contact, Wang (1999) Eq. 3; None (in a scene "none") for
        no such force.
    damping_exponent : float
        n [1], >= 0, in alpha_s = alpha1 (d/R)**n, Wang (1999) Eq. 4.
    bias : float
        Voltage V [V] between tip and surface, for F = -pi eps0 V^2 R^2 / (g (g + R)) with the gap g = d0 - d (or 0.3 nm
        - d without a decay length), constant in contact.
    withdrawal : {"linear", "ting"}
        How a contact with damping or viscosity lets go. "linear": the damper pulls the surface up behind the tip, as
        in Wang (1999). "ting": it only pushes (Ting 1966), contact ends where its force falls to 0, and the surface
        comes back by itself: theory, Eq. (memory-7). For "hertz", "dmt" and "capillary", marched in time.
    longrange : str or LongRange
        Force outside contact: "van der waals", by `decay_length` alone; or in a liquid "dlvo", "hydration" or
        "solvation", beside it; or "lennard-jones", whose gap at contact is the decay length. An object, `DLVO`,
        `Hydration` or `Solvation`, has other parameters than the usual ones.

    Examples
    --------
    >>> Interaction(contact="hertz", decay_length=None).law.name
    'hertz'
    >>> Interaction("maugis", decay_length=0.4e-9).law
    MaugisDugdale(range=4e-10)
    """

    contact: str | ContactLaw = "dmt"
    decay_length: Number[float | None] = Number("m", 0.3e-9, optional=True, above=0, usual=(0.02e-9, 5e-9))
    damping_exponent: Number[float] = Number("1", 0.5, minimum=0, maximum=100)
    bias: Number[float] = Number("V", 0.0, minimum=-1e100, maximum=1e100, usual=(1e-6, 100.0))  # it can be squared
    withdrawal: str = "linear"
    longrange: str | LongRange = VAN_DER_WAALS

    def __post_init__(self) -> None:
        if isinstance(self.contact, str) and self.contact.lower() in LAWS:
            object.__setattr__(self, "contact", self.contact.lower())
        known = isinstance(self.contact, ContactLaw) or (isinstance(self.contact, str) and self.contact in LAWS)
        if not known:
            hint = "Derive its class from phasemap.ContactLaw." if hasattr(self.contact, "force") else ""
            if isinstance(self.contact, str) and (kind := WITH_PARAMETERS.get(self.contact.lower())):
                hint = f"Give pm.interaction.{kind.__name__}(...), in a scene {{ law = {kind.name!r}, ... }}."
            if isinstance(self.contact, type) and issubclass(self.contact, ContactLaw):
                hint = f"Give an object, {self.contact.__name__}()."
            raise InputError("contact", self.contact, "one of " + ", ".join(LAWS) + ", or in Python a ContactLaw", hint)
        law = self.law
        if self.bias and (type(law.attraction) is not InverseSquare or law.in_time):
            why = "liquid screens it" if law.wets else "it is that of a sphere without losses of its own"
            raise InputError("bias", self.bias, f"0 where the contact is {law.name!r}: {why}")
        self._check_longrange(law)
        check_choice("withdrawal", self.withdrawal, WITHDRAWALS)
        if self.withdrawal == "ting":
            check_memory(law, relaxes=False)
            if self.damping_exponent != law.spread:
                raise InputError("damping_exponent", self.damping_exponent, f"{law.spread:g} with withdrawal 'ting'")

    def _check_longrange(self, law: ContactLaw) -> None:
        """Refuse a long-range law that is none, or does not go together with the rest."""
        given = self.longrange
        if isinstance(given, str):
            check_choice("longrange", given.lower(), (VAN_DER_WAALS, *FORCES))
            object.__setattr__(self, "longrange", given.lower())
        elif type(given) not in FORCES.values():
            objects = ", ".join(f"{kind.__name__}()" for kind in FORCES.values())
            allowed = f"one of {', '.join((VAN_DER_WAALS, *FORCES))}, or in Python {objects}"
            raise InputError("longrange", given, allowed, "Any other force is had by pm.interaction.Table.")
        if self.longrange == VAN_DER_WAALS:
            return
        name = given.lower() if isinstance(given, str) else given.name
        if self.bias:
            raise InputError("bias", self.bias, f"0 V where longrange is {name!r}")
        if type(law.attraction) is not InverseSquare or law.in_time:
            raise InputError("longrange", name, f"{VAN_DER_WAALS!r} where the contact is {law.name!r}")

    @property
    def outside(self) -> LongRange:
        """The long-range law itself."""
        if self.bias:
            return Biased(self.bias)
        if isinstance(self.longrange, LongRange):
            return self.longrange
        return self.law.attraction if self.longrange == VAN_DER_WAALS else FORCES[self.longrange]()

    @property
    def law(self) -> ContactLaw:
        """The contact law itself."""
        law = LAWS[self.contact] if isinstance(self.contact, str) else self.contact
        return law.beside(self.decay_length)

    def columns(
        self, contact_stiffness: Array, adhesion: Array, damping: Array, radius: float, film: Array | None = None,
        liquid: Array | None = None,
    ) -> Array:  # fmt: skip
        """Parameter rows of the kernels, one a material, shape (n, 16).

        `contact_stiffness` (shape (n,)): K [Pa], 1/K = (3/4) [(1 - nu_s^2)/E_s + (1 - nu_t^2)/E_t].
        `adhesion`, `damping` (shape (n,)): work of adhesion [J/m2], alpha1 [1].
        `radius`: of the tip [m].
        `film` (shape (n, 2)): Poisson's ratio [1] and thickness [m] where materials are films on a rigid base.
        `liquid` (shape (n, 2)): as for `ContactLaw.necks`.

        Contact parameters are in columns 0-3, long-range in 4-7 (4 is the whole attraction at d = 0 [N]), damping in 8
        and 9, depth of release [m] in 10 (0 without a neck), constant attraction in contact [N] in 11, necks of liquid
        in 12-15; zeros where a term is absent. A row is NaN where the law cannot have the material, and -inf in column
        10 where breaking the neck would give back more energy than forming the contact took.

        Raises InputError if the formulas of a user's law fail, or the law does not go together with a film.
        """
        rows = self._rows(contact_stiffness, adhesion, damping, radius, film, liquid)
        rows[rows[:, col.FORMING] < rows[:, col.RELEASE]] = np.nan  # films that meet farther out than their neck breaks
        creates = self._loop_energies(rows) < 0
        if self.law.may_do_without_neck:
            rows[creates, col.RELEASE] = 0.0
        else:
            rows[creates] = np.nan
            rows[creates, col.RELEASE] = -np.inf
        rows[~np.isfinite(rows).all(axis=1) & ~creates] = np.nan
        return rows

    def remembering(self, rows: Array, relaxation: Array | None) -> bool:
        """Put what `relaxation_of` gives into rows of `columns`, and say whether any remembers, if the law can."""
        if relaxation is not None:
            rows[:, col.CONTACT] *= relaxation[:, 3]
        if relaxation is not None and relaxation[:, 0].any():
            check_memory(self.law, relaxes=True)
            relaxing = relaxation[:, 0] > 0
            for place, column in zip((col.RELAXATION, col.RELAXING, col.SPECTRUM), relaxation.T, strict=False):
                rows[relaxing, place] = column[relaxing]
            return True
        if self.withdrawal != "ting" or not rows[:, col.DAMPING].any():
            return False
        rows[(rows[:, col.DAMPING] > 0) & (rows[:, 0] == 0)] = math.nan  # a dent in a liquid never comes back
        return True

    def check(
        self, contact_stiffness: float, adhesion: float, radius: float, film: Array | None = None,
        liquid: Array | None = None,
    ) -> None:  # fmt: skip
        """Refuse one material that the laws cannot have: whose row `columns` would mark."""
        rows = self._rows(np.array([contact_stiffness]), np.array([adhesion]), np.zeros(1), radius, film, liquid)
        name, depth, energy = self.law.name, float(rows[0, col.RELEASE]), float(self._loop_energies(rows)[0])
        if not np.isfinite(rows).all():
            if contact_stiffness > 0 or is_own(self.law):
                given = f"K = {contact_stiffness:.3g} Pa, an adhesion of {adhesion:.3g} J/m² and R = {radius:.3g} m"
                hint = f"With {given} it makes p = {rows[0].tolist()}."
                raise InputError("contact", name, "a law with finite numbers for the material", hint)
            allowed = f"a number above 0 Pa where {name} contact has adhesion"
            raise InputError("modulus", 0.0, allowed, "Its neck would never break.")
        if rows[0, col.FORMING] < depth:
            lasts = f"less than {-depth:.3g} m, where their neck breaks" if depth < 0 else "one over which a neck lasts"
            meet, allowed = float(f"{-rows[0, col.FORMING]:.3g}"), f"{lasts}: thinner films, or a blunter tip"
            raise InputError("gap at which the films of liquid meet", meet, allowed)
        if energy < 0 and not self.law.may_do_without_neck:
            raise InputError(
                "contact", name, "a law whose neck loses energy beside the long-range force",
                f"This neck would break at {depth * 1e9:.3g} nm and give back {-energy:.3g} J more than forming the "
                "contact took, for the long-range force reaches farther. Use 'maugis' or 'dmt', or a shorter "
                "decay_length, or decay_length=None (in a scene 'none').",
            )  # fmt: skip

    def token(self, remembers: bool = False) -> Law:
        """The compiled formulas as one argument for the kernels; with the march of a memory if one is needed."""
        from phasemap._kernels.law import law_of

        law, longrange = self.law, self.outside
        try:
            token = law_of(law.force, law.slope, longrange.force, longrange.slope, law.damping, law.damping_slope)
        except TypeError as error:
            raise InputError("contact", law.name, "a law whose formulas numba compiles", str(error)) from error
        token = token._replace(attracts=int(longrange.attracts), lossy=int(law.lossy))
        if law.withdrawn is not None:
            from phasemap._kernels.law import address_of

            token = token._replace(lossy=address_of(law.withdrawn))
        if not remembers:
            return token
        from phasemap._kernels.orbits.time.march import address_of_relaxing

        return token._replace(memory=address_of_relaxing())

    def _rows(
        self,
        contact_stiffness: Array,
        adhesion: Array,
        damping: Array,
        radius: float,
        film: Array | None,
        liquid: Array | None,
    ) -> Array:
        """`columns` without marks."""
        rows = np.zeros((len(contact_stiffness), col.ROW))
        law = self.law
        if liquid is not None and not law.wets:
            allowed = f"nothing where the contact is {law.name!r}, which is dry"
            given = "liquid_film" if np.isfinite(liquid[:, 0]).any() else "contact_angle"
            raise InputError(given, Word("given"), allowed, "The contact 'capillary' takes it.")
        with np.errstate(all="ignore"):  # a material that the law cannot have ends as NaN
            try:
                if film is not None:
                    rows[:, [col.THINNESS, col.FILM_SERIES]] = law.films(radius, film)
                for j, column in enumerate(law.columns(contact_stiffness, adhesion, radius)):
                    rows[:, j] = column
                rows[:, col.RELEASE] = law.release(contact_stiffness, adhesion, radius) + 0.0  # no -0
                exponent = self.damping_exponent  # alpha_s = alpha1 (d/R)^n (Wang 1999, Eq. 4): theory, Eq. (model-15)
                rows[:, col.DAMPING], rows[:, col.EXPONENT] = damping / radius**exponent, exponent
                self._try(rows)
                pull = law.pull(contact_stiffness, adhesion, radius)
            except InputError:
                raise
            except Exception as error:  # whatever a user's law does
                if not is_own(self.law):
                    raise
                hint = f"It raised {type(error).__name__}: {error}."
                raise InputError("contact", law.name, "a law whose methods run", hint) from error
        with np.errstate(all="ignore"):  # as above
            rows[:, col.BIAS] = self.outside.in_contact(self.decay_length, radius)
            for j, column in enumerate(self.outside.columns(pull, self.decay_length, radius)):
                rows[:, 4 + j] = column
        if law.lossy:
            rows[:, col.LOSS_FALL], rows[:, col.LOSS] = law.loss_outside()
        if law.wets:
            none = np.full((len(rows), 2), np.inf)
            rows[:, [col.RELEASE, col.FORMING, col.BRIDGE, col.BRIDGE_CURVE, col.BRIDGE_FALL]] = np.column_stack(
                law.necks(radius, none if liquid is None else liquid)
            )
            dry = rows[:, col.RELEASE] == 0.0
            rows[dry, col.PULL] = np.broadcast_to(pull, len(rows))[dry]
        return rows

    def _try(self, rows: Array) -> None:
        """Call the formulas of a user's law, as Python, with the material that damps most."""
        law = self.law
        valid = np.flatnonzero(np.isfinite(rows).all(axis=1))
        if not is_own(self.law) or not len(valid):
            return
        row = rows[valid[np.argmax(rows[valid, col.DAMPING])]]
        formulas = {"force": law.force, "slope": law.slope}
        if row[col.DAMPING]:
            formulas["damping"] = law.damping
        for d in TRIED:
            for name, formula in formulas.items():
                value = formula(d, row)
                if isinstance(value, complex) or not math.isfinite(value):  # complex: a root of what is below 0
                    raise InputError(
                        "contact", law.name, "a law with finite force, slope and damping for d >= 0",
                        f"At d = {d:g} m with p = {row.tolist()} it gives {value} for the {name}.",
                    )  # fmt: skip

    def _loop_energies(self, rows: Array) -> Array:
        """Energy that a loop of contact and release loses [J]: 0 without a neck, and a relative 1e-9 below 0."""
        if not rows[:, col.RELEASE].any() or not rows[:, [col.LONGRANGE, col.FORMING]].any():
            return np.zeros(len(rows))
        from phasemap._kernels.neck_energy import loop_energies

        with np.errstate(invalid="ignore"):
            energies = loop_energies(self.token(), rows)
            return np.where(np.abs(energies) < 1e-9 * np.abs(rows[:, 4] * rows[:, col.RELEASE]), 0.0, energies)


def may_remember(law: ContactLaw, *, relaxes: bool) -> bool:
    """True if contacts under a law are known to remember, as the material relaxes or as withdrawal after Ting."""
    return law.force in (hertzian, Capillary.force, Film.force if relaxes else None) and not law.lossy


def check_memory(law: ContactLaw, *, relaxes: bool) -> None:
    """Refuse a law whose contacts are not known to remember, as the material relaxes or as withdrawal after Ting."""
    if not may_remember(law, relaxes=relaxes):
        allowed = "'hertz', 'dmt' or 'capillary' where withdrawal is 'ting'"
        if relaxes:
            allowed = "'hertz', 'dmt', 'capillary' or 'film' where materials relax"
        raise InputError("contact", law.name, allowed)
