"""What a quasi-static approach visits on the curve of exact orbits at fixed drive.

`engage` follows the curve from far (see `phasemap._kernels.engagement.averaged`), `engage_near` does so from an
amplitude at which there is no doubt. What becomes of a tip that loses its orbit is in
`phasemap._kernels.engagement.rest`.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.continuation.cubic import hermite
from phasemap._kernels.continuation.path import AP, DA, DET, DZ, FP, LENGTH, POINT, TU, TV, ZP, Path, scales
from phasemap._kernels.continuation.start import start_far
from phasemap._kernels.continuation.step import (
    FIRST_STEP,
    LARGEST_STEP,
    Place,
    advance,
    advance_watching,
    copy_orbit,
    cross,
    mark,
)
from phasemap._kernels.engagement.averaged import caution, settle_side, worst_amplitude
from phasemap._kernels.engagement.resonance import (
    ATTRACTIVE,
    FARTHEST_AT_ALL,
    Maximum,
    leaps,
    near_resonance,
    side_reached_from_far,
)
from phasemap._kernels.engagement.rest import LINGERING, land, lets_go, loosened, pressed_in
from phasemap._kernels.law import Oscillator
from phasemap._kernels.lever import bend_by_adhesion, free_amplitude, reach_of
from phasemap._kernels.orbits.averaged.orbits import averaged_orbits
from phasemap._kernels.orbits.collocation.contacts import PERMANENT
from phasemap._kernels.orbits.collocation.newton import begin, finish, newton
from phasemap._kernels.orbits.collocation.system import CONTACTS, COUNT, HOLD_AMPLITUDE, VALUE, Z0, A, Orbit, P

MOST_POINTS = 1500
PLACES = 16  # between two points where the amplitude is looked at
NEAR_END = 2e-3  # of the setpoint: nearer than this to the end of a branch, the whole curve is followed
NEAR = 0.05  # of the free amplitude, from where the tip lands to the branch on which it taps on


@kernel
def lower(
    path: Path,
    amplitude: float,
    tolerance: float,
    lingering: float,
    point: np.ndarray,
    orbit: Orbit,
    spare: Orbit,
    saved: Orbit,
    found: Orbit,
) -> tuple[int, float, Orbit, Orbit, Orbit]:
    """Follow the curve from `point` on to the orbit at which a tip that is lowered stops, returned last.

    The second value is the tip offset at which the tip leaves the curve: where its orbit is no longer stable, or the
    lowest that the curve reached. The status is NOT_SETTLED where the curve leads nowhere: a multiplier above
    `lingering` belongs to orbits that linger at an unstable equilibrium.
    """
    law, p, lever = path.law, path.p, path.lever
    step, lowest, have, highest = FIRST_STEP, 1e300, False, 10.0 * (abs(point[ZP]) + point[AP] + path.reach)
    left = math.nan
    for _ in range(MOST_POINTS):
        before = point.copy()
        status, step, orbit, spare = advance_watching(
            path, point, step, LARGEST_STEP, AP, amplitude, orbit, spare, saved
        )
        if status != col.GOOD:
            if pressed_in(Oscillator(law, p, lever), orbit):
                status = col.NO_STABLE_ORBIT
            return status, min(lowest, before[ZP]) if math.isnan(left) else left, orbit, spare, found
        z0, a = point[ZP], point[AP]
        if before[AP] > amplitude >= a and z0 < before[ZP] and not have:
            copy_orbit(orbit, found)
            have, found, spare = cross(
                path, AP, amplitude, Place(before, saved), before, point, found, spare, tolerance
            )
            if not have:
                status = col.NO_STABLE_ORBIT if pressed_in(Oscillator(law, p, lever), orbit) else col.NOT_CONVERGED
                return status, lowest if math.isnan(left) else left, orbit, spare, found
        elif a > amplitude >= before[AP] and z0 >= lowest:
            have = False  # the tip lands before that crossing
        if have and z0 < lowest:
            return col.GOOD, left, orbit, spare, found
        if math.isnan(left) and not point[FP] < 1.0 and z0 < lowest:
            left = z0
        lowest = min(lowest, z0)
        away = z0 > highest and orbit.head[COUNT, CONTACTS] == 0 and a < 2.0 * free_amplitude(lever)
        if point[FP] > lingering or away:
            return col.NOT_SETTLED, lowest if math.isnan(left) else left, orbit, spare, found
        if orbit.head[COUNT, CONTACTS] == PERMANENT and (a < 0.3 * amplitude or z0 < -FARTHEST_AT_ALL):
            break
    return col.NO_STABLE_ORBIT, lowest, orbit, spare, found


@kernel
def retract(
    path: Path,
    amplitude: float,
    tolerance: float,
    point: np.ndarray,
    orbit: Orbit,
    spare: Orbit,
    saved: Orbit,
    found: Orbit,
) -> tuple[int, Orbit, Orbit, Orbit]:
    """Follow a branch of smaller amplitude as the tip offset is raised, to the orbit that holds `amplitude`.

    Where the branch ends first the tip is pulled off and jumps across the setpoint.
    """
    law, p, lever = path.law, path.p, path.lever
    step, sudden = 0.1, lets_go(Oscillator(law, p, lever))
    for _ in range(MOST_POINTS):
        before = point.copy()
        status, step, orbit, spare = advance_watching(
            path, point, step, LARGEST_STEP, AP, amplitude, orbit, spare, saved
        )
        if status != col.GOOD:
            return col.NO_STABLE_ORBIT if sudden else col.NOT_CONVERGED, orbit, spare, found
        if before[AP] < amplitude <= point[AP]:
            copy_orbit(orbit, found)
            good, found, spare = cross(
                path, AP, amplitude, Place(before, saved), before, point, found, spare, tolerance
            )
            return col.GOOD if good else col.NOT_CONVERGED, orbit, spare, found
        if point[ZP] < before[ZP] or point[DZ] < 0.0:
            return col.NO_STABLE_ORBIT, orbit, spare, found
        if not point[FP] < 1.0:
            # A multiplier past one is a fold, past minus one it doubles the period.
            gone = point[DET] < 0.0 or point[FP] > LINGERING or p[col.LONGRANGE] == 0.0
            return col.NO_STABLE_ORBIT if gone else col.UNSTABLE, orbit, spare, found
    return col.NOT_CONVERGED, orbit, spare, found


@kernel
def only_offset(path: Path, orbit: Orbit, sense: float, point: np.ndarray) -> None:
    """Set the tangent of a point so that `mark` turns it to where the tip offset rises (sense 1) or falls (-1)."""
    of_gap, of_amplitude = scales(path, path.reach, orbit.head[VALUE, Z0], orbit.head[VALUE, A])
    point[:] = 0.0
    point[TU], point[TV] = sense, sense * of_amplitude / of_gap


@kernel
def joined(path: Path, z0: float, orbit: Orbit, spare: Orbit, saved: Orbit) -> tuple[bool, Orbit, Orbit]:
    """Whether stable orbits join this one (lost) to near the tip offset z0, the amplitude rising with the tip offset.

    Near is enough: a tip that hits a force that jumps goes through doubled periods before it comes to this branch.
    """
    lever = path.lever
    near = NEAR * free_amplitude(lever)
    point = np.zeros(POINT)
    sense = 1.0 if z0 > orbit.head[VALUE, Z0] else -1.0
    only_offset(path, orbit, sense, point)
    good, step = mark(path, orbit, point), 0.1
    for _ in range(MOST_POINTS):
        if not good or not point[FP] < 1.0 or not point[DZ] * sense > 0.0 or not point[DA] * sense > 0.0:
            return False, orbit, spare
        if (point[ZP] - z0) * sense >= -near:
            return True, orbit, spare
        status, step, orbit, spare = advance(path, point, step, LARGEST_STEP, orbit, spare, saved)
        good = status == col.GOOD
    return False, orbit, spare


@kernel
def tapping(
    path: Path,
    amplitude: float,
    z0: float,
    level: int,
    tolerance: float,
    orbit: Orbit,
    spare: Orbit,
    saved: Orbit,
    found: Orbit,
) -> tuple[bool, Orbit, Orbit, Orbit]:
    """Find the repulsive orbit of this amplitude on the branch on which a tip lands that taps on at z0, if any."""
    law, p, lever, tables = path.law, path.p, path.lever, path.tables
    target = np.zeros(4)
    guesses = averaged_orbits(Oscillator(law, p, lever), amplitude)
    for i in range(len(guesses)):  # a row of its own type, were it iterated over
        guess = guesses[i]
        if guess[col.G_P] <= 0.0 or not begin(Oscillator(law, p, lever), tables, orbit, guess, level):
            continue
        status, _, orbit, spare = newton(
            Oscillator(law, p, lever), tables, orbit, spare, HOLD_AMPLITUDE, target, level, tolerance, 20
        )
        if status != col.GOOD or not orbit.head[VALUE, P] > 0.0:
            continue
        copy_orbit(orbit, found)
        good, orbit, spare = joined(path, z0, orbit, spare, saved)
        if good:
            return True, orbit, spare, found
    return False, orbit, spare, found


@kernel
def engage_landed(
    path: Path,
    amplitude: float,
    z0: float,
    level: int,
    tolerance: float,
    orbit: Orbit,
    spare: Orbit,
    saved: Orbit,
    found: Orbit,
) -> tuple[int, Orbit, Orbit, Orbit]:
    """`engage` from the orbit on which the tip lands at `z0`, lowered further or retracted to the setpoint."""
    law, p, lever, tables = path.law, path.p, path.lever, path.tables
    good, orbit, spare = land(Oscillator(law, p, lever), tables, z0, level, orbit, spare)
    if not good:
        good, orbit, spare, found = tapping(path, amplitude, z0, level, tolerance, orbit, spare, saved, found)
        return col.GOOD if good else col.NOT_CONVERGED, orbit, spare, found
    down, point = orbit.head[VALUE, A] > amplitude, np.zeros(POINT)
    if not down:
        z0 = loosened(Oscillator(law, p, lever), z0, amplitude)
        good, orbit, spare = land(Oscillator(law, p, lever), tables, z0, level, orbit, spare)
        if not good:
            return col.NOT_CONVERGED, orbit, spare, found
    only_offset(path, orbit, -1.0 if down else 1.0, point)
    if not mark(path, orbit, point):
        return col.NOT_CONVERGED, orbit, spare, found
    if not down:
        status, orbit, spare, found = retract(path, amplitude, tolerance, point, orbit, spare, saved, found)
        # Above resonance contact brings the lever nearer to it: the tip may as well have landed on a large oscillation.
        if status == col.NO_STABLE_ORBIT and lever[col.OMEGA] > 1.0:
            status = col.NOT_CONVERGED
        return status, orbit, spare, found
    status, _, orbit, spare, found = lower(path, amplitude, tolerance, LINGERING, point, orbit, spare, saved, found)
    return col.NOT_CONVERGED if status == col.NOT_SETTLED else status, orbit, spare, found


@kernel
def engage(
    path: Path,
    amplitude: float,
    level: int,
    tolerance: float,
    lingering: float,
    orbit: Orbit,
    spare: Orbit,
    saved: Orbit,
    found: Orbit,
) -> tuple[int, Orbit, Orbit, Orbit]:
    """Approach from far along exact orbits to the one that holds `amplitude`; it is returned last.

    Where the curve's multiplier passes `lingering` the tip is taken to land elsewhere; NOT_SETTLED if it is not
    known where.
    """
    law, p, lever = path.law, path.p, path.lever
    status, orbit, spare = start_far(path, orbit, spare, amplitude, level)
    if status != col.GOOD:
        return status, orbit, spare, found
    point = np.zeros(POINT)
    point[TU] = -1.0
    if not mark(path, orbit, point):
        return col.NOT_CONVERGED, orbit, spare, found
    status, left, orbit, spare, found = lower(path, amplitude, tolerance, lingering, point, orbit, spare, saved, found)
    # A curve that ends where the tip touches a force that jumps: no orbit touches it only a little.
    grazing = p[col.RELEASE] != 0.0 or (p[col.LONGRANGE] == 0.0 and bend_by_adhesion(Oscillator(law, p, lever)) > 0.0)
    if status == col.NOT_SETTLED or (status == col.NOT_CONVERGED and (grazing or level > 0)):
        done, orbit, spare, found = engage_landed(path, amplitude, left, level, tolerance, orbit, spare, saved, found)
        return status if done == col.NOT_CONVERGED else done, orbit, spare, found
    return status, orbit, spare, found


@kernel
def lowest_between(before: np.ndarray, point: np.ndarray) -> float:
    """Least amplitude between two points of the curve, by the cubic through both and their slopes."""
    length, lowest = point[LENGTH], min(before[AP], point[AP])
    for i in range(1, PLACES):
        lowest = min(lowest, hermite(before[AP], length * before[DA], point[AP], length * point[DA], i / PLACES))
    return lowest


@kernel
def engage_near(
    path: Path, amplitude: float, tolerance: float, orbit: Orbit, spare: Orbit, saved: Orbit, found: Orbit
) -> tuple[int, Orbit, Orbit, Orbit]:
    """`engage` near the end of the attractive branch, without the way from far.

    At an amplitude nearer to the free one the attractive branch is reached for certain. From there exact orbits are
    followed down to the setpoint; if the branch ends before, the tip jumps to the farthest repulsive orbit that can be
    held. NOT_CONVERGED leaves the question to `engage`.
    """
    law, p, lever, tables = path.law, path.p, path.lever, path.tables
    if p[col.LONGRANGE] == 0.0 or p[col.RELEASE] != 0.0:
        return col.NOT_CONVERGED, orbit, spare, found
    free, guess, top, target = free_amplitude(lever), np.zeros(col.GUESS), Maximum(), np.zeros(4)
    worst, force_reach, certain = worst_amplitude(lever, amplitude), reach_of(law, p), False
    if not near_resonance(lever) or leaps(lever, force_reach, free):
        return col.NOT_CONVERGED, orbit, spare, found
    for share in (0.3, 0.7):
        higher = worst + share * (free - worst)
        side = side_reached_from_far(Oscillator(law, p, lever), force_reach, higher, free, caution(lever), top)
        certain = side == ATTRACTIVE and settle_side(Oscillator(law, p, lever), force_reach, higher, side, top, guess)
        if certain:
            break
    if not certain or not begin(Oscillator(law, p, lever), tables, orbit, guess, 0):
        return col.NOT_CONVERGED, orbit, spare, found
    status, _, orbit, spare = newton(
        Oscillator(law, p, lever), tables, orbit, spare, HOLD_AMPLITUDE, target, 0, tolerance, 12
    )
    point = np.zeros(POINT)
    point[TV] = -1.0
    if status != col.GOOD or not mark(path, orbit, point):
        return col.NOT_CONVERGED, orbit, spare, found
    if not (point[FP] < 1.0 and point[DZ] < 0.0 and orbit.head[VALUE, P] < 0.0):
        return col.NOT_CONVERGED, orbit, spare, found
    step, ended = FIRST_STEP, False
    while not ended:
        before = point.copy()
        status, step, orbit, spare = advance_watching(
            path, point, step, LARGEST_STEP, AP, amplitude, orbit, spare, saved
        )
        if status != col.GOOD:
            return col.NOT_CONVERGED, orbit, spare, found
        ended = point[AP] > before[AP] or point[ZP] > before[ZP]
        crossed = before[AP] > amplitude >= point[AP]
        # The cubic is off by less than it dips.
        lowest = 2.0 * lowest_between(before, point) - min(before[AP], point[AP])
        if ended and (crossed or lowest < (1.0 + NEAR_END) * amplitude):
            return col.NOT_CONVERGED, orbit, spare, found  # which comes first takes smaller steps to tell
        if crossed:
            copy_orbit(orbit, found)
            good, found, spare = cross(
                path, AP, amplitude, Place(before, saved), before, point, found, spare, tolerance
            )
            return col.GOOD if good else col.NOT_CONVERGED, orbit, spare, found
    row = np.zeros(col.COLUMNS)
    guesses = averaged_orbits(Oscillator(law, p, lever), amplitude)
    for i in range(len(guesses)):  # a row of its own type, were it iterated over
        guess = guesses[i]
        if guess[col.G_P] <= 0.0 or not begin(Oscillator(law, p, lever), tables, found, guess, 0):
            continue
        status, _, found, spare = newton(
            Oscillator(law, p, lever), tables, found, spare, HOLD_AMPLITUDE, target, 0, tolerance, 12
        )
        if status == col.GOOD and finish(Oscillator(law, p, lever), tables, found, row) == col.GOOD:
            if row[col.FLOQUET] < 1.0 and row[col.SLOPE] > 0.0 and row[col.STIFFENING] > 0.0:
                return col.GOOD, orbit, spare, found
    return col.NOT_CONVERGED, orbit, spare, found
