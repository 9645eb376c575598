"""Johnson, Kendall and Roberts: adhesion that deforms the solids."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from phasemap._kernels.columns import CONTACT
from phasemap.experiment.interaction.base import ContactLaw

if TYPE_CHECKING:
    import numpy as np

    Array = np.ndarray


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
        _, s = _root(d, p)
        cube = s * s * s
        return p[CONTACT] * cube * (cube - 6.0 * p[S_C] * p[S_C] * p[S_C])

    @staticmethod
    def slope(d: float, p: Array) -> float:
        t, s = _root(d, p)
        s_c = p[S_C]
        rise = t * (t * t + 3.0 * s_c * t + 3.0 * s_c * s_c)  # s^3 - s_c^3
        return 1.5 * p[CONTACT] * p[RADIUS] * s * s * (rise - 2.0 * s_c * s_c * s_c) / rise

    def columns(self, contact_stiffness: Array, adhesion: Array, radius: float) -> tuple[Array | float, ...]:
        """p[CONTACT] = K/R [Pa/m], p[RADIUS] = R [m], p[S_C] = s_c [m^0.5], p[D_C] = d_c [m]."""
        s_c = self._least(contact_stiffness, adhesion, radius)
        return contact_stiffness / radius, radius, s_c, -3 * s_c**4 / radius

    def pull(self, contact_stiffness: Array, adhesion: Array, radius: float) -> Array:
        return 2 * math.pi * radius * adhesion

    def release(self, contact_stiffness: Array, adhesion: Array, radius: float) -> Array:
        return -3 * self._least(contact_stiffness, adhesion, radius) ** 4 / radius

    @staticmethod
    def _least(contact_stiffness: Array, adhesion: Array, radius: float) -> Array:
        """s_c [m^0.5]; infinite where there is adhesion without stiffness, for then the neck never breaks."""
        import numpy as np

        ratio = np.divide(adhesion, contact_stiffness, out=np.zeros_like(adhesion), where=adhesion != 0)
        return np.asarray((math.pi * radius**2 / 6 * ratio) ** (1 / 6))
