"""What a result row says of its orbit."""

from __future__ import annotations

import math

import numpy as np
import pytest

from phasemap._kernels import columns as col
from phasemap._kernels.orbits.result_row import feedback_status, has_periodic_orbit

STABLE, RISING = 0.9, 0.8  # largest multiplier, and change of the amplitude with the tip offset


@pytest.mark.parametrize(
    ("floquet", "slope", "status"),
    [
        (STABLE, RISING, col.GOOD),
        (1.0, RISING, col.UNSTABLE),
        (math.nan, RISING, col.UNSTABLE),
        (STABLE, -RISING, col.NO_STABLE_ORBIT),  # the feedback would drive the tip away
        (STABLE, math.nan, col.NO_STABLE_ORBIT),
    ],
)
def test_a_feedback_holds_an_orbit_that_is_stable_and_swings_less_the_nearer_the_tip(
    floquet: float, slope: float, status: int
) -> None:
    row = np.zeros(col.COLUMNS)
    row[col.FLOQUET], row[col.SLOPE] = floquet, slope
    assert feedback_status.py_func(row) == status


def test_motion_that_scatters_or_is_not_known_has_no_periodic_orbit() -> None:
    row = np.zeros(col.COLUMNS)
    row[col.AMPLITUDE] = 1e-8
    assert has_periodic_orbit.py_func(row)
    for column, value in ((col.SPREAD_AMPLITUDE, 1e-11), (col.INDENTATION, math.nan), (col.AMPLITUDE, 0.0)):
        other = row.copy()
        other[column] = value
        assert not has_periodic_orbit.py_func(other)
