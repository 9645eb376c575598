"""From a control in SI units to the numbers of the loop that the kernels read, in lengths and tau."""

from __future__ import annotations

import math

from phasemap._kernels.scanning.loop import Loop
from phasemap._shared.errors import InputError
from phasemap.experiment.accuracy import MOST_PERIODS
from phasemap.experiment.control import Feedback
from phasemap.experiment.excitation import offset_and_factor
from phasemap.experiment.lever import lever_of
from phasemap.experiment.microscope import Microscope

BOLTZMANN = 1.380649e-23  # J/K, exact
FEWEST_PERIODS = 5.0  # over a pixel: fewer say nothing about it
SLOWEST = 10.0  # bandwidth over line rate: a slower lock-in sees lines, not pixels
USUAL = 5e3  # Hz
WIDEST = 0.2  # of the drive frequency: a lock-in as wide passes the oscillation itself


def drive_frequency(scope: Microscope) -> float:
    """Frequency of the drive [Hz]."""
    return scope.frequency_ratio * scope.cantilever.resonance_frequency


def tau_per_second(scope: Microscope) -> float:
    """How much of the kernels' time, omega_c t, passes in a second."""
    return 2 * math.pi * scope.cantilever.resonance_frequency


def bandwidth_of(control: Feedback, scope: Microscope) -> float:
    """Bandwidth of the lock-in [Hz]."""
    return min(USUAL, WIDEST * drive_frequency(scope)) if control.bandwidth is None else control.bandwidth


def check(control: Feedback, scope: Microscope, pixels: int) -> None:
    """Refuse what cannot work with this lever and this many pixels a line."""
    frequency = drive_frequency(scope)
    if control.dwell(pixels) * frequency < FEWEST_PERIODS:
        most = control.dwell(pixels) * control.line_rate * frequency / FEWEST_PERIODS
        raise InputError(
            "line_rate", control.line_rate, f"at most {most:.3g} Hz for {pixels} pixels a line at {frequency:.4g} Hz",
            f"Each pixel needs {FEWEST_PERIODS:g} periods of the drive.",
        )  # fmt: skip
    bandwidth = bandwidth_of(control, scope)
    if bandwidth < SLOWEST * control.line_rate:
        least = f"at least {SLOWEST * control.line_rate:g} Hz, ten times the line rate"
        raise InputError("bandwidth", bandwidth, least)
    for name in ("bandwidth", "scanner_resonance"):
        value = getattr(control, name)
        if value is not None and value > WIDEST * frequency:
            raise InputError(name, value, f"at most {WIDEST * frequency:.4g} Hz, a fifth of the drive frequency")
    if control.integral_gain is not None and control.integral_gain > frequency:
        hint = "The controller acts once a period and would then move by more than the error."
        raise InputError("integral_gain", control.integral_gain, f"at most {frequency:.4g} 1/s", hint)


def loop_of(
    control: Feedback,
    scope: Microscope,
    amplitude: float,
    temperature: float = 0.0,
    detector_noise: float = 0.0,
    periods: int = MOST_PERIODS,
) -> Loop:
    """The loop's numbers; gains that are to be tuned are 0.

    `amplitude`: at the setpoint [m].
    `temperature`: of the lever's own noise [K]; `detector_noise`: its one-sided density [m/sqrt(Hz)].
    `periods`: of the drive, after which an approach is given up.
    """
    tau = tau_per_second(scope)
    loop = Loop()
    loop.setpoint = amplitude
    offset, factor = offset_and_factor(lever_of(scope))  # of A exp(i phase), which is i times a
    loop.factor_re, loop.factor_im, loop.offset_re, loop.offset_im = factor.real, factor.imag, offset.imag, -offset.real
    loop.proportional, loop.integral = control.proportional_gain or 0.0, (control.integral_gain or 0.0) / tau
    loop.derivative = control.derivative_gain * tau
    # Of n equal filters in a row each is wider than all together.
    loop.rate = 2 * math.pi * bandwidth_of(control, scope) / math.sqrt(2 ** (1 / control.order) - 1) / tau
    loop.order = control.order
    if control.scanner_resonance is not None:
        w = 2 * math.pi * control.scanner_resonance / tau
        loop.spring, loop.loss = w * w, w / control.scanner_quality
    loop.highest = math.inf if control.scanner_range is None else control.scanner_range / 2
    loop.lowest = -loop.highest
    loop.thermal_noise = BOLTZMANN * temperature / scope.cantilever.stiffness
    loop.detector_noise = (detector_noise / abs(factor)) ** 2 * tau  # as it is added to a
    loop.most_push = math.inf
    loop.patience = periods * 2 * math.pi / scope.frequency_ratio
    return loop
