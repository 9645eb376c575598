"""Cubic interpolation between two points of a curve: where a coordinate passes a value, or turns."""

from __future__ import annotations

from phasemap._kernels.compilation import kernel
from phasemap._kernels.continuation.point import (
    ENTRY_A,
    ENTRY_M,
    ENTRY_Z0,
    Point,
    answer_entry,
    axis_scales,
    control_entry,
    tangent_row,
)
from phasemap._kernels.numerics import newton_in_bracket
from phasemap._kernels.orbits.collocation.path import Path

AT_FOLD = 3e-3  # change of the control over its scale, per step of one
MOST_LENGTH_STEPS, LENGTH_ERROR = 30, 1e-12  # of Newton's method for a place on a cubic, and its last step


@kernel
def cubic_slopes(path: Path, reach: float, before: Point, after: Point) -> tuple[float, float]:
    """Factors of the derivatives at two points that make them slopes of the cubics from one (0) to the other (1).

    The parameter of the cubics is the distance from the plane across the curve at the first point: the arclength is not
    the same in the scaled coordinates of both points. See theory, Eq. (continuation-4).
    """
    r_z, r_a, r_m = tangent_row(path, reach, before)
    length = (
        r_z * (after.value[ENTRY_Z0] - before.value[ENTRY_Z0])
        + r_a * (after.value[ENTRY_A] - before.value[ENTRY_A])
        + r_m * (after.value[ENTRY_M] - before.value[ENTRY_M])
    )
    first = r_z * before.rate[ENTRY_Z0] + r_a * before.rate[ENTRY_A] + r_m * before.rate[ENTRY_M]
    last = r_z * after.rate[ENTRY_Z0] + r_a * after.rate[ENTRY_A] + r_m * after.rate[ENTRY_M]
    return length / first, length / max(last, 0.5 * first)


@kernel(light=True)
def cubic_terms(first: float, last: float, rise: float) -> tuple[float, float]:
    """Coefficients of t^3 and t^2 in a cubic that rises by `rise`, from slope `first` at 0 to `last` at t = 1."""
    return first + last - 2.0 * rise, 3.0 * rise - 2.0 * first - last


@kernel
def turns_twice_between(path: Path, reach: float, before: Point, point: Point) -> bool:
    """True if a coordinate turns twice between two points: its cubic has both extremes there, and runs back for long.

    Nothing else would reveal a pair of folds within one step.
    """
    by_one, by_two = cubic_slopes(path, reach, before, point)
    u, v = axis_scales(path, reach, point.value[ENTRY_Z0], point.value[ENTRY_A])
    for index, scale in ((control_entry(path), u), (answer_entry(path), v)):
        first, last, rise = (
            by_one * before.rate[index],
            by_two * point.rate[index],
            point.value[index] - before.value[index],
        )
        cubic, square = cubic_terms(first, last, rise)
        # The slope has its own extreme at t = -square / 3 cubic.
        if first * last > 0.0 and cubic * first > 0.0 and 0.0 < -square / (3.0 * cubic) < 1.0:
            if (square * square / (3.0 * cubic) - first) * first > AT_FOLD * scale * abs(by_one * first):
                return True
    return False


@kernel
def hermite(x0: float, slope0: float, x1: float, slope1: float, t: float) -> float:
    """Value at t of the cubic from `x0` with slope `slope0` at t = 0 to `x1` with slope `slope1` at t = 1."""
    cubic, square = cubic_terms(slope0, slope1, x1 - x0)
    return x0 + t * (slope0 + t * (square + t * cubic))


@kernel
def place_on_cubic(x0: float, slope0: float, x1: float, slope1: float, value: float) -> float:
    """Parameter t in 0 ... 1 at which the cubic of `hermite` passes a value between `x0` and `x1`."""
    low, high, t = 0.0, 1.0, (value - x0) / (x1 - x0)
    cubic, square = cubic_terms(slope0, slope1, x1 - x0)
    for _ in range(MOST_LENGTH_STEPS):
        x, slope = hermite(x0, slope0, x1, slope1, t) - value, slope0 + t * (2.0 * square + 3.0 * t * cubic)
        if abs(x) < LENGTH_ERROR * abs(slope):
            break
        t, low, high = newton_in_bracket(t, x, slope, low, high, x1 > x0)
    return t
