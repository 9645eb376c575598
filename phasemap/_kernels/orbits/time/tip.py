"""A tip in time: its state at drive phase 0, what a period gives, and how the next one changes with the state."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.orbits.time.elements import STATE

if TYPE_CHECKING:
    from phasemap._kernels.law import Law

# Entries of a state: z, z' [m], whether the tip is in contact or in the neck (1 or 0), and the tip offset [m]. Over a
# surface that remembers it goes on with what `elements` names.
Z, V, TOUCHES, Z0 = 0, 1, 2, 3
# Of what a period gives: cosine and sine part of the first harmonic and mean of z [m], energy into the surface [J],
# virial -<F z> [J], largest depth [m], and energy into the lever's own damping [J].
COS, SIN, MEAN, LOST, VIRIAL, DEEPEST, AIR, GIVEN = 0, 1, 2, 3, 4, 5, 6, 7
# Of the linear map of one period: the changes of z and z' and the amplitude, now, and their derivatives.
NOW, BY_Z, BY_V, BY_Z0 = 0, 1, 2, 3
AMPLITUDE = 2


class Tip(NamedTuple):
    """A tip in time.

    Attributes
    ----------
    u : ndarray, shape (4,) or longer
        State at drive phase 0.
    acc : ndarray, shape (7,)
        What the last period gave, as `march_period` has it.
    linear : ndarray, shape (4, 3)
        The change of z, that of z' and the amplitude A of a period from u, and their derivatives by z, z' and z0.
    periods : ndarray of int, shape (1,)
        How many were marched.
    """

    u: np.ndarray
    acc: np.ndarray
    linear: np.ndarray
    periods: np.ndarray


@kernel
def tip_in(u: np.ndarray) -> Tip:
    """Return a tip in this state."""
    return Tip(u, np.zeros(GIVEN), np.zeros((4, 3)), np.zeros(1, np.int64))


@kernel
def new_tip(law: Law, z: float, v: float, z0: float) -> Tip:
    """Return a tip out of contact, or as its depth says, over a surface that nothing has touched."""
    u = np.zeros(STATE if law.memory != 0 else 4)
    u[Z], u[V], u[Z0] = z, v, z0
    return tip_in(u)


@kernel
def ring_down(lever: np.ndarray) -> int:
    """Periods in which the amplitude of the free lever falls to 1/e, Q / pi at resonance; at least 1."""
    return int(lever[col.OMEGA] / (2 * math.pi * lever[col.ALPHA0])) + 1


@kernel
def amplitude_of(lever: np.ndarray, acc: np.ndarray) -> float:
    """Amplitude [m] that the detector sees in a period: of the first harmonic of z, less that of the lever's base."""
    return math.hypot(acc[COS] - lever[col.SHAKER], acc[SIN])


@kernel
def carry(u: np.ndarray, to: np.ndarray) -> None:
    """Carry over what the surface remembers, if it does."""
    for i in range(Z0 + 1, len(u)):
        to[i] = u[i]
