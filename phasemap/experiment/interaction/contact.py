"""Forces in contact. A law is one class and one entry of `LAWS`; laws with long formulas have files of their own."""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from phasemap._kernels.columns import CONTACT, PULL
from phasemap._kernels.forces import hertzian, hertzian_slope
from phasemap._shared.arrays import Array
from phasemap._shared.errors import InputError
from phasemap._shared.fields import Number
from phasemap.experiment.interaction.base import ContactLaw, SphereLaw
from phasemap.experiment.interaction.capillary import Capillary
from phasemap.experiment.interaction.film import Film
from phasemap.experiment.interaction.longrange import Inverse
from phasemap.experiment.interaction.maugis import MaugisDugdale


class DMT(SphereLaw):
    """F = K sqrt(R) d^(3/2) - 2 pi w R (Derjaguin, Muller, Toporov 1975; Wang 1999, Eq. 2): theory, Eq. (model-7)."""

    name = "dmt"

    force = staticmethod(hertzian)
    slope = staticmethod(hertzian_slope)


class Hertz(DMT):
    """F = K sqrt(R) d^(3/2) (Hertz 1881): no adhesion, in contact or before it."""

    name = "hertz"

    def pull(self, contact_stiffness: Array, adhesion: Array, radius: float) -> Array:
        """No attraction, whatever the adhesion."""
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
        """Linear in d, for the contact's radius is constant."""
        return p[CONTACT] * d - p[PULL]

    @staticmethod
    def slope(d: float, p: Array) -> float:
        """Constant, twice E* R_c."""
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
        """Adhesion stays what it is in the neck, down to its end."""
        depth = max(d, 0.0)
        return p[CONTACT] * depth * math.sqrt(depth) - p[PULL]

    @staticmethod
    def slope(d: float, p: Array) -> float:
        """That of Hertz; 0 in the neck."""
        return 1.5 * p[CONTACT] * math.sqrt(max(d, 0.0))

    def release(self, contact_stiffness: Array, adhesion: Array, radius: float) -> Array:
        """Minus the length, where there is adhesion."""
        return -self.length * (adhesion > 0.0).astype(np.float64)


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
        """Quadratic in d, for the contact's radius is proportional to it."""
        return p[CONTACT] * d * d - p[PULL]

    @staticmethod
    def slope(d: float, p: Array) -> float:
        """Linear in d."""
        return 2.0 * p[CONTACT] * d

    def columns(self, contact_stiffness: Array, adhesion: Array, radius: float) -> tuple[Array | float, ...]:
        """p[CONTACT] = (2/pi) E* tan(theta) [Pa], p[PULL] = the attraction [N]."""
        stiffness = 1.5 / math.pi * math.tan(math.radians(self.half_angle)) * contact_stiffness
        return stiffness, self.pull(contact_stiffness, adhesion, radius)

    def pull(self, contact_stiffness: Array, adhesion: Array, radius: float) -> Array:
        """2 pi w d0 tan(theta)^2 [N]: a cone has no attraction without a decay length d0, which adhesion needs."""
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
        """The law with the decay length, on which its adhesion depends."""
        law = copy(self)
        object.__setattr__(law, "_reach", decay_length)
        return law


RADIUS, S_C, D_C = 1, 2, 3  # columns of the law beside its contact


def _root(d: float, p: Array) -> tuple[float, float]:
    """t and s = s_c + t, the square root of the contact radius, on the stable branch.

    With s_c^4 = -R d_c / 3 the law d = s^4/R - 4 s_c^3 s/R is t^2 (t^2 + 4 s_c t + 6 s_c^2) = R (d - d_c), which loses
    no digits near release (t -> 0), deep in contact or without adhesion (s_c = 0). The start is exact at both ends of t
    and, by a polynomial that was fitted, 8e-6 off between them; one of Halley's steps brings it to rounding.
    """
    s_c = p[S_C]
    goal = max(p[RADIUS] * (d - p[D_C]), 1e-140)  # so that t, and the slope at release, are finite
    e = math.sqrt(goal)
    root = math.sqrt(e + 2.1010205144336438 * s_c * s_c)  # (sqrt(6) - 1)^2
    u = 1.4494897427831781 * s_c / root  # 0 deep in contact, 1 at release
    t = e / (s_c + root) * (1.0 + u * (1.0 - u) * (-0.00028978 + u * (0.02740395 - 0.00704591 * u)))
    b = 6.0 * s_c * s_c
    off = t * t * (t * t + 4.0 * s_c * t + b) - goal
    slope = t * (4.0 * t * t + 12.0 * s_c * t + 2.0 * b)
    t -= off * slope / (slope * slope - off * (6.0 * t * t + 12.0 * s_c * t + b))
    return t, s_c + t


class JKR(ContactLaw):
    """F = K a^3/R - sqrt(6 pi w K a^3), d = a^2/R - (2/3) sqrt(6 pi w a/K) (Johnson, Kendall, Roberts 1971).

    With s = sqrt(a), s_c^6 = pi w R^2/(6 K): F = (K/R) s^3 (s^3 - 6 s_c^3). First contact is at F = -(4/3) pi w R, the
    neck breaks at d_c = -3 s_c^4/R = -1.6088 (w^2 R/E*^2)^(1/3) with F = -(5/6) pi w R. The long-range force is that of
    every adhesive law, -2 pi w R where it meets contact. See theory, Eqs. (model-8) and (model-10).
    """

    name = "jkr"

    @staticmethod
    def force(d: float, p: Array) -> float:
        """By s, the root of the contact's radius; below d = 0 in the neck."""
        _, s = _root(d, p)
        cube = s * s * s
        return p[CONTACT] * cube * (cube - 6.0 * p[S_C] * p[S_C] * p[S_C])

    @staticmethod
    def slope(d: float, p: Array) -> float:
        """dF/ds over dd/ds, which grows without bound to where the neck breaks."""
        t, s = _root(d, p)
        s_c = p[S_C]
        rise = t * (t * t + 3.0 * s_c * t + 3.0 * s_c * s_c)  # s^3 - s_c^3
        return 1.5 * p[CONTACT] * p[RADIUS] * s * s * (rise - 2.0 * s_c * s_c * s_c) / rise

    def columns(self, contact_stiffness: Array, adhesion: Array, radius: float) -> tuple[Array | float, ...]:
        """p[CONTACT] = K/R [Pa/m], p[RADIUS] = R [m], p[S_C] = s_c [m^0.5], p[D_C] = d_c [m]."""
        s_c = self._least(contact_stiffness, adhesion, radius)
        return contact_stiffness / radius, radius, s_c, -3 * s_c**4 / radius

    def pull(self, contact_stiffness: Array, adhesion: Array, radius: float) -> Array:
        """2 pi w R [N], as of DMT."""
        return 2 * math.pi * radius * adhesion

    def release(self, contact_stiffness: Array, adhesion: Array, radius: float) -> Array:
        """d_c [m]: depth at which the neck breaks."""
        return -3 * self._least(contact_stiffness, adhesion, radius) ** 4 / radius

    @staticmethod
    def _least(contact_stiffness: Array, adhesion: Array, radius: float) -> Array:
        """s_c [m^0.5]; infinite where there is adhesion without stiffness, for then the neck never breaks."""
        ratio = np.divide(adhesion, contact_stiffness, out=np.zeros_like(adhesion), where=adhesion != 0)
        return np.asarray((math.pi * radius**2 / 6 * ratio) ** (1 / 6))


@dataclass(frozen=True)
class LossyDMT(SphereLaw):
    """DMT contact that loses energy outside contact, or by adhesion: theory, Eqs. (losses-1) and (losses-2).

    Outside contact -Gamma exp(d/Lambda) d' acts beside the attraction (Gotsmann et al., Phys. Rev. B 60, 11051 (1999)).
    In contact the work of adhesion is w on the way in, and w_r from the deepest point on until contact ends. Both add
    to the damping in contact. Motion over it is marched in time.

    Parameters
    ----------
    adhesion_ratio : float
        w_r / w [1], >= 1, of every material.
    outer_loss : float
        Gamma [N s/m], >= 0.
    outer_length : float
        Lambda [m], > 0.
    """

    adhesion_ratio: Number[float] = Number("1", 1.0, minimum=1.0, maximum=1e3)
    outer_loss: Number[float] = Number("N s/m", 0.0, minimum=0, maximum=1e3, usual=(1e-12, 1e-2))
    outer_length: Number[float] = Number("m", 1e-9, above=0, usual=(0.05e-9, 100e-9))
    name: ClassVar[str] = "lossy dmt"
    in_time: ClassVar[bool] = True
    lossy: ClassVar[bool] = True

    force = staticmethod(hertzian)
    slope = staticmethod(hertzian_slope)

    def columns(self, contact_stiffness: Array, adhesion: Array, radius: float) -> tuple[Array, ...]:
        """p[CONTACT] = K sqrt(R) [N m^-1.5], p[PULL] and p[WITHDRAWN] = attractions of w and of w_r - w [N]."""
        pull = self.pull(contact_stiffness, adhesion, radius)
        return contact_stiffness * math.sqrt(radius), pull, (self.adhesion_ratio - 1.0) * pull

    def loss_outside(self) -> tuple[float, float]:
        """1/Lambda [1/m] and Gamma [N s/m]."""
        return 1.0 / self.outer_length, self.outer_loss


LAWS: dict[str, ContactLaw] = {
    **{law.name: law for law in (Hertz(), DMT(), JKR(), MaugisDugdale(), FlatPunch(), Cone(), Film(), Capillary())},
    "slipping film": Film("slipping"),
}
