"""What value objects and results say of themselves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import phasemap as pm

SCOPE = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(20e-9))
SOFT = pm.Material(0.2e9, 0.06, 0.03)


@pytest.mark.parametrize(
    "thing",
    [
        SOFT, SCOPE, SCOPE.cantilever, pm.Interaction("jkr", None), pm.Mode(free_amplitude=2e-10), pm.Engage(),
        pm.Cantilever(0.1, 2e4, 2.5, modes=(pm.Eigenmode(7.5, 6.0, slope_ratio=3.3),)), replace(SCOPE, detector="tip"),
        pm.Cantilever(2.0, 7e4, 150.0, modes=2), pm.Raster(), pm.Feedback(2.0), pm.Accuracy(0.1),
        pm.Realism(temperature=300.0), pm.TipChange(3, 30e-9),
    ],
)  # fmt: skip
def test_a_value_object_is_shown_as_short_python_that_makes_it_again(thing: object) -> None:
    assert eval(repr(thing), vars(pm) | {name: getattr(pm, name) for name in pm.__all__}) == thing
    assert len(repr(thing)) < 220


def test_a_pixel_says_what_a_microscopist_asks_first_and_has_its_period() -> None:
    pixel = pm.solve_pixel(SOFT, SCOPE, 0.7, samples=256)
    assert repr(pixel).startswith("Pixel(good, attractive, solved by orbit (exact): phase -13.31 degrees, height")
    assert "dissipation 150 eV" in repr(pixel)
    assert pixel.period is not None and pm.solve_pixel(SOFT, SCOPE, 0.7).period is None
    deflection, force = pixel.period.deflection.values, pixel.period.force.values
    # 256 points on a contact of a twentieth of the period: the trapezoidal mean is good to 1 %.
    assert force.mean() == pytest.approx(40.0 * -pixel.mean_deflection, rel=0.01)
    assert deflection.max() - pixel.tip_offset == pytest.approx(pixel.indentation, abs=5e-12)
    angle = np.radians(pixel.period.drive_phase.values)
    first = 2 * np.mean(deflection * np.exp(-1j * angle))
    assert abs(first) == pytest.approx(pixel.amplitude, rel=1e-4)
    # The first harmonic lags by 90 degrees less the phase.
    assert np.degrees(np.angle(first)) == pytest.approx(pixel.phase - 90, abs=0.05)
