"""A lever as a beam: its modes, what drives them, and what a detector sees of them."""

from __future__ import annotations

import cmath
import json
import math
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import phasemap as pm
from phasemap.experiment.beam import BETAS
from phasemap.experiment.described import describe
from phasemap.io.metadata import settings_of_image
from phasemap.scenes.objects import microscope_of, microscope_tables
from phasemap.scenes.scene import scene_from_json
from phasemap.validation.claims import microscope_from

SECOND = pm.Eigenmode(frequency_ratio=7.5, quality_factor=6.0)
LIQUID = pm.Cantilever(0.1, 20e3, 2.5, modes=(SECOND,))
BASE, DIRECT = pm.Drive(10e-9, excitation="base"), pm.Drive(10e-9)
TIP = pm.Tip(10e-9)


def numerical_mode(beta: float) -> tuple[float, float]:
    """Participation, and slope at the tip, of the shape of a clamped beam, 1 at the tip, by quadrature."""
    x, weight = np.polynomial.legendre.leggauss(60)
    x, weight = (x + 1) / 2, weight / 2
    ratio = (np.cosh(beta) + np.cos(beta)) / (np.sinh(beta) + np.sin(beta))

    def shape(x: Any) -> Any:
        return np.cosh(beta * x) - np.cos(beta * x) - ratio * (np.sinh(beta * x) - np.sin(beta * x))

    phi, step = shape(x) / shape(1.0), 1e-5
    return weight @ phi / (weight @ phi**2), (shape(1 + step) - shape(1 - step)) / (2 * step * shape(1.0))


def test_modes_are_those_of_a_clamped_beam() -> None:
    modes, (_, slope) = pm.Cantilever(2.0, 70e3, 150.0, modes=4).eigenmodes, numerical_mode(BETAS[0])
    for mode, beta in zip(modes, BETAS, strict=True):
        assert math.cos(beta) * math.cosh(beta) == pytest.approx(-1, abs=1e-10)
        participation, slope_here = numerical_mode(beta)
        # The default of the first has six decimals; a central difference is off by (beta step)^2 / 6.
        assert mode.participation == pytest.approx(participation, abs=6e-7)
        assert mode.slope_ratio == pytest.approx(slope_here / slope, rel=1e-8)
        assert mode.stiffness_ratio == pytest.approx(mode.frequency_ratio**2, rel=1e-14)
    # Rao, Vibration of Continuous Systems: beta l = 1.8751, 4.6941, 7.8548, 10.9955.
    assert [mode.frequency_ratio for mode in modes[1:]] == pytest.approx([6.266893, 17.547482, 34.386061], abs=6e-7)
    # The static spring constant of the whole beam is what its modes are in series, but for those left out.
    assert sum(1 / mode.stiffness_ratio for mode in modes if mode.stiffness_ratio) == pytest.approx(1.030197, abs=7e-4)


def test_what_is_not_said_of_a_mode_is_that_of_the_beam_and_what_is_said_stays() -> None:
    own = pm.Eigenmode(7.5, 6.0, 30.0, -0.7, 3.0)
    second = replace(LIQUID, modes=[own]).eigenmodes[1]
    assert second == own and LIQUID.eigenmodes[1].frequency_ratio == 7.5
    assert LIQUID.eigenmodes[1].stiffness_ratio == pytest.approx(39.2739, abs=6e-5)
    assert LIQUID.eigenmodes[0] == pm.Cantilever(0.1, 20e3, 2.5).eigenmodes[0]
    first = LIQUID.eigenmodes[0]
    assert (first.frequency_ratio, first.stiffness_ratio, first.slope_ratio) == (1, 1, 1)
    assert pm.Cantilever(2.0, 70e3, 150.0, modes=1) == pm.Cantilever(2.0, 70e3, 150.0)


def integrated(scope: pm.Microscope, weights: tuple[float, ...]) -> tuple[complex, complex]:
    """What the detector sees of the free lever, and the tip, from the equation of motion solved as a linear system."""
    omega, drive, base = scope.frequency_ratio, scope.base_amplitude, scope.drive.excitation == "base"
    n = len(scope.cantilever.eigenmodes)
    matrix, right = np.zeros((2 * n, 2 * n), complex), np.zeros(2 * n, complex)
    for i, mode in enumerate(scope.cantilever.eigenmodes):
        w, q, k, b = mode.frequency_ratio, mode.quality_factor, mode.stiffness_ratio, mode.participation
        assert k is not None and b is not None
        # x' = v, and v' = -w^2 x - (w / Q) (v + b Y') + w^2 force / k - b Y'', all times exp(i omega t)
        matrix[2 * i, [2 * i, 2 * i + 1]] = 1j * omega, -1
        matrix[2 * i + 1, [2 * i, 2 * i + 1]] = w**2, 1j * omega + w / q
        y = drive if base else 0.0
        right[2 * i + 1] = -w / q * b * 1j * omega * y + b * omega**2 * y + (0 if base else w**2 / k * drive)
    x = np.linalg.solve(matrix, right)[::2]
    return complex(np.dot(weights, x)), complex(x.sum() + (drive if base else 0))


@pytest.mark.parametrize("drive", [BASE, DIRECT, pm.Drive(10e-9, 17e3, "base"), pm.Drive(10e-9, 23e3)])
@pytest.mark.parametrize("detector", ["slope", "tip", (1, -2.5)])
def test_the_free_lever_is_the_solution_of_its_equation_of_motion(drive: pm.Drive, detector: Any) -> None:
    scope = pm.Microscope(LIQUID, TIP, drive, detector=detector)
    weights = {"slope": (1.0, 3.473127), "tip": (1.0, 1.0)}.get(detector, detector)
    assert scope.detector_weights == pytest.approx(weights, abs=5e-7)
    seen, _ = integrated(scope, scope.detector_weights)
    resonant, _ = integrated(replace(scope, drive=replace(drive, frequency=None)), scope.detector_weights)
    assert scope.driven_amplitude == pytest.approx(abs(seen), rel=1e-13)
    assert scope.free_phase == pytest.approx(math.degrees(cmath.phase(seen / resonant)), abs=1e-11)


def test_of_one_mode_every_detector_sees_the_same_and_the_participation_is_the_bases_alone() -> None:
    for drive in (BASE, pm.Drive(10e-9, 17e3, "base"), DIRECT):
        beam = pm.Microscope(pm.Cantilever(0.1, 20e3, 2.5), TIP, drive)
        mass = replace(beam, cantilever=replace(beam.cantilever, participation=1))
        assert beam.driven_amplitude == mass.driven_amplitude == replace(beam, detector="tip").driven_amplitude
        assert beam.driven_amplitude == pytest.approx(abs(integrated(beam, (1.0,))[0]), rel=1e-13)
        ratio = 1.565984 if drive.excitation == "base" else 1.0
        assert mass.base_amplitude == pytest.approx(ratio * beam.base_amplitude, rel=1e-15)
    assert beam.detector_weights == (1.0,) and beam.free_phase == 0.0


REFUSED = {
    "modes is 5; allowed: at most 3 Eigenmodes above the first, or the number of all modes, 1 to 4.": {"modes": 5},
    "modes is 'two'; allowed: at most 3 Eigenmodes": {"modes": "two"},
    "modes is True; allowed: at most 3 Eigenmodes": {"modes": True},
    "frequency ratios of the modes is [7.5, 7.5]; allowed: numbers above 1, each above": {"modes": [SECOND, SECOND]},
    "participation is 0; allowed: a finite number above 0.": {"participation": 0},
}


@pytest.mark.parametrize("sentence", REFUSED)
def test_modes_that_no_lever_has_are_refused(sentence: str) -> None:
    with pytest.raises(pm.InputError) as error:
        replace(LIQUID, **REFUSED[sentence])
    assert sentence in str(error.value)


@pytest.mark.parametrize("detector", ["slop", (1.0,), (2.0, 1.0), (1.0, math.nan), None, 3])
def test_a_detector_that_does_not_fit_the_lever_is_refused(detector: Any) -> None:
    with pytest.raises(pm.InputError, match="detector is"):
        pm.Microscope(LIQUID, TIP, DIRECT, detector=detector)


SCOPES = [
    pm.Microscope(LIQUID, TIP, BASE, detector="tip"),
    pm.Microscope(replace(LIQUID, modes=(replace(SECOND, slope_ratio=3.3), pm.Eigenmode(21.0, 9.0))), TIP, DIRECT),
    pm.Microscope(pm.Cantilever(2.0, 70e3, 150.0, 1.4, modes=2), TIP, BASE, detector=(1.0, 2.5)),
]


@pytest.mark.parametrize("scope", SCOPES)
def test_a_lever_comes_back_from_the_provenance_of_an_image_and_from_a_scene(scope: pm.Microscope) -> None:
    stored = json.loads(json.dumps({"microscope": describe(scope), "setpoint": 0.7, "control": {}}))
    assert microscope_from(stored["microscope"]) == scope
    said = settings_of_image(xr.Dataset(attrs={"configuration": json.dumps(stored)}))
    assert said["free_amplitude"] == scope.driven_amplitude and said["phase_zero"] == scope.free_phase
    assert microscope_of(json.loads(json.dumps(microscope_tables(scope)))) == scope


def test_an_image_of_before_had_a_point_mass() -> None:
    stored = describe(SCOPES[0])
    for name in ("participation", "modes"):
        del stored["cantilever"][name]
    del stored["detector"]
    assert microscope_from(stored).cantilever == pm.Cantilever(0.1, 20e3, 2.5, participation=1)


def test_a_scene_says_modes_and_detector(tmp_path: Path) -> None:
    plain = Path("samples/step.toml").read_text(encoding="utf-8")
    path = tmp_path / "scene.toml"
    path.write_text(
        plain + "\n[detector]\nsees = 'tip'\n[[cantilever.modes]]\nfrequency_ratio = 6.1\nquality_factor = 500\n",
        encoding="utf-8",
    )
    scene = pm.load_scene(path)
    assert scene.microscope.cantilever.modes == (pm.Eigenmode(6.1, 500),) and scene.microscope.detector == "tip"
    assert microscope_of({**scene.config}) == scene.microscope
    changed = pm.load_scene(path, ["cantilever.modes=2", "detector.sees=[1, 3]", "cantilever.participation=1"])
    assert changed.microscope.cantilever.modes == 2 and changed.microscope.detector == (1.0, 3.0)
    assert changed.microscope.cantilever.participation == 1.0
    inline = pm.load_scene(path, ["cantilever.modes=[{frequency_ratio = 7.5, quality_factor = 6}]"])
    assert inline.microscope.cantilever.modes == (SECOND,)
    preset = pm.load_scene(path, ["cantilever.preset=PPP-NCHR"]).microscope.cantilever
    assert preset == pm.Cantilever.preset("PPP-NCHR", modes=(pm.Eigenmode(6.1, 500),))


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        ("detector.sees=top", "[detector] sees is 'top'; allowed: 'slope', 'tip', or as many weights as modes, 1,"),
        ("detector.see=tip", "[detector] see is unknown; allowed: sees. Did you mean 'sees'?"),
        ("cantilever.modes=[{frequency_ratio = 7.5}]", "[[cantilever.modes]] 2 quality_factor is missing"),
        ("cantilever.modes=[7]", "[[cantilever.modes]] 2 is 7; allowed: a table of keys"),
        ("cantilever.modes=0", "[cantilever] modes is 0; allowed: at most 3 Eigenmodes"),
    ],
)
def test_what_a_scene_says_wrongly_of_modes_is_told_by_its_place(override: str, sentence: str) -> None:
    with pytest.raises(pm.InputError) as error:
        pm.load_scene("samples/step.toml", [override])
    assert sentence in str(error.value)


@pytest.mark.parametrize(
    ("said", "told"),
    [
        (["cantilever.quality_factor=3"], "Q is 3 and the lever has one mode"),
        (["cantilever.quality_factor=3", "cantilever.modes=2"], "modes of a beam in a gas"),
        (["drive.frequency=313.4e3"], "within its width of harmonic 6 of the drive"),
        (["drive.frequency=313.4e3", "cantilever.modes=2"], ""),
        (["cantilever.quality_factor=3", "cantilever.preset=BL-AC40TS", "cantilever.liquid={}"], ""),
        ([], ""),
    ],
)  # fmt: skip
def test_a_scene_says_where_one_mode_is_not_enough(said: list[str], told: str) -> None:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        scene = pm.load_scene("samples/step.toml", ["drive.excitation=direct", *said])
        scene_from_json(scene.to_json(), Path("samples"))  # who reads it again was told
    sentences = [str(warning.message) for warning in caught]
    assert len(sentences) == bool(told) and told in "".join(sentences) and scene.microscope.advice == "".join(sentences)
