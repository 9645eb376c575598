"""Regimes in which the two engines of a scan in time are compared: lever, tip and a line of stripes or of relief."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from phasemap.experiment.control import Feedback
from phasemap.experiment.generate import blend, roughness
from phasemap.experiment.interaction import Interaction
from phasemap.experiment.material import Material
from phasemap.experiment.microscope import Cantilever, Drive, Microscope, Tip
from phasemap.experiment.surface import Surface

Array = np.ndarray
Pair = tuple[Material, Material]

PIXELS, STRIPE, PIXEL_SIZE = 48, 12, 4e-9
"""Pixels of a line and of a stripe, and their side [m]."""
TUNED = Feedback()


@dataclass(frozen=True, eq=False)
class ScanCase:
    """A line that both engines scan, there and back.

    Parameters
    ----------
    name : str
    scope : Microscope
    setpoint : float
    materials : (Material, Material)
        Of stripes 12 pixels wide, in turn.
    relief : ndarray, shape (48,)
        Topography of a line [m].
    periods : float
        Of the drive, over each pixel.
    control : Feedback
        All but its line rate.
    stated : str
        Why the engines are known to differ here; empty if they should not.
    """

    name: str
    scope: Microscope
    setpoint: float
    materials: Pair
    relief: Array
    periods: float = 300.0
    control: Feedback = TUNED
    stated: str = ""

    def surface(self, lines: int) -> Surface:
        """The same line several times over."""
        labels = np.arange(PIXELS) // STRIPE % 2
        return Surface.from_labels(
            np.tile(labels, (lines, 1)), dict(enumerate(self.materials)), pixel_size=PIXEL_SIZE,
            topography=np.tile(self.relief, (lines, 1)),
        )  # fmt: skip

    def feedback(self) -> Feedback:
        """The control, at the line rate that gives a pixel its periods.

        Examples
        --------
        >>> case = CASES[0]
        >>> round(case.feedback().dwell(PIXELS) * case.scope.cantilever.resonance_frequency, 6)
        300.0
        """
        slow = replace(self.control, line_rate=1.0, engage="image")
        frequency = self.scope.frequency_ratio * self.scope.cantilever.resonance_frequency
        return replace(slow, line_rate=slow.dwell(PIXELS) * frequency / self.periods)


def _scope(lever: Cantilever, free_amplitude: float, radius: float = 10e-9) -> Microscope:
    return Microscope(lever, Tip(radius), Drive(free_amplitude), Interaction())


def _without_loss(pair: Pair) -> Pair:
    return replace(pair[0], damping=0.0), replace(pair[1], damping=0.0)


WAVE = 1e-9 * np.sin(4 * math.pi * np.arange(PIXELS) / PIXELS)
STEP = np.where(abs(np.arange(PIXELS) - 23.5) < 8, 10e-9, 0.0)

PLASTIC = Material(1e9, 0.05, damping=0.01), Material(3e9, 0.05, damping=0.005)
STICKY = Material(1e9, 0.10, damping=0.01), Material(3e9, 0.12, damping=0.005)
RUBBER = Material(0.2e9, 0.03, damping=0.03), Material(1e9, 0.03, damping=0.01)
GEL = Material(0.05e9, 0.005, damping=0.05), Material(0.2e9, 0.005, damping=0.02)
BLEND = Material(0.5e9, 0.1, damping=0.1, poisson_ratio=0.48), Material(3e9, 0.15, damping=0.005)

USUAL = Cantilever(40.0, 300e3, 400.0)
HARD_TAPPING = _scope(USUAL, 40e-9)

CASES = (
    ScanCase(
        "paper's lever, 148.5 kHz, Q 833", _scope(Cantilever(40.0, 148.5e3, 833.0), 127e-9, 30e-9), 0.7, PLASTIC, WAVE
    ),
    ScanCase("usual lever, 300 kHz, Q 400", HARD_TAPPING, 0.7, PLASTIC, WAVE),
    ScanCase("the same, attractive, A 8 nm", _scope(USUAL, 8e-9), 0.8, STICKY, 0.3 * WAVE),
    ScanCase("soft lever, 3 N/m, 75 kHz, Q 200", _scope(Cantilever(3.0, 75e3, 200.0), 60e-9), 0.7, RUBBER, WAVE),
    ScanCase("Q 50", _scope(Cantilever(40.0, 300e3, 50.0), 20e-9), 0.7, PLASTIC, WAVE),
    ScanCase(
        "Q 10, as in liquid", _scope(Cantilever(1.0, 30e3, 10.0), 20e-9), 0.7, GEL, WAVE, 200.0,
        stated="an average to first order is off by its own order 1/Q; `auto` integrates the equation below Q 20",
    ),
    ScanCase("steps of 10 nm", HARD_TAPPING, 0.7, (PLASTIC[0], PLASTIC[0]), STEP),
    ScanCase("elastic only", HARD_TAPPING, 0.7, _without_loss(PLASTIC), WAVE),
    ScanCase("scanner that resonates at 2 kHz", HARD_TAPPING, 0.7, PLASTIC, WAVE,
             control=Feedback(scanner_resonance=2e3)),
    ScanCase(
        "bistable blend", _scope(USUAL, 20e-9), 0.8, BLEND, WAVE,
        stated="both engines change branches at the same edges, but a fraction of a pixel apart",
    ),
)  # fmt: skip

MONOSTABLE = ScanCase("stripes under a wave", HARD_TAPPING, 0.7, PLASTIC, WAVE)
"""Scanned at several rates against the image at rest."""


def image_lines(size: int, lines: int) -> Surface:
    """A strip of a blend with relief: so many lines, evenly over an image of `size` x `size` pixels."""
    labels = blend((size, size), PIXEL_SIZE, spacing=160e-9, fraction=0.45, seed=7)
    relief = roughness((size, size), PIXEL_SIZE, rms=1e-9, correlation_length=60e-9, seed=3)
    rows = slice(0, size, size // lines)
    return Surface.from_labels(labels[rows], dict(enumerate(PLASTIC)), pixel_size=PIXEL_SIZE, topography=relief[rows])
