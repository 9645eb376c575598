"""Maugis and Dugdale: adhesion of any range, between DMT and JKR."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from phasemap._kernels.columns import CONTACT
from phasemap._shared.arrays import Array
from phasemap._shared.errors import InputError
from phasemap._shared.fields import Number
from phasemap.experiment.interaction.base import SphereLaw

FOLD = 0.6058  # at the fold of D(s), s < FOLD lambda, which it tends to for large lambda (JKR)
FLAT = 0.9  # below this lambda (exactly 0.938) D(s) has no fold
PER_DEPTH, LAMBDA, RELEASED = 1, 2, 3  # columns of the law beside its contact


def _sides(s: float, lam: float) -> tuple[float, float, float, float]:
    """B = A/s of the contact at s, dB/ds, phi = atan(1/s), and half of dD/ds.

    Maugis' m = c/a enters as s = 1/sqrt(m^2 - 1), in which nothing is singular between a = 0 (at s = 0) and c = a: his
    first equation is (lambda/2) B^2 P + (4/3) lambda^2 B Q = 1, and the depth is D = A^2 - (4/3) lambda B.
    """
    square = s * s
    m = math.sqrt(1.0 + square)
    phi = math.atan(1.0 / s)
    # P and Q; the bound acts for s > 1e6 only, where digits are lost but P does not matter.
    p = max(s + phi * (1.0 - square), 1.0 / (0.6366 + 0.75 * s))
    q = 4.0 / 3.0 * lam * lam * (phi - 1.0 / (s + m))
    root = math.sqrt(q * q + 2.0 * lam * p)
    b = 2.0 / (q + root)
    share = 1.0 / (1.0 + square)
    b_s = -b * (lam * b * s * (s * share - phi) + 4.0 / 3.0 * lam * lam * (1.0 - share - s / m)) / root
    return b, b_s, phi, b * s * (b + s * b_s) - 2.0 / 3.0 * lam * b_s


def _depths(s: Array, lam: Array) -> Array:
    """D of `_sides`, for arrays."""
    phi = np.arctan(1 / s)
    q = 4 / 3 * lam * lam * (phi - 1 / (s + np.sqrt(1 + s * s)))
    b = 2 / (q + np.sqrt(q * q + 2 * lam * (s + phi * (1 - s * s))))
    return np.asarray(b * (b * s * s - 4 / 3 * lam))


def _solve(d: float, p: Array) -> tuple[float, float]:
    """s and lambda at a depth: Newton on sqrt(D(s) - D_r) = sqrt(D - D_r), nearly a line from release to the deepest.

    The start comes from rough A, P and Q, and lies above the fold, where the stable branch is.
    """
    lam = p[LAMBDA]
    least = p[PER_DEPTH] * p[RELEASED]
    goal = math.sqrt(max(p[PER_DEPTH] * (d - p[RELEASED]), -1e-16 * least))  # so that the slope at release is finite
    s = math.sqrt(lam * goal * (0.785 * goal + 0.667 * lam))
    s = math.sqrt(lam * goal * (0.5 * goal / (0.6366 + 0.75 * s) + 4.0 / 3.0 * lam * s / (1.752 + 2.0 * s)))
    s = max(s, FOLD * lam + 0.4 * lam * goal)
    for _ in range(12):
        b, _b_s, _phi, half = _sides(s, lam)
        height = math.sqrt(max(b * (b * s * s - 4.0 / 3.0 * lam) - least, 0.0))
        if half <= 0.0:  # at the fold, but for rounding
            break
        step = min((height - goal) * height / half, 0.5 * s)
        s -= step
        if abs(step) <= 1e-7 * s:  # the next step would be 1e-14
            break
    return s, lam


@dataclass(frozen=True)
class MaugisDugdale(SphereLaw):
    """A constant stress sigma0 = w/h0 up to a gap h0 around the contact.

    D. Maugis 1992, J. Colloid Interface Sci. 150, 243. With lambda = 2 sigma0 (R/(pi w K^2))^(1/3), m = c/a,
    A = a/(pi w R^2/K)^(1/3) and D = d/(pi^2 w^2 R/K^2)^(1/3)::

        (lambda A^2/2) [sqrt(m^2-1) + (m^2-2) atan sqrt(m^2-1)]
            + (4/3) lambda^2 A [sqrt(m^2-1) atan sqrt(m^2-1) - m + 1] = 1,
        D = A^2 - (4/3) lambda A sqrt(m^2-1),
        F = pi w R (A^3 - lambda A^2 [sqrt(m^2-1) + m^2 atan sqrt(m^2-1)]).

    This is theory, Eq. (model-9). DMT for lambda -> 0, JKR for lambda -> infinity. The branch is that of the largest a;
    the neck breaks at its fold, or, for lambda < 0.938, where a reaches 0. Stiff materials (lambda < 0.1) would gain
    energy in the neck beside a long-range force of the same range, which there is the same attraction over again: they
    have no neck then.

    Parameters
    ----------
    range : float, optional
        h0 [m], > 0; by default the decay length of the long-range force.
    """

    range: Number[float | None] = Number("m", None, said="maugis range", above=0, usual=(0.02e-9, 5e-9))
    name: ClassVar[str] = "maugis"
    may_do_without_neck: ClassVar[bool] = True

    @staticmethod
    def force(d: float, p: Array) -> float:
        """By s of `_sides`, which Newton's method finds; Hertz without adhesion."""
        if p[PER_DEPTH] == 0.0:  # no adhesion
            return p[CONTACT] * d * math.sqrt(d)
        s, lam = _solve(d, p)
        b, _, phi, _ = _sides(s, lam)
        return p[CONTACT] * b * b * (b * s * s * s - lam * (s + (1.0 + s * s) * phi))

    @staticmethod
    def slope(d: float, p: Array) -> float:
        """dF/ds over dd/ds on the same branch."""
        if p[PER_DEPTH] == 0.0:
            return 1.5 * p[CONTACT] * math.sqrt(d)
        s, lam = _solve(d, p)
        b, b_s, phi, half = _sides(s, lam)
        a_s = b + s * b_s
        rise = 3.0 * b * s * s * a_s - 2.0 * lam * (b_s * (s + (1.0 + s * s) * phi) + b * s * phi)
        return 0.5 * p[CONTACT] * p[PER_DEPTH] * b * rise / half

    def columns(self, contact_stiffness: Array, adhesion: Array, radius: float) -> tuple[Array | float, ...]:
        """p[CONTACT] = pi w R [N], p[PER_DEPTH] = D/d [1/m], p[LAMBDA] = lambda [1], p[RELEASED] = d_r [m].

        Without adhesion p[CONTACT] = K sqrt(R) [N m^-1.5] and p[PER_DEPTH] = 0.
        """
        lam, scale = self._scales(contact_stiffness, adhesion, radius)
        sticks = adhesion != 0
        force = np.where(sticks, math.pi * adhesion * radius, contact_stiffness * math.sqrt(radius))
        inverse = np.divide(1.0, scale, out=np.zeros_like(scale), where=sticks)
        return force, inverse, lam, self.release(contact_stiffness, adhesion, radius)

    def release(self, contact_stiffness: Array, adhesion: Array, radius: float) -> Array:
        """Least depth [m] of the branch, at its fold or where a is 0, by bisection of dD/ds; 0 without adhesion."""
        lam, scale = self._scales(contact_stiffness, adhesion, radius)
        with np.errstate(all="ignore"):  # without adhesion all is 0/0
            low, high = np.full_like(lam, 1e-9), np.where(lam > FLAT, FOLD * lam, 1e-9)
            for _ in range(30):  # D is lowest there, so that half the digits of s are enough
                middle = 0.5 * (low + high)
                falls = _depths(1.0001 * middle, lam) < _depths(0.9999 * middle, lam)
                low, high = np.where(falls, middle, low), np.where(falls, high, middle)
            depth = scale * _depths(high, lam)
        return np.where(adhesion != 0, depth, 0.0)

    def beside(self, decay_length: float | None) -> MaugisDugdale:
        """The law with the decay length for its range, where it has none of its own."""
        if self.range is not None:
            return self
        if decay_length is None:
            raise InputError(
                "decay_length", None, "a length in m where the contact is 'maugis', or contact=MaugisDugdale(range=...)"
            )
        return replace(self, range=decay_length)

    def _scales(self, contact_stiffness: Array, adhesion: Array, radius: float) -> tuple[Array, Array]:
        """Lambda, and d/D [m]; infinite where there is adhesion without stiffness, for then the neck never breaks."""
        if self.range is None:
            raise InputError("maugis range", None, "a length in m")
        sticks = adhesion != 0
        softness = np.divide(1.0, contact_stiffness, out=np.zeros_like(contact_stiffness), where=sticks)
        cubed = radius * softness**2
        lam = 2 / self.range * np.cbrt(adhesion**2 / math.pi * cubed)
        return np.asarray(lam), np.asarray(np.cbrt(math.pi**2 * adhesion**2 * cubed))
