"""A tip in time: its state where periods begin, what one gives, and how the next one changes with the state.

From the linear map of a period about a motion follow its ways to rest, the slopes of the periodic orbit, and the
largest multiplier: theory, Eqs. (time-3) and (time-4).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.excitation import detected_amplitude
from phasemap._kernels.lever_modes import modes_of, slowest_decay, static_share
from phasemap._kernels.numerics import MOST_SQUARINGS, solve_equations, spectral_radius
from phasemap._kernels.orbits.time.modes import harmonic_of_mode
from phasemap._kernels.orbits.time.surface_memory import CONTACT_MODE, PERIOD_BEGIN, memory_size
from phasemap._kernels.records import column, numbers_of, record

if TYPE_CHECKING:
    from phasemap._kernels.law import Law

# Entries of a state. It goes on with displacement and velocity of each mode above the first, and over a surface that
# remembers with what `surface_memory` names.
Z = 0  # [m]
V = 1  # z' [m]
TOUCHES = 2  # 1 in contact or in the neck, WITHDRAWING where that attracts more than on the way in, else 0
WITHDRAWING = 2.0
Z0 = 3  # tip offset [m]
PLAIN_STATE = 4  # entries of a state of one mode over surfaces that remember nothing
MOST_COORDINATES = 2 * col.MOST_MODES  # z, z' and those of the higher modes


@record
class PeriodResult:
    """Observables of one period, or their means over many."""

    cos: float  # cosine and sine part of the first harmonic of z [m]
    sin: float
    mean_z: float  # of z [m]
    loss: float  # energy into the surface [J]
    virial: float  # -<F z> [J]
    air: float  # energy into the lever's own damping [J]
    deepest: float  # largest depth [m]
    second_cos: float  # cosine and sine part of the second mode's displacement with the phase of a second drive [m]
    second_sin: float


@record
class Change:
    """Change in one period of the coordinates (z, z', those of higher modes), and its amplitude [m]; or derivatives."""

    amplitude: float
    motion: np.ndarray = column(MOST_COORDINATES)


@record
class PeriodMap:
    """Map of one period: the changes in it, and their derivatives by the coordinates and z0."""

    count: int  # of coordinates
    now: Change
    by_z0: Change
    amplitude: np.ndarray = column(MOST_COORDINATES)  # its derivatives by each coordinate
    motion: np.ndarray = column(MOST_COORDINATES**2)  # of all changes, those by the first coordinate first


@record
class Way:
    """A displacement [m] of the state at the begin of a period: of the tip offset and of the motion's coordinates."""

    z0: float
    motion: np.ndarray = column(MOST_COORDINATES)


@record
class Periods:
    """Counts of a tip's periods."""

    marched: int
    formed: int  # 1 when lasting dents have formed under it


class MovingTip(NamedTuple):
    """State of a tip in time, with its last period and the map of a period."""

    # State at the beginning of a period, shape (PLAIN_STATE + 2 (modes - 1),): at drive phase 0. Over a surface that
    # remembers it has the length `memory_size`, and a period begins where `swing_state` puts it.
    u: np.ndarray
    acc: PeriodResult  # of the last period
    linear: PeriodMap  # of a period from u
    periods: Periods


@kernel(light=True)
def coordinate_count(lever: np.ndarray) -> int:
    """Number of coordinates of the lever's motion: two for each mode."""
    return 2 * modes_of(lever)


@kernel(light=True)
def motion_size(lever: np.ndarray) -> int:
    """Number of entries of a state that are not memory of the surface."""
    return PLAIN_STATE - 2 + coordinate_count(lever)


@kernel(light=True)
def entry_of(i: int) -> int:
    """Index of coordinate i in a state."""
    return i if i < 2 else PLAIN_STATE - 2 + i


@kernel(light=True)
def fill_higher_modes(lever: np.ndarray, mean: float, u: np.ndarray) -> None:
    """Fill the modes above the first in a state of harmonic motion about `mean`, where its periods begin."""
    begin = u[PERIOD_BEGIN] if len(u) > PERIOD_BEGIN else 0.0
    turned = complex(math.cos(begin), math.sin(begin))
    tip = complex(u[Z] - mean, -u[V] / lever[col.OMEGA]) * turned.conjugate()
    for i in range(1, modes_of(lever)):
        phasor = harmonic_of_mode(lever, i, tip) * turned
        u[entry_of(2 * i)] = mean * static_share(lever, i) + phasor.real
        u[entry_of(2 * i + 1)] = -lever[col.OMEGA] * phasor.imag


@kernel(light=True)
def swing_state(lever: np.ndarray, mean: float, z: float, v: float, u: np.ndarray) -> None:
    """Fill a state at u[Z0] with a harmonic motion about `mean`, with (z, v) at drive phase 0.

    Over a surface that remembers a period begins where such a tip is farthest from it: there a tap is not cut in two,
    and what the surface has to remember is least. Where the tip never leaves, that is least where it is deepest and
    the contact is widest, and a period begins there.
    """
    u[Z], u[V] = z, v
    if len(u) > PERIOD_BEGIN:
        across, along = z - mean, v / lever[col.OMEGA]
        size, leaves = math.hypot(across, along), mean - math.hypot(across, along) < u[Z0]
        u[Z], u[V] = mean - size if leaves else mean + size, 0.0
        u[PERIOD_BEGIN] = math.atan2(along, across) + (math.pi if leaves else 0.0)
    fill_higher_modes(lever, mean, u)


@kernel
def new_state(law: Law, lever: np.ndarray, mean: float, z: float, v: float, z0: float) -> np.ndarray:
    """Return a state as `swing_state` has it, over a surface that nothing has touched."""
    u = np.zeros(memory_size(law.arms) if law.memory != 0 else motion_size(lever))
    u[Z0] = z0
    swing_state(lever, mean, z, v, u)
    return u


@kernel
def ring_down_periods(lever: np.ndarray) -> int:
    """Whole periods in which the amplitude falls to 1/e, for the free lever Q / pi at resonance; at least 1."""
    return int(lever[col.OMEGA] / (2 * math.pi * slowest_decay(lever))) + 1


@kernel
def amplitude_of(lever: np.ndarray, acc: PeriodResult) -> float:
    """Amplitude [m] that the detector sees in a period: of the first harmonic of z, less that of the lever's base."""
    return detected_amplitude(lever, acc.sin, acc.cos)


@kernel
def add_period(total: PeriodResult, period: PeriodResult) -> None:
    """Add the observables of a period to a total, whose depth is the largest."""
    deepest, sums, numbers = max(total.deepest, period.deepest), numbers_of(total), numbers_of(period)
    for j in range(len(sums)):
        sums[j] += numbers[j]
    total.deepest = deepest


@kernel
def divide_result(total: PeriodResult, count: float) -> None:
    """Turn a total over so many periods into means."""
    deepest, numbers = total.deepest, numbers_of(total)
    for j in range(len(numbers)):
        numbers[j] /= count
    total.deepest = deepest


@kernel
def copy_memory(u: np.ndarray, to: np.ndarray) -> None:
    """Copy what the surface remembers, if it does, from one state to another."""
    if len(u) > PERIOD_BEGIN:
        for i in range(CONTACT_MODE, len(u)):
            to[i] = u[i]


@kernel
def copy_state(u: np.ndarray, to: np.ndarray) -> None:
    """Copy the first entries of a state to a row of `motion_size` entries."""
    for i in range(len(to)):
        to[i] = u[i]


@kernel
def move_state(lever: np.ndarray, way: Way, share: float, u: np.ndarray) -> None:
    """Move a state by a share of a way."""
    for i in range(coordinate_count(lever)):
        u[entry_of(i)] += share * way.motion[i]
    u[Z0] += share * way.z0


@kernel
def motion_scale(lever: np.ndarray, u: np.ndarray) -> float:
    """Size [m] of a motion: of z and z', and the drive."""
    return math.hypot(u[Z], u[V]) + float(lever[col.DRIVE])


@kernel
def differentiate(beside: Change, now: Change, size: float) -> None:
    """Turn the change in a period that begins `size` beside a motion into a difference quotient."""
    for i in range(len(beside.motion)):
        beside.motion[i] = (beside.motion[i] - now.motion[i]) / size
    beside.amplitude = (beside.amplitude - now.amplitude) / size


@kernel
def fill_way_of_decay(linear: PeriodMap, change: np.ndarray, way: np.ndarray) -> None:
    """Fill in the way to rest of a motion that changes by r in a period: r + P' r + P' P' r + ... = (1 - P')^-1 r."""
    n = linear.count
    m = np.empty((n, n + 1))
    for i in range(n):
        for j in range(n):
            m[i, j] = -linear.motion[n * j + i]
        m[i, n] = change[i]
    solved = solve_equations(m)
    for i in range(n):
        way[i] = m[i, n] if solved else math.nan


@kernel
def amplitude_along(linear: PeriodMap, way: np.ndarray) -> float:
    """Change of the amplitude [m] along a way of the coordinates."""
    total = 0.0
    for i in range(linear.count):
        total += linear.amplitude[i] * way[i]
    return total


@kernel
def slopes_of_orbit(linear: PeriodMap, slopes: Way) -> float:
    """Fill in the derivatives of the periodic orbit by z0; returns dA/dz0 after the transient."""
    slopes.z0 = 1.0
    fill_way_of_decay(linear, linear.by_z0.motion, slopes.motion)
    return linear.by_z0.amplitude + amplitude_along(linear, slopes.motion)


@kernel
def amplitude_slope(linear: PeriodMap) -> float:
    """dA/dz0 after the transient."""
    return slopes_of_orbit(linear, Way())


@kernel
def floquet_multiplier(linear: PeriodMap) -> float:
    """Largest modulus of the Floquet multipliers, the eigenvalues of P'."""
    n = linear.count
    m = np.empty((n, n))
    for i in range(n):
        for j in range(n):
            m[i, j] = linear.motion[n * j + i] + (1.0 if i == j else 0.0)
    return spectral_radius(m, MOST_SQUARINGS)


@kernel
def fill_way_to_rest(linear: PeriodMap, now: Change, target: float, way: Way) -> None:
    """Fill in the way to the periodic orbit at this z0, or of an amplitude `target` > 0, at the z0 expected for it."""
    fill_way_of_decay(linear, now.motion, way.motion)
    way.z0 = 0.0
    if target > 0.0:
        slopes = Way()
        slope = slopes_of_orbit(linear, slopes)
        way.z0 = -(now.amplitude - target + amplitude_along(linear, way.motion)) / slope
        for i in range(linear.count):
            way.motion[i] += slopes.motion[i] * way.z0


@kernel
def length_of(way: Way) -> float:
    """Length [m] of a displacement of the tip's state at the begin of a period, but for the tip offset."""
    total = 0.0
    for i in range(len(way.motion)):
        total += way.motion[i] * way.motion[i]
    return math.sqrt(total)
