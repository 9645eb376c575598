"""How far off and how fast each solver is, over regimes of microscope and material.

Cases are drawn at random within a regime, so that no solver can be tuned to them. Errors are against another method:
"averaging" is compared with "orbit", and "orbit" with "march", which shares nothing with it but the force law and the
branch that engagement chose.
"""

from __future__ import annotations

import os
import platform
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from phasemap._check import whole
from phasemap._kernels import columns as col
from phasemap.accuracy import Accuracy
from phasemap.interaction import Interaction
from phasemap.microscope import Cantilever, Drive, Microscope, Tip
from phasemap.scan import run
from phasemap.solvers import by_name
from phasemap.work import Work, make_work

Array = np.ndarray
Range = tuple[float, float]
SCOPES = 6  # microscopes drawn in a regime


@dataclass(frozen=True)
class Regime:
    """Ranges from which a case is drawn: logarithmic for what spans decades, uniform for radius, setpoint, d0.

    Parameters
    ----------
    name : str
    stiffness, quality_factor, free_amplitude, radius, decay_length, setpoint : (float, float)
        Of the microscope [N/m, 1, m, m, m, 1].
    modulus, adhesion, damping : (float, float)
        Of the material [Pa, J/m2, 1]; one material in five has no adhesion, one in five no damping.
    """

    name: str
    stiffness: Range
    quality_factor: Range
    free_amplitude: Range
    radius: Range
    modulus: Range
    adhesion: Range
    damping: Range
    decay_length: Range = (0.15e-9, 0.5e-9)
    setpoint: Range = (0.4, 0.95)


REGIMES = (
    Regime("air", (20, 50), (200, 850), (10e-9, 100e-9), (8e-9, 30e-9), (1e9, 2e10), (0.01, 0.5), (1e-3, 0.1)),
    Regime("stiff sample", (20, 50), (200, 850), (1e-8, 5e-8), (5e-9, 15e-9), (5e10, 3e11), (0.05, 0.5), (1e-4, 1e-2)),
    Regime("soft lever", (1, 4), (60, 200), (15e-9, 60e-9), (8e-9, 20e-9), (5e7, 3e9), (0.01, 0.1), (1e-3, 0.1)),
    Regime("high Q", (25, 50), (5e3, 5e4), (6e-9, 50e-9), (10e-9, 30e-9), (3e8, 2e10), (5e-3, 0.1), (1e-3, 0.05)),
    Regime("liquid", (0.3, 2), (2, 8), (5e-9, 15e-9), (10e-9, 40e-9), (1e7, 3e8), (1e-4, 5e-3), (1e-3, 0.2)),
)  # fmt: skip


@dataclass(frozen=True)
class Row:
    """What was measured in one regime.

    Attributes
    ----------
    pixels, held : int
        How many were drawn, and on how many of them an orbit can be held.
    averaging_phase, averaging_height : (float, float)
        Median and largest error of averaging [degree, m].
    orbit_phase, orbit_height : float
        Largest error of orbit [degree, m].
    closure : float
        Largest energy imbalance of orbit [1].
    seconds : dict of str to float
        Per pixel and core, by solver.
    """

    name: str
    pixels: int
    held: int
    averaging_phase: tuple[float, float]
    averaging_height: tuple[float, float]
    orbit_phase: float
    orbit_height: float
    closure: float
    seconds: dict[str, float]


def draw(regime: Regime, pixels: int, rng: np.random.Generator) -> list[Work]:
    """Draw microscopes of a regime, and materials under each."""

    def between(limits: Range, size: int | None = None) -> Array:
        low, high = np.log(limits[0]), np.log(limits[1])
        return np.asarray(np.exp(rng.uniform(low, high, size)))

    works = []
    count = -(-pixels // SCOPES)
    for _ in range(SCOPES):
        scope = Microscope(
            Cantilever(float(between(regime.stiffness)), 300e3, float(between(regime.quality_factor))),
            Tip(rng.uniform(*regime.radius)),
            Drive(float(between(regime.free_amplitude))),
            Interaction(decay_length=rng.uniform(*regime.decay_length)),
        )
        materials = np.column_stack(
            [
                between(regime.modulus, count),
                between(regime.adhesion, count) * (rng.random(count) > 0.2),
                between(regime.damping, count) * (rng.random(count) > 0.2),
                np.full(count, 0.35),
            ]
        )
        amplitude = rng.uniform(*regime.setpoint) * scope.free_amplitude
        works.append(make_work(materials, False, scope, np.full(count, amplitude)))
    return works


def measure(regime: Regime, pixels: int, rng: np.random.Generator, repeats: int = 3) -> Row:
    """Solve a regime's cases with every solver on one core, and compare."""
    works = draw(regime, pixels, rng)
    seconds: dict[str, float] = {}
    results: dict[str, tuple[Array, Array]] = {}
    for name in ("averaging", "orbit", "march"):
        best = np.inf
        for _ in range(1 if name == "march" else repeats):
            started = time.perf_counter()
            solved = [run(by_name(name), work, Accuracy(), threads=1) for work in works]
            best = min(best, time.perf_counter() - started)
        results[name] = np.concatenate([s[0] for s in solved]), np.concatenate([s[1] for s in solved])
        seconds[name] = best / sum(len(work) for work in works)
    exact, status = results["orbit"]
    averaged, marched = results["averaging"][0], results["march"][0]
    phase, height = (np.degrees(averaged - exact)[:, col.PHASE], (averaged - exact)[:, col.TIP_OFFSET])
    difference = marched - exact
    return Row(
        regime.name,
        len(exact),
        int((status == col.GOOD).sum()),
        (float(np.nanmedian(abs(phase))), float(np.nanmax(abs(phase)))),
        (float(np.nanmedian(abs(height))), float(np.nanmax(abs(height)))),
        float(np.nanmax(abs(np.degrees(difference[:, col.PHASE])))),
        float(np.nanmax(abs(difference[:, col.TIP_OFFSET]))),
        float(np.nanmax(abs(exact[:, col.CLOSURE]))),
        seconds,
    )


def compile_time() -> float:
    """Seconds until every solver has solved its first pixel: compilation, or reading it from the disk cache."""
    started = time.perf_counter()
    work = draw(REGIMES[0], 1, np.random.default_rng(0))[0]
    for name in ("averaging", "orbit", "march"):
        run(by_name(name), work, Accuracy(), threads=1)
    return time.perf_counter() - started


def bench(pixels: int = 600, seed: int = 1, progress: Callable[[str], None] | None = None) -> str:
    """Measure every regime and return the table as Markdown.

    Parameters
    ----------
    pixels : int
        Distinct pixels in each regime.
    seed : int
        Of the cases drawn.
    progress : callable, optional
        Called with a regime's name before it is measured.

    Returns
    -------
    str

    Raises
    ------
    InputError
        If `pixels` or `seed` is no whole number of at least 1 or 0.

    Examples
    --------
    >>> print(bench(pixels=12).splitlines()[0][:28])
    | regime | pixels held | ave
    """
    whole("pixels", pixels, 1)
    rng = np.random.default_rng(whole("seed", seed, 0))
    compiled = compile_time()
    rows = []
    for regime in REGIMES:
        if progress is not None:
            progress(regime.name)
        rows.append(measure(regime, pixels, rng))
    return "\n".join([*_table(rows), "", _machine(compiled, seed)])


def _table(rows: list[Row]) -> list[str]:
    lines = [
        "| regime | pixels held | averaging: phase error, median / largest [degree] | height error [pm] "
        "| orbit: phase error, largest [degree] | height error [pm] | energy closure "
        "| averaging [µs per pixel] | orbit [µs] | march [µs] |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        (phase, most), (height, highest) = row.averaging_phase, row.averaging_height
        times = " | ".join(f"{row.seconds[name] * 1e6:.3g}" for name in ("averaging", "orbit", "march"))
        lines.append(
            f"| {row.name} | {row.held} of {row.pixels} | {phase:.2g} / {most:.2g} | {height * 1e12:.2g} / "
            f"{highest * 1e12:.2g} | {row.orbit_phase:.1g} | {row.orbit_height * 1e12:.1g} "
            f"| {row.closure:.0e} | {times} |"
        )
    return lines


def _machine(compiled: float, seed: int) -> str:
    from importlib.metadata import version

    names = ", ".join(f"{name} {version(name)}" for name in ("numpy", "numba"))
    return (
        f"Averaging against orbit, orbit against march; times on one core of {os.cpu_count()} "
        f"({platform.machine()}, Python {sys.version.split()[0]}, {names}), first pixels {compiled:.1f} s, seed {seed}."
    )
