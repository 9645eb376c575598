"""Eigenmodes of a lever: those of a uniform beam, those that are given, and how the free lever moves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from typing import TypeAlias

from phasemap._shared.checks import whole
from phasemap._shared.errors import InputError
from phasemap._shared.fields import Number, known_as
from phasemap._shared.plausible import unquestioned
from phasemap._shared.shown import Shown

BETAS = (1.875104068711961, 4.694091132974175, 7.854757438237613, 10.995540734875467)
"""Wave number times length of a clamped beam's modes, the solutions of cos(beta) cosh(beta) = -1."""
MOST_MODES = len(BETAS)
OF_FIRST = 1.565984  # participation of a uniform beam's first mode


@known_as(f="frequency_ratio", Q="quality_factor", k="stiffness_ratio", B="participation")
@dataclass(frozen=True, repr=False)
class Eigenmode(Shown):
    """A higher eigenmode of the lever; what is None is that of a uniform beam's mode in the same place.

    Parameters
    ----------
    frequency_ratio : float
        Its resonance frequency over that of the first mode [1], > 1: 6.27 for the second mode of a uniform beam in
        air, 7 to 9 in a liquid.
    quality_factor : float
        Its quality factor [1], > 0.5.
    stiffness_ratio : float, optional
        Its stiffness at the tip over that of the first mode [1], > 0. A liquid does not change it.
    participation : float, optional
        How strongly motion of the base drives it [1]: integral of its shape over that of the shape squared, where the
        shape is 1 at the tip.
    slope_ratio : float, optional
        Its slope at the tip over that of the first mode, for the same deflection [1].

    Examples
    --------
    >>> import phasemap as pm
    >>> lever = pm.Cantilever(0.1, 20e3, 2.5, modes=(pm.Eigenmode(frequency_ratio=7.5, quality_factor=6.0),))
    >>> round(lever.eigenmodes[1].stiffness_ratio, 4), round(lever.eigenmodes[1].participation, 6)
    (39.2739, -0.867872)
    """

    frequency_ratio: Number[float] = Number("1", minimum=1, usual=(2, 100))
    quality_factor: Number[float] = Number("1", above=0.5, usual=(0.5, 1e6))
    stiffness_ratio: Number[float | None] = Number("1", None, above=0, usual=(0.1, 1e5))
    participation: Number[float | None] = Number("1", None, usual=(1e-3, 100))
    slope_ratio: Number[float | None] = Number("1", None, usual=(1e-2, 100))


Modes: TypeAlias = "tuple[Eigenmode, ...] | int"


def check_modes(modes: object) -> Modes:
    """Return the higher modes, or how many there are in all, if a lever can have them."""
    allowed = f"at most {MOST_MODES - 1} Eigenmodes above the first, or the number of all modes, 1 to {MOST_MODES}"
    if not isinstance(modes, (tuple, list)):
        try:
            count = whole("modes", modes, 1, MOST_MODES)
        except InputError:
            raise InputError("modes", modes, allowed) from None
        return count if count > 1 else ()
    if len(modes) >= MOST_MODES or not all(isinstance(mode, Eigenmode) for mode in modes):
        raise InputError("modes", modes, allowed)
    ratios = [1.0, *(mode.frequency_ratio for mode in modes)]
    if any(one >= other for one, other in pairwise(ratios)):
        raise InputError("frequency ratios of the modes", ratios[1:], "numbers above 1, each above the one before")
    return tuple(modes)


@unquestioned()
def all_modes(quality_factor: float, participation: float, modes: Modes) -> tuple[Eigenmode, ...]:
    """The first mode and the higher ones, with no number left open; `modes` as `check_modes` returns them.

    A number makes those of a uniform beam in a gas, whose quality factors grow as the root of the frequency.
    """
    if isinstance(modes, int):
        ratios = [(beta / BETAS[0]) ** 2 for beta in BETAS[1:modes]]
        modes = tuple(Eigenmode(ratio, quality_factor * math.sqrt(ratio)) for ratio in ratios)
    found = [Eigenmode(1.0, quality_factor, 1.0, participation, 1.0)]
    for beta, mode in zip(BETAS[1:], modes, strict=False):
        uniform = _of_uniform_beam(beta)
        found.append(replace(mode, **{name: value for name, value in uniform.items() if getattr(mode, name) is None}))
    return tuple(found)


@cache
def _of_uniform_beam(beta: float) -> dict[str, float]:
    """Stiffness, participation and slope of a uniform beam's mode, the first and the last over those of mode 1."""
    slope_of_first = _slope_and_participation(BETAS[0])[0]
    slope, participation = _slope_and_participation(beta)
    return {
        "stiffness_ratio": (beta / BETAS[0]) ** 4,
        "participation": participation,
        "slope_ratio": slope / slope_of_first,
    }


def participations(count: int) -> list[float]:
    """Participations of the first modes of a uniform beam."""
    return [_slope_and_participation(beta)[1] for beta in BETAS[:count]]


def _slope_and_participation(beta: float) -> tuple[float, float]:
    """Slope at the tip, over deflection there and length, and participation of a clamped beam's mode."""
    cosh, sinh, cos, sin = math.cosh(beta), math.sinh(beta), math.cos(beta), math.sin(beta)
    ratio = (sinh - sin) / (cosh + cos)
    tip = cosh - cos - ratio * (sinh - sin)  # the mean square of this shape is 1, and its mean 2 ratio / beta
    return beta * (sinh + sin - ratio * (cosh - cos)) / tip, 2 * ratio * tip / beta


def free_motion(modes: Sequence[Eigenmode], omega: float, drive: float, excitation: str) -> list[complex]:
    """Complex amplitude of each mode of the free lever, relative to its base, where the drive is i `drive` [m].

    `omega`: drive frequency over resonance frequency of the first mode [1].
    `drive`: amplitude of the base, or that of the force on the tip over the first mode's stiffness [m].
    """
    found = []
    for mode in modes:
        square, loss = mode.frequency_ratio**2, omega * mode.frequency_ratio / mode.quality_factor
        assert mode.participation is not None
        assert mode.stiffness_ratio is not None
        pull = mode.participation * (omega**2 - 1j * loss) if excitation == "base" else square / mode.stiffness_ratio
        found.append(1j * drive * pull / (square - omega**2 + 1j * loss))
    return found
