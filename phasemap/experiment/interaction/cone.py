"""Contact of a conical tip."""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from phasemap._kernels.columns import CONTACT, PULL
from phasemap._shared.errors import InputError
from phasemap._shared.fields import Number
from phasemap.experiment.interaction.base import ContactLaw
from phasemap.experiment.interaction.longrange import Inverse

if TYPE_CHECKING:
    import numpy as np

    Array = np.ndarray


@dataclass(frozen=True)
class Cone(ContactLaw):
    """F = (2/pi) E* tan(theta) d^2 - 2 pi w d0 tan(theta)^2 (Sneddon 1965), E* = 3 K/4: theory, Eq. (model-19).

    Before contact F = -2 pi w d0 tan(theta)^2 / (1 - d/d0): the van der Waals force -H tan(theta)^2 / (6 g) of a cone,
    with H = 12 pi w d0^2 and g = d0 - d as for a sphere. Its adhesion needs a decay length, for a sharp cone has no
    other. The tip's radius does not act, but as the length of which `damping` is a power.

    Parameters
    ----------
    half_angle : float
        theta between axis and side [degree], above 0 and below 90.
    """

    half_angle: Number[float] = Number("degree", 20.0, said="half_angle of the cone", above=0, below=90)
    name: ClassVar[str] = "cone"
    attraction: ClassVar = Inverse()
    spread: ClassVar[float] = 1.0
    _reach: ClassVar[float | None] = None  # decay length [m] of the force that acts beside

    @staticmethod
    def force(d: float, p: Array) -> float:
        return p[CONTACT] * d * d - p[PULL]

    @staticmethod
    def slope(d: float, p: Array) -> float:
        return 2.0 * p[CONTACT] * d

    def columns(self, contact_stiffness: Array, adhesion: Array, radius: float) -> tuple[Array | float, ...]:
        """p[CONTACT] = (2/pi) E* tan(theta) [Pa], p[PULL] = the attraction [N]."""
        stiffness = 1.5 / math.pi * math.tan(math.radians(self.half_angle)) * contact_stiffness
        return stiffness, self.pull(contact_stiffness, adhesion, radius)

    def pull(self, contact_stiffness: Array, adhesion: Array, radius: float) -> Array:
        if self._reach is None:
            if (adhesion > 0).any():
                allowed = "a length in m where the contact is 'cone' and there is adhesion"
                raise InputError("decay_length", None, allowed, "A cone has adhesion by the reach of its attraction.")
            return 0.0 * adhesion
        return 2 * math.pi * self._reach * math.tan(math.radians(self.half_angle)) ** 2 * adhesion

    def radius_at(self, depth: Array, radius: float) -> Array:
        """(2/pi) tan(theta) d [m]."""
        return 2 / math.pi * math.tan(math.radians(self.half_angle)) * depth

    def beside(self, decay_length: float | None) -> Cone:
        law = copy(self)
        object.__setattr__(law, "_reach", decay_length)
        return law
