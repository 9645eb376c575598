"""Every orbit of one amplitude or tip offset: those on the curve from far, and those to which averaged orbits lead."""

from __future__ import annotations

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.continuation.path import AP, POINT, TU, TV, ZP, Path, fixed
from phasemap._kernels.continuation.start import start_far
from phasemap._kernels.continuation.step import (
    FIRST_STEP,
    LONGEST_STEP,
    Place,
    advance_watching,
    copy_orbit,
    cross,
    mark,
)
from phasemap._kernels.engagement.exact import MOST_POINTS
from phasemap._kernels.law import Law, Oscillator, parameters
from phasemap._kernels.lever import free_amplitude
from phasemap._kernels.orbits.averaged.orbits import averaged_orbits
from phasemap._kernels.orbits.collocation.contacts import PERMANENT
from phasemap._kernels.orbits.collocation.estimate import state_errors
from phasemap._kernels.orbits.collocation.newton import begin, finish, newton
from phasemap._kernels.orbits.collocation.polish import tolerance_of
from phasemap._kernels.orbits.collocation.system import CONTACTS, COUNT, HOLD_AMPLITUDE, LEVEL, VALUE, A, new_orbit

MOST_ORBITS = 40
THROWN = 0.08  # of the amplitude, by which a guess is lifted for orbits that a strong pull makes

CAUGHT = 0.03  # the curve is left where the tip hardly moves any more, relative to the setpoint
FARTHEST = 300.0  # the curve is left where the lever is pressed down by so many free amplitudes


@kernel
def collect(path: Path, hold: int, value: float, level: int, tolerance: float, rows: np.ndarray) -> tuple[int, int]:
    """Fill rows with the orbits of this amplitude or tip offset on the curve from far; returns a status and how many.

    The way is followed on coarser elements than the orbits have. It is left where the tip stays in contact, or hardly
    moves any more.
    """
    orbit, spare, saved = new_orbit(), new_orbit(), new_orbit()
    index = AP if hold == HOLD_AMPLITUDE else ZP
    law, p, lever, tables = path.law, path.p, path.lever, path.tables
    free = free_amplitude(lever)
    engaged = value if hold == HOLD_AMPLITUDE else 0.999 * free
    status, orbit, spare = start_far(path, orbit, spare, engaged, level - 1)
    point = np.zeros(POINT)
    point[TU] = -1.0
    if status != col.GOOD or not mark(path, orbit, point):
        return col.NOT_CONVERGED, 0
    step, count, one = FIRST_STEP, 0, new_orbit()
    for _ in range(MOST_POINTS):
        before = point.copy()
        status, step, orbit, spare = advance_watching(
            path, point, step, LONGEST_STEP, index, value, orbit, spare, saved
        )
        if status != col.GOOD:
            return status, count
        if (before[index] > value) != (point[index] > value):
            copy_orbit(orbit, one)
            one.head[COUNT, LEVEL] = saved.head[COUNT, LEVEL] = level
            good, one, spare = cross(path, index, value, Place(before, saved), before, point, one, spare, tolerance)
            if not good or count == len(rows):
                return col.NOT_CONVERGED, count
            finish(Oscillator(law, p, lever), tables, one, rows[count])
            state_errors(Oscillator(law, p, lever), tables, one, spare, rows[count])
            count = insert(rows, count)
        if point[AP] < CAUGHT * (value if hold == HOLD_AMPLITUDE else free):
            return col.GOOD, count
        if orbit.head[COUNT, CONTACTS] == PERMANENT:
            deep = point[AP] < 0.3 * value if hold == HOLD_AMPLITUDE else point[ZP] < value - free
            if deep or point[ZP] < -FARTHEST * free:
                return col.GOOD, count
    return col.NOT_CONVERGED, count


@kernel
def insert(rows: np.ndarray, count: int) -> int:
    """Keep row `count` if it is none of the rows before it; returns how many rows there are."""
    new = rows[count]
    for row in rows[:count]:
        apart = abs(row[col.TIP_OFFSET] - new[col.TIP_OFFSET]) + abs(row[col.AMPLITUDE] - new[col.AMPLITUDE])
        if apart < 1e-7 * new[col.AMPLITUDE] and abs(row[col.PHASE] - new[col.PHASE]) < 1e-6:
            return count
    return count + 1


@kernel
def seed(
    path: Path, amplitude: float, guesses: np.ndarray, level: int, tolerance: float, rows: np.ndarray, count: int
) -> int:
    """Add the orbits of this amplitude to which averaged ones lead; returns how many rows there are.

    An averaged orbit of another amplitude is followed to this one, along its own piece of the curve.
    """
    law, p, lever, tables = path.law, path.p, path.lever, path.tables
    orbit, spare, saved, one = new_orbit(), new_orbit(), new_orbit(), new_orbit()
    target, point = np.zeros(4), np.zeros(POINT)
    for i in range(len(guesses)):
        guess = guesses[i]
        if count == len(rows) or not begin(Oscillator(law, p, lever), tables, orbit, guess, level):
            continue
        status, _, orbit, spare = newton(
            Oscillator(law, p, lever), tables, orbit, spare, HOLD_AMPLITUDE, target, level, tolerance, 30
        )
        if status != col.GOOD or not orbit.head[VALUE, A] > 0.0:
            continue
        if guess[col.G_A] == amplitude:
            finish(Oscillator(law, p, lever), tables, orbit, rows[count])
            state_errors(Oscillator(law, p, lever), tables, orbit, spare, rows[count])
            count = insert(rows, count)
            continue
        point[:] = 0.0
        point[TV] = 1.0 if amplitude > guess[col.G_A] else -1.0
        if not mark(path, orbit, point):
            continue
        step = 0.1
        for _ in range(80):
            before = point.copy()
            status, step, orbit, spare = advance_watching(
                path, point, step, LONGEST_STEP, AP, amplitude, orbit, spare, saved
            )
            if status != col.GOOD or abs(point[AP] - amplitude) > 1.5 * abs(guess[col.G_A] - amplitude):
                break
            if (before[AP] > amplitude) != (point[AP] > amplitude) and count < len(rows):
                copy_orbit(orbit, one)
                good, one, spare = cross(
                    path, AP, amplitude, Place(before, saved), before, point, one, spare, tolerance
                )
                if good:
                    finish(Oscillator(law, p, lever), tables, one, rows[count])
                    state_errors(Oscillator(law, p, lever), tables, one, spare, rows[count])
                    count = insert(rows, count)
    return count


@kernel
def every_orbit(
    law: Law, row: np.ndarray, lever: np.ndarray, tables: np.ndarray, hold: int, value: float
) -> tuple[int, np.ndarray]:
    """Rows of every orbit found with this amplitude or tip offset, stable or not, far to near."""
    p = parameters(row)
    path = fixed(Oscillator(law, p, lever), tables)
    found = np.zeros((MOST_ORBITS, col.COLUMNS))
    level, tolerance = 1, 1e-3 * tolerance_of(Oscillator(law, p, lever))
    status, count = collect(path, hold, value, level, tolerance, found)
    if status != col.GOOD:
        status, count = collect(path, hold, value, level + 1, tolerance, found)
    if hold == HOLD_AMPLITUDE:
        for amplitude in (value, 0.97 * value, 1.03 * value, 0.88 * value, 1.12 * value):
            guesses = averaged_orbits(Oscillator(law, p, lever), amplitude)
            if amplitude == value or len(guesses) > count:
                count = seed(path, value, guesses, level, tolerance, found, count)
        # A strong pull throws the tip out of its harmonic orbit, whose contact is then too deep to start from.
        guesses = averaged_orbits(Oscillator(law, p, lever), value)
        for i in range(len(guesses)):
            guesses[i, col.G_Z0] += THROWN * value
        count = seed(path, value, guesses, level, tolerance, found, count)
    return status, found[:count]
