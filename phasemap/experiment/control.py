"""Control: how the tip comes to the setpoint, and keeps it from pixel to pixel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol

from phasemap._shared.checks import check_choice, whole
from phasemap._shared.errors import InputError
from phasemap._shared.fields import Number, Shown, known_as

LINES = ("trace", "retrace")
_WHEN = {"line": "tip lowered anew before each line", "image": "tip lowered once, before the first line"}


class Control(Protocol):
    """Protocol of every control."""

    directions: ClassVar[tuple[str, ...]]
    """Passes over a line that are recorded; none where a pixel has no history."""
    in_time: ClassVar[bool]
    """True if time passes while the tip moves on."""

    @property
    def carried(self) -> bool:
        """True if the tip comes to a line as it left the line before."""
        ...


@dataclass(frozen=True, repr=False)
class Engage(Shown):
    """Each pixel engaged anew from far away, quasi-statically.

    The tip follows the stable orbit while its offset decreases, jumps where the orbit folds, and stops where the
    amplitude first reaches the setpoint. The branch (attractive or repulsive) is therefore the physical one and does
    not depend on the solver.
    """

    directions: ClassVar[tuple[str, ...]] = ()
    in_time: ClassVar[bool] = False

    @property
    def carried(self) -> bool:
        """False: no pixel knows of another."""
        return False

    def __str__(self) -> str:
        return "tip lowered onto each pixel (no memory of its neighbours)"


class _OverLines:
    """Base of controls that take the tip over lines, there and back."""

    directions: ClassVar[tuple[str, ...]] = LINES
    engage: str

    @property
    def carried(self) -> bool:
        """True if the tip is engaged only once."""
        return self.engage == "image"


@known_as()
@dataclass(frozen=True, repr=False)
class Raster(_OverLines, Shown):
    """Quasi-static scan: the state of the oscillation is carried from pixel to pixel, along trace and retrace.

    The feedback and the lever are at rest at every pixel. Where two stable orbits hold the setpoint, the tip stays on
    the branch (attractive or repulsive) on which it comes, and leaves it only where the branch ends; trace and retrace
    of a bistable surface therefore differ.

    Parameters
    ----------
    engage : {"line", "image"}
        Whether the tip is engaged anew, from far, before each line, or once before the first.
    """

    in_time: ClassVar[bool] = False

    engage: str = "line"

    def __post_init__(self) -> None:
        check_choice("engage", self.engage, _WHEN)

    def __str__(self) -> str:
        return f"quasi-static scan, {_WHEN[self.engage]}"


@known_as()
@dataclass(frozen=True, repr=False)
class Feedback(_OverLines, Shown):
    """Scan in time: lock-in, PI controller and scanner follow the surface that passes under the tip.

    The surface passes at constant speed, there and back; a line with its overscan takes ``1 / line_rate``. The lock-in
    is a cascade of low-pass filters on the complex amplitude. With the error e = amplitude - setpoint amplitude the
    scanner is sent to ``-(Kp e + Ki integral(e dt) + Kd de/dt)``: it comes nearer where the amplitude is too large.

    Parameters
    ----------
    line_rate : float
        Lines a second [Hz], each of them trace and retrace.
    proportional_gain : float, optional
        Kp [1], metre of the scanner by metre of amplitude; None is tuned.
    integral_gain : float, optional
        Ki [1/s]; None is tuned.
    derivative_gain : float
        Kd [s].
    bandwidth : float, optional
        Of the lock-in, at -3 dB [Hz]; None is 5 kHz, or a fifth of the drive frequency where that is less.
    order : int
        Of its low-pass filter, 1 to 4.
    scanner_resonance : float, optional
        [Hz]; None is a scanner that follows at once.
    scanner_quality : float
        Quality factor of that resonance [1].
    scanner_range : float, optional
        Travel of the scanner [m], half of it up and half of it down from where it engaged; None is unlimited.
    overscan : float
        Part of the line by which the tip runs on at both ends, where it turns at constant acceleration.
    engage : {"line", "image"}
        Whether the tip is engaged anew, from far, before each line, or once before the first.

    Examples
    --------
    >>> control = Feedback(line_rate=2.0)
    >>> round(control.dwell(512) * 1e3, 3)
    0.407
    """

    in_time: ClassVar[bool] = True

    line_rate: Number[float] = Number("Hz", 1.0, above=0, usual=(1e-3, 1e4))
    proportional_gain: Number[float | None] = Number("1", None, minimum=0)
    integral_gain: Number[float | None] = Number("1/s", None, minimum=0)
    derivative_gain: Number[float] = Number("s", 0.0, minimum=0)
    bandwidth: Number[float | None] = Number("Hz", None, above=0, usual=(1.0, 1e7))
    order: int = 2
    scanner_resonance: Number[float | None] = Number("Hz", None, above=0, usual=(10.0, 1e7))
    scanner_quality: Number[float] = Number("1", 10.0, above=0)
    scanner_range: Number[float | None] = Number("m", None, above=0, usual=(1e-9, 1e-3))
    overscan: Number[float] = Number("1", 0.05, minimum=0, maximum=1)
    engage: str = "line"

    def __post_init__(self) -> None:
        if (self.proportional_gain is None) != (self.integral_gain is None):
            known = "proportional_gain" if self.integral_gain is None else "integral_gain"
            raise InputError(known, getattr(self, known), "both gains, or None for both, which tunes them")
        whole("order", self.order, 1, 4)
        check_choice("engage", self.engage, _WHEN)

    def __str__(self) -> str:
        return f"feedback in time, line rate {self.line_rate:g} Hz, {_WHEN[self.engage]}"

    def dwell(self, pixels: int) -> float:
        """Time over each of the pixels of a line [s].

        A turn at constant acceleration that runs on by a part o of the line takes as long as 4 o of the line, twice in
        each period.
        """
        whole("pixels", pixels, 1)
        return 1 / (self.line_rate * 2 * (1 + 4 * self.overscan) * pixels)
