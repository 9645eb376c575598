"""A tip in time: its state where periods begin, what one gives, and how the next one changes with the state."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.orbits.time.elements import BEGIN, STATE

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
# Of the periods of a tip.
MARCHED, PATTERN, FORMED = 0, 1, 2


class Tip(NamedTuple):
    """A tip in time.

    Attributes
    ----------
    u : ndarray, shape (4,) or longer
        State at the beginning of a period: at drive phase 0, or over a surface that remembers where `swing` puts it.
    acc : ndarray, shape (7,)
        What the last period gave, as `march_period` has it.
    linear : ndarray, shape (4, 3)
        The change of z, that of z' and the amplitude A of a period from u, and their derivatives by z, z' and z0.
    periods : ndarray of int, shape (3,)
        How many were marched, after how many the motion is taken to repeat itself, and whether lasting dents have
        formed under it.
    """

    u: np.ndarray
    acc: np.ndarray
    linear: np.ndarray
    periods: np.ndarray


@kernel
def tip_in(u: np.ndarray) -> Tip:
    """Return a tip in this state, none of whose periods was marched."""
    tip = Tip(u, np.zeros(GIVEN), np.zeros((4, 3)), np.ones(3, np.int64))
    tip.periods[MARCHED] = tip.periods[FORMED] = 0
    return tip


@kernel(light=True)
def swing(lever: np.ndarray, mean: float, z: float, v: float, u: np.ndarray) -> None:
    """Fill a state at u[Z0] with a harmonic motion about `mean`, with (z, v) at drive phase 0.

    Over a surface that remembers a period begins where such a tip is farthest from it: there a tap is not cut in two,
    and what the surface has to remember is least. Where the tip never leaves, that is least where it is deepest and
    the contact is widest, and a period begins there.
    """
    u[Z], u[V] = z, v
    if len(u) > BEGIN:
        across, along = z - mean, v / lever[col.OMEGA]
        size, leaves = math.hypot(across, along), mean - math.hypot(across, along) < u[Z0]
        u[Z], u[V] = mean - size if leaves else mean + size, 0.0
        u[BEGIN] = math.atan2(along, across) + (math.pi if leaves else 0.0)


@kernel
def new_tip(law: Law, lever: np.ndarray, mean: float, z: float, v: float, z0: float) -> Tip:
    """Return a tip as `swing` has it, out of contact or as its depth says, over a surface that nothing has touched."""
    u = np.zeros(STATE if law.memory != 0 else 4)
    u[Z0] = z0
    swing(lever, mean, z, v, u)
    return tip_in(u)


@kernel
def ringing(lever: np.ndarray) -> float:
    """Periods in which what disturbs a motion falls to 1/e: for the free lever, or as a longer lever says."""
    if len(lever) > col.RINGING:
        return float(lever[col.RINGING])
    return float(lever[col.OMEGA] / (2 * math.pi * lever[col.ALPHA0]))


@kernel
def ring_down(lever: np.ndarray) -> int:
    """Whole periods in which the amplitude falls to 1/e, for the free lever Q / pi at resonance; at least 1."""
    return int(ringing(lever)) + 1


@kernel
def amplitude_of(lever: np.ndarray, acc: np.ndarray) -> float:
    """Amplitude [m] that the detector sees in a period: of the first harmonic of z, less that of the lever's base."""
    return math.hypot(acc[COS] - lever[col.SHAKER], acc[SIN])


@kernel
def carry(u: np.ndarray, to: np.ndarray) -> None:
    """Carry over what the surface remembers, if it does."""
    for i in range(Z0 + 1, len(u)):
        to[i] = u[i]
