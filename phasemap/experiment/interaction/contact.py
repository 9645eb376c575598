"""Forces in contact. A law is one class and one entry of `LAWS`; laws with long formulas have files of their own."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from phasemap._kernels.columns import CONTACT, PULL
from phasemap._kernels.forces import hertzian, hertzian_slope
from phasemap._shared.fields import Number
from phasemap.experiment.interaction.base import ContactLaw, SphereLaw
from phasemap.experiment.interaction.capillary import Capillary
from phasemap.experiment.interaction.cone import Cone
from phasemap.experiment.interaction.film import Film
from phasemap.experiment.interaction.jkr import JKR
from phasemap.experiment.interaction.maugis import MaugisDugdale

if TYPE_CHECKING:
    import numpy as np

    Array = np.ndarray

__all__ = [
    "DMT", "JKR", "LAWS", "Capillary", "Cone", "ContactLaw", "Film", "FlatPunch", "Hertz",
    "MaugisDugdale", "Neck",
]  # fmt: skip


class DMT(SphereLaw):
    """F = K sqrt(R) d^(3/2) - 2 pi w R (Derjaguin, Muller, Toporov 1975; Wang 1999, Eq. 2): theory, Eq. (model-7)."""

    name = "dmt"

    force = staticmethod(hertzian)
    slope = staticmethod(hertzian_slope)


class Hertz(DMT):
    """F = K sqrt(R) d^(3/2) (Hertz 1881): no adhesion, in contact or before it."""

    name = "hertz"

    def pull(self, contact_stiffness: Array, adhesion: Array, radius: float) -> Array:
        return 0.0 * adhesion


@dataclass(frozen=True)
class FlatPunch(SphereLaw):
    """F = 2 E* R_c d - 2 pi w R, E* = 3 K / 4: a flat punch (Sneddon 1965), for a worn tip or a thin stiff layer.

    Its attraction is that of a sphere of the tip's radius R, as of a tip with a small flat at its end.

    Parameters
    ----------
    contact_radius : float, optional
        R_c [m], > 0; the tip's radius by default.
    """

    contact_radius: Number[float | None] = Number("m", None, above=0, usual=(1e-12, 10e-6))
    name: ClassVar[str] = "punch"
    spread: ClassVar[float] = 0.0

    @staticmethod
    def force(d: float, p: Array) -> float:
        return p[CONTACT] * d - p[PULL]

    @staticmethod
    def slope(d: float, p: Array) -> float:
        return p[CONTACT]

    def columns(self, contact_stiffness: Array, adhesion: Array, radius: float) -> tuple[Array, ...]:
        """p[CONTACT] = 2 E* R_c [N/m], p[PULL] = the attraction [N]."""
        flat = radius if self.contact_radius is None else self.contact_radius
        return 1.5 * contact_stiffness * flat, self.pull(contact_stiffness, adhesion, radius)

    def radius_at(self, depth: Array, radius: float) -> Array:
        """R_c [m], at any depth."""
        return 0.0 * depth + (radius if self.contact_radius is None else self.contact_radius)


@dataclass(frozen=True)
class Neck(SphereLaw):
    """DMT contact whose adhesion holds the retracting tip over a length: a neck of liquid or polymer that then breaks.

    F = K sqrt(R) max(d, 0)^(3/2) - 2 pi w R down to d = -length.

    Parameters
    ----------
    length : float
        Elongation at which the neck breaks [m], > 0.
    """

    length: Number[float] = Number("m", said="neck length", above=0, usual=(1e-12, 1e-6))
    name: ClassVar[str] = "neck"

    @staticmethod
    def force(d: float, p: Array) -> float:
        depth = max(d, 0.0)
        return p[CONTACT] * depth * math.sqrt(depth) - p[PULL]

    @staticmethod
    def slope(d: float, p: Array) -> float:
        return 1.5 * p[CONTACT] * math.sqrt(max(d, 0.0))

    def release(self, contact_stiffness: Array, adhesion: Array, radius: float) -> Array:
        return -self.length * (adhesion > 0.0)


LAWS: dict[str, ContactLaw] = {
    **{law.name: law for law in (Hertz(), DMT(), JKR(), MaugisDugdale(), FlatPunch(), Cone(), Film(), Capillary())},
    "slipping film": Film("slipping"),
}  # fmt: skip
