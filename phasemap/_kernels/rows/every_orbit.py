"""Every orbit of one amplitude or tip offset: those on the curve from far, and those to which averaged orbits lead."""

from __future__ import annotations

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.continuation.path import ENTRY_A, ENTRY_Z0, Path, Point, fixed_path
from phasemap._kernels.continuation.start import start_far
from phasemap._kernels.continuation.step import (
    FIRST_ARC_STEP,
    LONGEST_ARC_STEP,
    Place,
    Wanted,
    copy_orbit,
    find_crossing,
    mark_point,
    next_point_watching,
)
from phasemap._kernels.engagement.exact import MOST_APPROACH_POINTS
from phasemap._kernels.law import Law, Oscillator, parameters
from phasemap._kernels.lever import free_amplitude
from phasemap._kernels.orbits.averaged.orbits import averaged_orbits
from phasemap._kernels.orbits.collocation.contacts import PERMANENT
from phasemap._kernels.orbits.collocation.estimate import estimate_errors
from phasemap._kernels.orbits.collocation.newton import (
    begin_harmonic,
    linearise_and_fill_row,
    solve_at_amplitude,
)
from phasemap._kernels.orbits.collocation.polish import tolerance_of
from phasemap._kernels.orbits.collocation.system import HOLD_AMPLITUDE, head_of, new_orbit
from phasemap._kernels.records import assign, clear

MOST_ORBITS = 40
THROWN_LIFT = 0.08  # of the amplitude, by which a guess is lifted for orbits that a strong pull makes

HARDLY_MOVING = 0.03  # the curve is left where the tip hardly moves any more, relative to the setpoint
DEEPEST_REST = 300.0  # the curve is left where the lever is pressed down by so many free amplitudes


@kernel
def add_along_curve(
    path: Path, hold: int, value: float, level: int, tolerance: float, rows: np.ndarray
) -> tuple[int, int]:
    """Fill rows with the orbits of this amplitude or tip offset on the curve from far; returns a status and how many.

    The way is followed on coarser elements than the orbits have. It is left where the tip stays in contact, or hardly
    moves any more.
    """
    orbit, spare, saved = new_orbit(path.lever), new_orbit(path.lever), new_orbit(path.lever)
    index = ENTRY_A if hold == HOLD_AMPLITUDE else ENTRY_Z0
    wanted = Wanted(index, value, tolerance)
    law, p, lever, tables = path.law, path.p, path.lever, path.tables
    free = free_amplitude(lever)
    engaged = value if hold == HOLD_AMPLITUDE else 0.999 * free
    status, orbit, spare = start_far(path, orbit, spare, engaged, level - 1)
    point = Point()
    point.tangent_u = -1.0
    if status != col.GOOD or not mark_point(path, orbit, point):
        return col.NOT_CONVERGED, 0
    step, count, one = FIRST_ARC_STEP, 0, new_orbit(lever)
    for _ in range(MOST_APPROACH_POINTS):
        before = Point()
        assign(before, point)
        status, step, orbit, spare = next_point_watching(
            path, point, step, LONGEST_ARC_STEP, wanted, orbit, spare, saved
        )
        if status != col.GOOD:
            return status, count
        if (before.value[index] > value) != (point.value[index] > value):
            copy_orbit(orbit, one)
            head_of(one).level = head_of(saved).level = level
            good, one, spare = find_crossing(path, wanted, Place(before, saved), before, point, one, spare)
            if not good or count == len(rows):
                return col.NOT_CONVERGED, count
            linearise_and_fill_row(Oscillator(law, p, lever), tables, one, rows[count])
            estimate_errors(Oscillator(law, p, lever), tables, one, spare, rows[count])
            count = insert_row(rows, count)
        if point.value[ENTRY_A] < HARDLY_MOVING * (value if hold == HOLD_AMPLITUDE else free):
            return col.GOOD, count
        if head_of(orbit).contacts == PERMANENT:
            deep = (
                point.value[ENTRY_A] < 0.3 * value if hold == HOLD_AMPLITUDE else point.value[ENTRY_Z0] < value - free
            )
            if deep or point.value[ENTRY_Z0] < -DEEPEST_REST * free:
                return col.GOOD, count
    return col.NOT_CONVERGED, count


@kernel
def insert_row(rows: np.ndarray, count: int) -> int:
    """Keep row `count` if it is none of the rows before it; returns how many rows there are."""
    new = rows[count]
    for row in rows[:count]:
        apart = abs(row[col.TIP_OFFSET] - new[col.TIP_OFFSET]) + abs(row[col.AMPLITUDE] - new[col.AMPLITUDE])
        if apart < 1e-7 * new[col.AMPLITUDE] and abs(row[col.PHASE] - new[col.PHASE]) < 1e-6:
            return count
    return count + 1


@kernel
def add_from_averaged(
    path: Path, amplitude: float, guesses: np.ndarray, level: int, tolerance: float, rows: np.ndarray, count: int
) -> int:
    """Add the orbits of this amplitude to which averaged ones lead; returns how many rows there are.

    An averaged orbit of another amplitude is followed to this one, along its own piece of the curve.
    """
    law, p, lever, tables = path.law, path.p, path.lever, path.tables
    orbit, spare, saved, one = new_orbit(lever), new_orbit(lever), new_orbit(lever), new_orbit(lever)
    point, wanted = Point(), Wanted(ENTRY_A, amplitude, tolerance)
    for i in range(len(guesses)):
        guess = guesses[i]
        if count == len(rows) or not begin_harmonic(Oscillator(law, p, lever), tables, orbit, guess, level):
            continue
        status, _, orbit, spare = solve_at_amplitude(
            Oscillator(law, p, lever), tables, orbit, spare, level, tolerance, 30
        )
        if status != col.GOOD or not head_of(orbit).amplitude > 0.0:
            continue
        if guess[col.G_A] == amplitude:
            linearise_and_fill_row(Oscillator(law, p, lever), tables, orbit, rows[count])
            estimate_errors(Oscillator(law, p, lever), tables, orbit, spare, rows[count])
            count = insert_row(rows, count)
            continue
        clear(point)
        point.tangent_v = 1.0 if amplitude > guess[col.G_A] else -1.0
        if not mark_point(path, orbit, point):
            continue
        step = 0.1
        for _ in range(80):
            before = Point()
            assign(before, point)
            status, step, orbit, spare = next_point_watching(
                path, point, step, LONGEST_ARC_STEP, wanted, orbit, spare, saved
            )
            if status != col.GOOD or abs(point.value[ENTRY_A] - amplitude) > 1.5 * abs(guess[col.G_A] - amplitude):
                break
            if (before.value[ENTRY_A] > amplitude) != (point.value[ENTRY_A] > amplitude) and count < len(rows):
                copy_orbit(orbit, one)
                good, one, spare = find_crossing(path, wanted, Place(before, saved), before, point, one, spare)
                if good:
                    linearise_and_fill_row(Oscillator(law, p, lever), tables, one, rows[count])
                    estimate_errors(Oscillator(law, p, lever), tables, one, spare, rows[count])
                    count = insert_row(rows, count)
    return count


@kernel
def every_orbit(
    law: Law, row: np.ndarray, lever: np.ndarray, tables: np.ndarray, hold: int, value: float
) -> tuple[int, np.ndarray]:
    """Rows of every orbit found with this amplitude or tip offset, stable or not, far to near."""
    p = parameters(row)
    path = fixed_path(Oscillator(law, p, lever), tables)
    found = np.zeros((MOST_ORBITS, col.COLUMNS))
    level, tolerance = 1, 1e-3 * tolerance_of(Oscillator(law, p, lever))
    status, count = add_along_curve(path, hold, value, level, tolerance, found)
    if status != col.GOOD:
        status, count = add_along_curve(path, hold, value, level + 1, tolerance, found)
    if hold == HOLD_AMPLITUDE:
        for amplitude in (value, 0.97 * value, 1.03 * value, 0.88 * value, 1.12 * value):
            guesses = averaged_orbits(Oscillator(law, p, lever), amplitude)
            if amplitude == value or len(guesses) > count:
                count = add_from_averaged(path, value, guesses, level, tolerance, found, count)
        # A strong pull throws the tip out of its harmonic orbit, whose contact is then too deep to start from.
        guesses = averaged_orbits(Oscillator(law, p, lever), value)
        for i in range(len(guesses)):
            guesses[i, col.G_Z0] += THROWN_LIFT * value
        count = add_from_averaged(path, value, guesses, level, tolerance, found, count)
    return status, found[:count]
