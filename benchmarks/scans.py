"""Scans in time: the slow flow against the full equation of motion on the same lines, ``phasemap bench --scans``.

Both engines get the same surface, loop and gains. What differs is the lever between them: averaged over its period, or
integrated through every contact (`phasemap._kernels.scanning`).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.scan_cases import CASES, MONOSTABLE, PIXELS, ScanCase, image_lines
from benchmarks.tables import machine, markdown, versions
from phasemap._shared.threads import workers_of
from phasemap.experiment.control import Feedback
from phasemap.experiment.microscope import Microscope
from phasemap.experiment.surface import Surface
from phasemap.imaging.simulation import simulate

if TYPE_CHECKING:
    import xarray as xr

Array = np.ndarray
Say = Callable[[str], None]

SLOW_FLOW, EQUATION = "averaging", "march"
MOST_PHASE, MOST_AMPLITUDE = 0.1, 0.5
"""Differences [degree, % of the free amplitude] beyond which the engines do not agree."""
LINES = 3  # of a regime: the shorter time of the last two counts
RATES = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
SIZE, EQUATION_LINES = 512, 2
"""Side of the image in pixels, which the slow flow scans, and how many of its lines the equation of motion does."""
PEER, PEER_PERIOD = "PyVAFM", 140e-6
"""A simulator with a closed loop, and the time [s] that it takes for a period of the drive."""

REGIMES = (
    "The slow flow (`averaging`) against the full equation of motion (`march`) on the same lines of {pixels} pixels, "
    "there and back under the same loop. Bold is more than {phase:g}° or {amplitude:g} % of the free amplitude, or a "
    "pixel without a solution; *at rest* is how far first-order averaging is from the exact orbits without any motion. "
    "Times are of a line with its turns, after engaging, on one core (processor time); the last two columns say how "
    "many times faster than the microscope that is."
)
ERRORS = (
    "What the speed of a scan costs: largest difference from the image at rest (exact orbits) on a line of {pixels} "
    "pixels, stripes under a wave of ±1 nm, monostable; {periods:.0f} periods a pixel at 1 Hz."
)
IMAGE = (
    "An image of {size} x {size} pixels at a line rate of {rate:g} Hz, trace and retrace; by the equation of motion "
    "estimated from {equation} of its lines. A blend with relief under the usual lever."
)


def table(say: Say) -> str:
    """Compare both engines: the regimes, error against line rate, a whole image."""
    started = time.perf_counter()
    parts = [regimes(CASES, say), errors(RATES, say), whole_image(SIZE, 1.0, say)]
    return "\n\n".join([*parts, f"{machine()}; {versions()}; took {time.perf_counter() - started:.0f} s."])


# Regimes


@dataclass(frozen=True)
class Difference:
    """What both engines made of a case."""

    # phase, amplitude: absolute difference in each pixel that both have [degree, % of the free amplitude]
    phase: Array
    amplitude: Array
    at_rest: float  # largest difference in phase between averaging and exact orbits of the materials [degree]
    failed: tuple[int, int]  # pixels without a solution
    seconds: tuple[float, float]  # for a line

    @property
    def agree(self) -> bool:
        """Whether the difference is within limits everywhere, and nothing failed."""
        near = (self.phase <= MOST_PHASE).all() and (self.amplitude <= MOST_AMPLITUDE).all()
        return bool(near) and not any(self.failed)


def compare(case: ScanCase) -> Difference:
    """Scan a case with both engines."""
    surface, control = case.surface(LINES), case.feedback()
    (flow, flow_seconds), (full, full_seconds) = (
        timed_lines(surface, case.scope, case.setpoint, solver, control) for solver in (SLOW_FLOW, EQUATION)
    )
    averaged, exact = (simulate(case.surface(1), case.scope, case.setpoint, s) for s in (SLOW_FLOW, "orbit"))
    good = (flow.status.values == 0) & (full.status.values == 0)
    return Difference(
        phase=abs(flow.phase - full.phase).values[good],
        amplitude=100 / case.scope.driven_amplitude * abs(flow.amplitude_error - full.amplitude_error).values[good],
        at_rest=float(abs(averaged.phase - exact.phase).max()),
        failed=(failed(flow), failed(full)),
        seconds=(float(flow_seconds.min()), float(full_seconds.min())),
    )


def failed(image: xr.Dataset) -> int:
    """How many pixels have no solution."""
    return int((image["status"] != 0).sum())


def timed_lines(
    surface: Surface, scope: Microscope, setpoint: float, solver: str, control: Feedback
) -> tuple[xr.Dataset, Array]:
    """An image, and the processor time of each of its lines but the first, before which the tip engages [s].

    `surface`: of at least two lines.
    `control`: engages once, before the first line.
    """
    ends: list[float] = []

    def line_ended(done: int, total: int) -> None:
        ends.append(time.thread_time())  # what else the machine does is none of it

    image = simulate(surface, scope, setpoint, solver, control, progress=line_ended, threads=1)
    return image, np.diff(ends)


def regimes(cases: Sequence[ScanCase], say: Say) -> str:
    """The table of regimes, and what is known about those in which the engines differ."""
    heads = (
        "regime", "periods a pixel", "phase difference [degree]: 95 % of pixels / largest", "at rest [degree]",
        "amplitude difference [%]", "failed pixels: slow flow / equation", "slow flow [µs a pixel]",
        "equation [µs a period]", "slow flow faster by", "equation faster by",
    )  # fmt: skip
    lines, notes = [], []
    for case in cases:
        say(f"scans in time: {case.name}")
        found = compare(case)
        lines.append([case.name, *_cells(case, found)])
        if not found.agree:
            notes.append(f"* {case.name}: {case.stated or 'not known why'}.")
    caption = REGIMES.format(pixels=PIXELS, phase=MOST_PHASE, amplitude=MOST_AMPLITUDE)
    beyond = ["Beyond the limits:", "\n".join(notes)] if notes else []
    return "\n\n".join([caption, markdown(heads, lines), *beyond])


def _cells(case: ScanCase, found: Difference) -> list[str]:
    real, (flow, full) = 1 / case.feedback().line_rate, found.seconds
    periods = real * case.scope.frequency_ratio * case.scope.cantilever.resonance_frequency
    most = np.percentile(found.phase, (95, 100)) if found.phase.size else (np.nan, np.nan)
    return [
        f"{case.periods:g}",
        " / ".join(_marked(float(phase), MOST_PHASE) for phase in most),
        f"{found.at_rest:.2g}",
        _marked(float(found.amplitude.max(initial=0.0)), MOST_AMPLITUDE),
        " / ".join(map(_counted, found.failed)),
        f"{1e6 * flow / (2 * PIXELS):.3g}",
        f"{1e6 * full / periods:.3g}",
        f"{real / flow:.3g}",
        f"{real / full:.2g}",
    ]


def _marked(difference: float, most: float) -> str:
    """A difference, in bold where it is too large.

    Examples
    --------
    >>> _marked(0.0312, 0.1), _marked(0.312, 0.1)
    ('0.031', '**0.31**')
    """
    return f"{difference:.2g}" if difference <= most else f"**{difference:.2g}**"


def _counted(number: int) -> str:
    """A number of failures, in bold if there are any."""
    return f"**{number}**" if number else "0"


# Error against line rate


def errors(rates: Sequence[float], say: Say) -> str:
    """The table of errors at each line rate [Hz]."""
    case = MONOSTABLE
    surface = case.surface(1)
    still = simulate(surface, case.scope, case.setpoint, "orbit")
    heads = ("line rate [Hz]", "slow flow: phase [degree]", "height [nm]", "equation: phase [degree]", "height [nm]")
    lines = []
    for rate in rates:
        say(f"error against line rate: {rate:g} Hz")
        cells = [f"{rate:g}"]
        for solver in (SLOW_FLOW, EQUATION):
            image = simulate(surface, case.scope, case.setpoint, solver, replace(case.control, line_rate=rate))
            phase = float(abs(image.phase - still.phase).max())
            height = float(abs(image.tip_offset - still.tip_offset).max())  # over the mean ground of a pixel
            cells += [f"{phase:.3g}", f"{1e9 * height:.3g}"]
        lines.append(cells)
    periods = Feedback(line_rate=1.0).dwell(PIXELS) * case.scope.cantilever.resonance_frequency
    return f"{ERRORS.format(pixels=PIXELS, periods=periods)}\n\n{markdown(heads, lines)}"


# A whole image


def whole_image(size: int, line_rate: float, say: Say) -> str:
    """The table of an image of `size` x `size` pixels at a line rate [Hz]."""
    case, control = MONOSTABLE, Feedback(line_rate=line_rate)
    frequency = case.scope.cantilever.resonance_frequency
    heads = (
        "engine", "a line on one core [s]", "image on one core [s]", "image on all cores [s]",
        "faster than the microscope: one core / all", "failed pixels", "µs a period", f"periods while {PEER} does one",
    )  # fmt: skip
    lines = []
    for name, solver, number in (("slow flow", SLOW_FLOW, size), ("equation", EQUATION, EQUATION_LINES)):
        say(f"lines of a whole image: {name}")
        strip = image_lines(size, number)
        image, seconds = timed_lines(strip, case.scope, case.setpoint, solver, replace(control, engage="image"))
        line = float(np.median(seconds))
        together = simulate(strip, case.scope, case.setpoint, solver, control)
        alone, shared, real = size * line, size * together.attrs["seconds"] / number, size / control.line_rate
        period = line * control.line_rate / frequency
        lines.append([
            name, f"{line:.3g}", f"{alone:.3g}", f"{shared:.3g}", f"{real / alone:.3g} / {real / shared:.3g}",
            _counted(failed(image) + failed(together)), f"{1e6 * period:.3g}", f"{PEER_PERIOD / period:.3g}",
        ])  # fmt: skip
    said = (
        "On one core: processor time of a line after the first (median). "
        f"On all {workers_of(None)} cores: as used, and every line engaged anew. "
        f"{PEER}: {1e6 * PEER_PERIOD:.0f} µs a period, measured elsewhere and not again here."
    )
    return "\n\n".join([IMAGE.format(size=size, rate=line_rate, equation=EQUATION_LINES), markdown(heads, lines), said])
