"""The hard cases: named extremes, each with the phase on which engaging the tip in time ends.

The phases are from tests/data/hard.json, made by codes that share nothing with phasemap (tests/reference/make_hard.py).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from math import nan

import numpy as np

from phasemap.experiment.interaction import Interaction
from phasemap.experiment.material import Material
from phasemap.experiment.microscope import Cantilever, Drive, Microscope, Tip

Value = float | None
Row = tuple[str, Value, dict[str, Value]]

RESONANCE = 300e3  # [Hz]; only ratios to it matter

BOX: dict[str, tuple[float, float]] = {
    "modulus": (1e3, 1e12),  # Pa
    "adhesion": (1e-4, 1.0),  # J/m2
    "damping": (1e-4, 5.0),
    "stiffness": (0.1, 100.0),  # N/m
    "quality_factor": (1.5, 1e6),
    "amplitude": (1e-10, 5e-7),  # m, of the free lever at the drive frequency
    "radius": (2e-9, 1e-7),  # m
    "decay_length": (5e-11, 1e-9),  # m
    "ratio": (0.5, 2.0),  # drive over resonance frequency
    "setpoint": (0.02, 0.999),
}
"""The box of parameters that solvers must cope with."""

_AIR: dict[str, Value] = {
    "modulus": 2e9, "adhesion": 0.05, "damping": 0.01, "stiffness": 40.0, "quality_factor": 400.0, "amplitude": 2e-8,
    "radius": 1e-8, "decay_length": 3e-10, "ratio": 1.0, "setpoint": 0.7,
}  # fmt: skip
_LIQUID: dict[str, Value] = {
    "modulus": 5e7, "adhesion": 5e-4, "damping": 0.02, "stiffness": 0.6, "quality_factor": 3.0, "amplitude": 1e-8,
    "radius": 2e-8, "decay_length": 4e-10,
}  # fmt: skip
_WIDE: dict[str, Value] = {
    "modulus": 1e9, "adhesion": 0.2, "damping": 0.005, "quality_factor": 250.0, "amplitude": 4e-8, "radius": 3e-8,
}  # fmt: skip
_SOFT: dict[str, Value] = {"modulus": 5e8, "stiffness": 3.0, "quality_factor": 150.0}
_STARTS = {"air": _AIR, "liquid": _AIR | _LIQUID, "wide tip": _AIR | _WIDE, "soft lever": _AIR | _SOFT}


@dataclass(frozen=True)
class HardCase:
    """A pixel that is hard to solve.

    Parameters
    ----------
    name : str
        Of the family and of what is special.
    family : str
    material : Material
    scope : Microscope
    setpoint : float
    phase : float, optional
        That on which engaging in time ends [degree]; None where nothing holds the setpoint, since the amplitude jumps
        across it or never falls so far. NaN where no independent answer is known, or where the lever has to be pressed
        in so far that an answer may as well be refused.
    """

    name: str
    family: str
    material: Material
    scope: Microscope
    setpoint: float
    phase: float | None


def _of(start: str, phase: float | None, **change: float | None) -> Row:
    """A case that differs in a few parameters from one of `_STARTS`."""
    said = [start] if start != "air" else []
    said += [f"no {key}" if value is None else f"{key} {value:.10g}" for key, value in change.items()]
    return ", ".join(said).replace("_", " "), phase, _STARTS[start] | change


def _all(phase: float | None, *values: float | None) -> Row:
    """A case given by all its parameters, in the order of `BOX`; named by its place in the family."""
    return "", phase, dict(zip(BOX, values, strict=True))


def _drawn(
    family: str, seed: int, phases: tuple[float | None, ...], **fixed: float | tuple[float, float]
) -> list[HardCase]:
    """Cases drawn from `BOX`, or from other ranges; parameters that are `fixed` to a number keep it."""
    cases = []
    for number, phase in enumerate(phases, start=1):
        values = draw(np.random.default_rng([seed, number]), **fixed)
        cases.append(_case(family, f"drawn {seed}-{number}", phase, values))
    return cases


def draw(rng: np.random.Generator, **fixed: float | tuple[float, float]) -> dict[str, float | None]:
    """Draw parameters from `BOX`: setpoint and radius uniformly, the others over decades, and some of them absent.

    Parameters
    ----------
    rng : numpy.random.Generator
    **fixed : float or (float, float)
        A value to take, or another range.

    Returns
    -------
    dict
        As `BOX`, SI units; decay_length None for no force before contact.

    Examples
    --------
    >>> draw(np.random.default_rng(1), ratio=1.0, setpoint=(0.5, 0.6))["setpoint"]
    0.526
    """
    absent = {"adhesion": (0.2, 0.0), "damping": (0.25, 0.0), "decay_length": (0.2, None), "ratio": (0.5, 1.0)}
    values: dict[str, float | None] = {}
    for key, limits in BOX.items():
        chance, left, given = rng.random(), rng.random(), fixed.get(key, limits)
        if isinstance(given, float):
            values[key] = given
        elif key not in fixed and key in absent and chance < absent[key][0]:
            values[key] = absent[key][1]
        elif key in ("setpoint", "radius"):
            values[key] = float(f"{given[0] + left * (given[1] - given[0]):.3g}")
        else:
            values[key] = float(f"{given[0] * (given[1] / given[0]) ** left:.3g}")
    return values


def case_of(name: str, family: str, phase: float | None, values: dict[str, float | None]) -> HardCase:
    """Build a case from parameters as in `BOX`.

    Examples
    --------
    >>> case = case_of("a", "b", None, draw(np.random.default_rng(1), amplitude=2e-8, ratio=1.5))
    >>> round(case.scope.driven_amplitude * 1e9, 9)
    20.0
    """
    v = {key: 0.0 if value is None else value for key, value in values.items()}
    quality, ratio = v["quality_factor"], v["ratio"]
    # The free amplitude at the drive frequency is what counts; the one at resonance follows.
    free = v["amplitude"] * (1.0 if ratio == 1.0 else quality * math.hypot(1 - ratio**2, ratio / quality))
    scope = Microscope(
        Cantilever(v["stiffness"], RESONANCE, quality),
        Tip(v["radius"]),
        Drive(free, None if ratio == 1.0 else ratio * RESONANCE),
        Interaction(decay_length=values["decay_length"]),
    )
    return HardCase(name, family, Material(v["modulus"], v["adhesion"], v["damping"]), scope, v["setpoint"], phase)


def _case(family: str, name: str, phase: float | None, values: dict[str, float | None]) -> HardCase:
    return case_of(f"{family}: {name}", family, phase, values)


FOLDS: dict[str, tuple[Row, float, tuple[float | None, float | None]]] = {
    "small amplitude": (
        _of("air", nan, adhesion=0.04, damping=0.005, quality_factor=300.0, amplitude=6e-9), 0.645859605228,
        (-49.70, 48.35),
    ),
    "wide tip": (
        _of("wide tip", nan, adhesion=0.1), 0.927042590016,
        (-21.94, 20.96),
    ),
    "above resonance": (
        _of("air", nan, adhesion=0.03, damping=0.005, quality_factor=300.0, ratio=1.003), 0.967034258102,
        (-61.95, 60.86),
    ),
    "liquid, hard": (
        _of("liquid", nan, modulus=5e9, adhesion=0.002, quality_factor=2.0), 0.140606546216,
        (-1.39, 51.37),
    ),
    "soft sample": (
        _of("air", nan, modulus=1e8, quality_factor=100.0, ratio=1.02), 0.978848819226,
        (-76.00, 36.32),
    ),
}  # fmt: skip
"""Where the amplitude has a minimum as the tip comes down, the setpoint there (tests/reference/make_hard.py), and the
phases just above it and below."""
BESIDE = 5e-7
"""How far the setpoints of the family "folds" are from one, relatively."""


def _folds() -> list[HardCase]:
    """Two cases for each fold: just above the smallest amplitude, where the setpoint is met, and just below."""
    return [
        _case("folds", f"{name}, {side}", phase, row[2] | {"setpoint": at * (1 + sign * BESIDE)})
        for name, (row, at, phases) in FOLDS.items()
        for side, sign, phase in zip(("above", "below"), (1, -1), phases, strict=True)
    ]


_FAMILIES: dict[str, tuple[Row, ...]] = {
    "grazing contact": (
        _of("air", 1.75, adhesion=0.0, setpoint=0.999),
        _of("air", 0.03, adhesion=0.0, setpoint=0.99999),
        _of("air", 0.00, adhesion=0.0, setpoint=0.9999999),
        _of("air", 0.26, modulus=1e12, adhesion=0.0, damping=0.0, setpoint=0.99999),
        _of("liquid", 0.39, adhesion=0.0, setpoint=0.9999),
        _of("liquid", 7.51, modulus=5e9, adhesion=0.0, setpoint=0.99),
        _of("air", 0.09, adhesion=0.002, decay_length=None, setpoint=0.9999),
        _of("air", 11.76, decay_length=None, setpoint=0.97),
        _of("soft lever", 17.20, adhesion=0.02, decay_length=None, setpoint=0.95),
    ),
    "bistability": (
        _of("wide tip", -18.19, setpoint=0.95),
        _of("wide tip", -25.84, setpoint=0.9),
        _of("wide tip", -53.12, setpoint=0.6),
        _of("wide tip", -72.54, setpoint=0.3),
        _of("wide tip", -53.13, damping=0.0, setpoint=0.6),
        _of("wide tip", -23.07, adhesion=0.3, damping=0.05, quality_factor=200.0, setpoint=0.92),
        _of("soft lever", -36.87, adhesion=0.1, setpoint=0.8),
        _of("wide tip", -36.87, quality_factor=3000.0, setpoint=0.8),
        _of("air", 58.42, adhesion=0.1, quality_factor=300.0, ratio=0.998, setpoint=0.8),
        _of("air", 66.12, adhesion=0.03, damping=0.005, quality_factor=300.0, ratio=1.003, setpoint=0.8),
    ),
    "zero damping": (
        _of("air", -45.57, modulus=1e6, damping=0.0),
        _of("air", 45.57, modulus=1e9, damping=0.0),
        _of("air", 45.57, modulus=1e12, damping=0.0),
        _of("air", -45.57, damping=0.0, quality_factor=1e5),
        _of("liquid", 43.95, damping=0.0),
        _of("air", 87.13, damping=0.0, setpoint=0.05),
    ),
    "zero adhesion": (
        _of("air", -0.02, modulus=10000.0, adhesion=0.0),
        _of("air", 4.82, modulus=1e7, adhesion=0.0),
        _of("air", 45.37, modulus=1e10, adhesion=0.0),
        _of("liquid", 42.04, adhesion=0.0, quality_factor=2.0),
        _of("air", -0.03, modulus=0.0, adhesion=0.0, damping=0.02),
        _of("air", None, modulus=0.0, adhesion=0.0, damping=0.0),
        _all(38.39, 4.4e10, 0.0, 3.5e-4, 0.33, 1.7, 1.37e-7, 7.5e-8, 3e-10, 1.0, 0.1),
    ),
    "zero stiffness": (
        _of("air", -38.16, modulus=0.0),
        _of("air", -45.57, modulus=0.0, damping=0.0),
        _of("air", None, modulus=0.0, adhesion=0.001, damping=0.0, setpoint=0.95),
        _of("air", -45.57, modulus=0.0, adhesion=1.0, damping=0.5),
        _of("air", -36.87, modulus=0.0, adhesion=0.1, amplitude=5e-9, setpoint=0.8),
        _of("liquid", 0.00, modulus=0.0),
    ),
    "modulus": (
        _of("air", -9.03, modulus=1000.0, adhesion=0.01),
        _of("air", -8.98, modulus=1e5, adhesion=0.01),
        _of("air", -4.20, modulus=1e7, adhesion=0.01),
        _of("air", 43.30, modulus=1e9, adhesion=0.01),
        _of("air", 45.55, modulus=1e11, adhesion=0.01),
        _of("air", 45.57, modulus=1e12, adhesion=0.01),
        _of("soft lever", 45.57, modulus=1e12, adhesion=0.01),
        _of("air", -0.63, modulus=1000.0, adhesion=1e-4, stiffness=0.1, quality_factor=20.0),
        _of("liquid", 23.56, modulus=1e12, setpoint=0.9),
    ),
    "decay length 0.05 nm": (
        _of("air", 44.45, adhesion=0.01, decay_length=5e-11),
        _of("air", 22.96, adhesion=0.1, decay_length=5e-11, setpoint=0.9),
        _of("air", -31.79, adhesion=0.5, decay_length=5e-11, setpoint=0.85),
        _of("soft lever", -45.57, decay_length=5e-11),
        _of("air", 44.54, amplitude=5e-7, decay_length=5e-11),
        _of("liquid", 43.04, adhesion=0.002, decay_length=5e-11),
        _of("air", 45.57, modulus=1e12, damping=0.0, decay_length=5e-11),
    ),
    "quality factor": (
        _of("liquid", 40.94, quality_factor=1.5),
        _of("liquid", 43.19),
        _of("liquid", 44.60, quality_factor=10.0),
        _of("liquid", 44.61, quality_factor=100.0),
        _of("air", 35.59, adhesion=0.01, quality_factor=1000.0, setpoint=0.8),
        _of("air", -36.87, adhesion=0.01, quality_factor=10000.0, setpoint=0.8),
        _of("air", -36.87, adhesion=0.01, quality_factor=1e5, setpoint=0.8),
        _of("air", -36.87, adhesion=0.01, quality_factor=1e6, setpoint=0.8),
        _of("air", nan, adhesion=0.0, damping=0.0, quality_factor=1e6),
        _of("liquid", 27.98, modulus=5e9, quality_factor=1.5, setpoint=0.8),
        _of("liquid", 43.68, modulus=5e9, quality_factor=1.5, setpoint=0.2),
    ),
    "setpoint": (
        _of("air", 87.49, setpoint=0.02),
        _of("air", 82.26, setpoint=0.1),
        _of("air", 58.35, setpoint=0.5),
        _of("air", -8.11, setpoint=0.99),
        _of("air", -2.56, setpoint=0.999),
        _of("liquid", nan, setpoint=0.02),
        _of("liquid", 1.78, setpoint=0.999),
        _of("soft lever", None, adhesion=0.01, setpoint=0.02),
        _of("soft lever", -2.56, adhesion=0.01, setpoint=0.999),
    ),
    "amplitude": (
        _of("air", -45.57, adhesion=0.02, amplitude=1e-10),
        _of("air", -45.57, adhesion=0.02, amplitude=3e-10),
        _of("air", -45.57, adhesion=0.02, amplitude=1e-9),
        _of("air", 43.12, adhesion=0.02, amplitude=5e-9),
        _of("air", 44.52, adhesion=0.02, amplitude=1e-7),
        _of("air", 44.55, adhesion=0.02, amplitude=5e-7),
        _of("air", 26.44, adhesion=0.02, stiffness=1000.0, quality_factor=100.0, amplitude=1e-10),
        _of("air", 44.57, adhesion=0.0, amplitude=1e-10),
        _of("liquid", 44.96, amplitude=1e-10),
        _of("soft lever", 45.23, amplitude=5e-7),
    ),
    "damping": (
        _of("air", 29.96, damping=0.1),
        _of("air", -1.33, damping=0.5),
        _of("air", -8.99, damping=1.0),
        _of("air", -11.88, damping=2.0),
        _of("air", -12.68, damping=5.0),
        _of("liquid", 1.43, damping=5.0),
        _of("air", 3.17, adhesion=0.0, damping=5.0, setpoint=0.3),
        _all(16.19, 7.5e7, 0.0, 2.6, 12.0, 590.0, 2.94e-7, 8.2e-8, 3e-10, 0.793, 0.34),
        _of("air", 44.23, modulus=1e12, damping=5.0),
    ),
    "drive": (
        _of("air", 89.33, adhesion=0.01, quality_factor=100.0, ratio=0.5),
        _of("air", 89.01, adhesion=0.01, quality_factor=100.0, ratio=0.7),
        _of("air", 85.79, adhesion=0.01, quality_factor=100.0, ratio=0.95),
        _of("air", 83.78, adhesion=0.01, quality_factor=100.0, ratio=1.05),
        _of("air", 87.01, adhesion=0.01, quality_factor=100.0, ratio=1.4),
        _of("air", nan, adhesion=0.01, quality_factor=100.0, ratio=2.0),
        _of("liquid", 76.76, ratio=0.5),
        _of("liquid", 63.74, ratio=0.8),
        _of("liquid", 62.63, ratio=1.25),
        _of("liquid", nan, ratio=2.0),
        _of("air", nan, modulus=1e7, adhesion=0.0, quality_factor=30.0, ratio=1.4),
        _of("air", 89.62, adhesion=0.01, quality_factor=3000.0, ratio=0.9),
        _of("air", 87.60, adhesion=0.0, quality_factor=1000.0, ratio=1.1),
    ),
    "snap into contact": (
        _all(None, 4.5e10, 0.012, 4.6, 0.1, 9.1, 7.4e-9, 2.3e-8, 6.3e-10, 1.0, 0.037),
        _of("air", -45.57, adhesion=0.1, stiffness=2.0, quality_factor=50.0, amplitude=5e-9),
        _of("air", -45.57, adhesion=0.1, stiffness=10.0, quality_factor=200.0, amplitude=1e-9),
        _of("air", None, stiffness=1.0, quality_factor=30.0, amplitude=2e-9, decay_length=None),
        _all(None, 1e7, 0.05, 0.01, 1.0, 30.0, 2e-9, 1e-8, None, 1.0, 0.5),
        _all(nan, 1e8, 0.1, 0.01, 1.5, 30.0, 2e-9, 1e-8, 3e-10, 0.6, 0.5),
        _of("air", -53.11, modulus=1e6, adhesion=0.02, stiffness=0.5, quality_factor=20.0, amplitude=2e-9,
            setpoint=0.6),
        _of("liquid", None, adhesion=0.01, stiffness=0.1, quality_factor=2.0, amplitude=2e-9, setpoint=0.6),
    ),
    "ten decades in one image": (
        _of("air", -0.01, modulus=100.0, adhesion=0.0, setpoint=0.8),
        _of("air", -0.01, modulus=10000.0, adhesion=0.0, setpoint=0.8),
        _of("air", 0.31, modulus=1e6, adhesion=0.0, setpoint=0.8),
        _of("air", 21.62, modulus=1e8, adhesion=0.0, setpoint=0.8),
        _of("air", 36.67, modulus=1e10, adhesion=0.0, setpoint=0.8),
        _of("air", 36.87, modulus=1e12, adhesion=0.0, setpoint=0.8),
    ),
    "found by drawing at random": (
        _all(80.30, 2.19e7, 0.00212, 0.0817, 0.894, 123.0, 5.57e-8, 9.74e-8, 4.74e-10, 0.624, 0.398),
        _all(85.66, 1.33e10, 0.107, 1.03, 0.345, 41.3, 2.71e-8, 9.52e-8, 8.69e-10, 1.62, 0.885),
        _all(89.20, 1.02e9, 0.00279, 0.0048, 0.511, 150.0, 1.65e-9, 9.64e-8, 2.24e-10, 1.34, 0.689),
        _all(62.10, 8.04e7, 0.0139, 0.111, 0.122, 4.08, 3.13e-8, 6.6e-8, 3.6e-10, 1.3, 0.662),
        _all(nan, 2.24e10, 0.00316, 0.00681, 0.836, 45.2, 2.4e-7, 1.46e-8, 1.17e-10, 1.11, 0.55),
        _all(57.29, 5.74e6, 0.792, 0.416, 10.3, 77.8, 1.05e-10, 7.35e-8, 6.31e-10, 0.51, 0.724),
        _all(29.96, 1.41e5, 0.765, 0.965, 2.33, 35.9, 3.06e-10, 4.68e-8, 8.79e-11, 0.734, 0.496),
        _all(89.66, 6.68e11, 8.96e-4, 0.00299, 1.03, 293.0, 2.7e-7, 3.23e-8, 8.73e-10, 1.64, 0.639),
        _all(nan, 3.67e10, 1.75e-4, 0.018, 1.98, 1680.0, 8.11e-9, 6.35e-8, None, 1.47, 0.0318),
        _all(-21.90, 40400.0, 0.127, 0.911, 3.26, 7.86, 3.66e-8, 7.02e-8, None, 1.0, 0.926),
        _all(80.01, 7.57e11, 4.38e-4, 1.91e-4, 0.337, 13.7, 1.92e-10, 2.47e-8, 8.94e-10, 1.0, 0.0636),
        _all(-15.24, 2.89e6, 0.00274, 3.1, 4.25, 15.8, 6.98e-8, 9.22e-9, 1.84e-10, 1.0, 0.196),
        _all(-16.53, 1.07e5, 0.0926, 3.06, 31.1, 11.5, 6.49e-8, 1.09e-8, 7.73e-10, 1.0, 0.097),
        _all(16.69, 7.53e7, 0.0, 2.59, 11.7, 592.0, 2.94e-7, 8.23e-8, 9.35e-10, 0.793, 0.34),
        _all(38.54, 4.35e10, 0.0, 3.48e-4, 0.328, 1.68, 1.37e-7, 7.52e-8, 1.88e-10, 1.0, 0.104),
        _all(-36.11, 0.0, 1.9e-4, 2.49, 2.5, 7.07, 1.61e-7, 3.03e-8, 6.72e-10, 1.42, 0.387),
        _all(nan, 2.8e9, 0.254, 0.179, 1.06, 91.8, 1.33e-8, 6.17e-8, 7.05e-10, 1.68, 0.552),
        _all(66.65, 8.85e11, 6.66e-4, 0.0528, 0.199, 7.1, 3.9e-7, 9.85e-8, 3.75e-10, 1.0, 0.355),
        _all(11.99, 1.38e11, 0.00166, 0.0015, 0.103, 1.98, 1.28e-7, 7.39e-8, 2.82e-10, 1.0, 0.0844),
        _all(33.78, 3.59e9, 0.0132, 1.18, 1.34, 1.56, 8.3e-8, 2.03e-8, 5.47e-10, 1.0, 0.243),
        _all(38.48, 1.55e8, 1.26e-4, 0.0159, 1.47, 2.61, 2.4e-10, 9.34e-8, None, 1.0, 0.758),
    ),
}  # fmt: skip

CASES: tuple[HardCase, ...] = (
    *_folds(),
    *(
        _case(family, name or str(number), phase, values)
        for family, rows in _FAMILIES.items()
        for number, (name, phase, values) in enumerate(rows, start=1)
    ),
    *_drawn("bistability", 11, (56.89, 67.92, 35.70, 48.08), stiffness=(20.0, 50.0), quality_factor=(100.0, 800.0),
            modulus=(1e9, 5e10), adhesion=(0.05, 0.3), damping=(5e-4, 0.01), amplitude=(1e-8, 4e-8),
            radius=(1e-8, 2.5e-8), decay_length=(1.5e-10, 5e-10), ratio=1.0, setpoint=(0.3, 0.95)),
    *_drawn("zero damping", 12, (66.79, nan, -80.85), damping=0.0, ratio=1.0),
    *_drawn("zero adhesion", 13, (nan, nan, nan), adhesion=0.0),
    *_drawn("zero stiffness", 14, (nan, -74.40, -59.27), modulus=0.0, adhesion=(1e-4, 1.0)),
    *_drawn("decay length 0.05 nm", 15, (-65.61, -52.48, -40.97), decay_length=5e-11, ratio=1.0, adhesion=(1e-3, 1.0)),
    *_drawn("quality factor", 16, (nan, -68.08, 64.13), ratio=1.0),
    *_drawn("setpoint", 17, (nan, nan), ratio=1.0, setpoint=0.02),
    *_drawn("setpoint", 23, (2.56, -2.56), ratio=1.0, setpoint=0.999),
    *_drawn("amplitude", 18, (nan, -46.37), ratio=1.0, amplitude=1e-10),
    *_drawn("amplitude", 24, (-24.24, 0.33), ratio=1.0, amplitude=5e-7),
    *_drawn("damping", 19, (-74.39, 0.01, nan), ratio=1.0, damping=(1.0, 5.0)),
    *_drawn("drive", 20, (nan, 85.02, 89.72, nan), ratio=(0.5, 2.0), quality_factor=(1.5, 1e3)),
    *_drawn("whole box", 21, (nan, nan, nan, 34.28, 89.58, 40.27, -75.74, nan, nan, nan, nan, nan, 61.12, 44.49)),
)  # fmt: skip
"""Every hard case."""
