"""The motion with which Newton's method begins where a contact throws the lever back."""

from __future__ import annotations

import numpy as np
import pytest

from phasemap._kernels.orbits.collocation.impact import after_kick
from phasemap.experiment.lever import one_mode


@pytest.mark.parametrize(("omega", "quality_factor"), [(1.0, 2.0), (0.9, 4.0), (1.08, 15.0)])
def test_after_a_kick_the_lever_moves_as_the_sum_of_its_harmonics(omega: float, quality_factor: float) -> None:
    # A kick with first harmonic one is 1/2 + cos + cos 2 theta + ...; what the sum leaves out is below 1/N of w' times
    # 1/sin(theta/2) at these angles, and 1/N^2 of w.
    lever, n = one_mode(omega, 0.5 / quality_factor, 1.0, 1.0), np.arange(2, 20000)
    answer = -1.0 / (1.0 - (n * omega) ** 2 + 1j * n * omega / quality_factor)
    for angle in (0.3, 1.7, 4.0, 6.0):
        w, slope = after_kick(lever, angle)
        turning = answer * np.exp(1j * n * angle)
        assert w == pytest.approx(turning.real.sum(), abs=1e-6)
        assert slope == pytest.approx((1j * n * turning).real.sum(), abs=1e-3)
