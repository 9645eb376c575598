"""Forces between tip and surface: one law per class, each with its formula, paper and equation number.

`Interaction` names the laws; `Interaction.columns` turns material maps into the parameter rows that the kernels read
and `Interaction.token` into the compiled formulas. Everything here is SI.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import phasemap.interaction.contact as contact_laws
from phasemap._check import number
from phasemap.errors import InputError
from phasemap.interaction.contact import ContactLaw
from phasemap.interaction.damping import PowerLawDamping
from phasemap.interaction.longrange import InverseSquare

if TYPE_CHECKING:
    import numpy as np

    from phasemap._kernels.law import Law

__all__ = ["ContactLaw", "Interaction"]


@dataclass(frozen=True)
class Interaction:
    """Which laws act between tip and surface.

    Parameters
    ----------
    contact : str or ContactLaw
        "hertz" (no adhesion) or "dmt", or a law of one's own (see `phasemap.interaction.contact.ContactLaw`).
    decay_length : float, optional
        d0 [m], > 0, of the inverse-square attraction outside contact, Wang (1999) Eq. 3; None for no long-range force.
    damping_exponent : float
        n [1], >= 0, in alpha_s = alpha1 (d/R)**n, Wang (1999) Eq. 4.

    Raises
    ------
    InputError
        If the contact law is unknown or a value is out of range.

    Examples
    --------
    >>> Interaction(contact="hertz", decay_length=None).law.name
    'hertz'
    """

    contact: str | ContactLaw = "dmt"
    decay_length: float | None = 0.3e-9
    damping_exponent: float = 0.5

    def __post_init__(self) -> None:
        if isinstance(self.contact, str):
            if self.contact not in contact_laws.LAWS:
                raise InputError(
                    "contact", self.contact, "one of " + ", ".join(contact_laws.LAWS) + ", or a ContactLaw"
                )
        elif not isinstance(self.contact, ContactLaw):
            raise InputError("contact", self.contact, "one of " + ", ".join(contact_laws.LAWS) + ", or a ContactLaw")
        if self.decay_length is not None:
            number("decay_length", self.decay_length, "m", above=0)
        number("damping_exponent", self.damping_exponent, "1", minimum=0)

    @property
    def law(self) -> ContactLaw:
        """The contact law itself."""
        return contact_laws.LAWS[self.contact] if isinstance(self.contact, str) else self.contact

    def columns(
        self, contact_stiffness: np.ndarray, adhesion: np.ndarray, damping: np.ndarray, radius: float
    ) -> np.ndarray:
        """Parameter rows of the kernels, one a material.

        Parameters
        ----------
        contact_stiffness : ndarray, shape (n,)
            K [Pa], 1/K = (3/4) [(1 - nu_s^2)/E_s + (1 - nu_t^2)/E_t].
        adhesion : ndarray, shape (n,)
            Work of adhesion [J/m2].
        damping : ndarray, shape (n,)
            alpha1 [1].
        radius : float
            Tip radius [m].

        Returns
        -------
        ndarray, shape (n, 12)
            Contact parameters in columns 0-3, long-range in 4-7, damping in 8-11; zeros where a term is absent.
        """
        import numpy as np

        rows = np.zeros((len(contact_stiffness), 12))
        law = self.law
        column: np.ndarray | float
        for j, column in enumerate(law.columns(contact_stiffness, adhesion, radius)):
            rows[:, j] = column
        if self.decay_length is not None:
            reach = InverseSquare.columns(law.pull(contact_stiffness, adhesion, radius), self.decay_length)
            for j, column in enumerate(reach):
                rows[:, 4 + j] = column
        for j, column in enumerate(PowerLawDamping.columns(damping, radius, self.damping_exponent)):
            rows[:, 8 + j] = column
        return rows

    def token(self) -> Law:
        """Return the compiled formulas as one argument for the kernels."""
        from phasemap._kernels.law import Law

        return Law(
            self.law.force,
            self.law.slope,
            InverseSquare.force,
            InverseSquare.slope,
            PowerLawDamping.damping,
            PowerLawDamping.slope,
        )
