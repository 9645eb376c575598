"""Limits of the work that the page does for one answer, and sentences for work that takes longer.

The solvers are exact at any cost; a page must answer. So each answer has a time, in which compiling does not count, and
each material the periods that it may be integrated.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import NamedTuple

from phasemap._kernels.compilation import watch
from phasemap._shared.errors import InputError, PhasemapError, Word
from phasemap._shared.units import say
from phasemap.experiment.accuracy import MOST_PERIODS, Accuracy
from phasemap.experiment.microscope import Microscope

# LOWEST, HIGHEST: drive over resonance; below, even one period takes too long, and above no lever is driven
LOWEST, HIGHEST = 0.01, 100.0
FULL = 0.1  # drive over resonance above which a material has all its periods; below, as many periods of the resonance


class Limit(NamedTuple):
    """Time that an answer may take."""

    seconds: float
    what: str  # it answers
    command: str = "phasemap run"  # what answers without a limit


# Of the thread that answers: [s] of the processor, for a busy machine is no reason to stop
MOVING, MAP = Limit(10.0, "a setting of the sliders"), Limit(60.0, "a map of the contrast", "phasemap contrast")
WHOLE = Limit(600.0, "a whole image")  # [s] of a clock, for others compute
LIMITS = {"picture": MOVING, "curves": MOVING, "contrast": MAP}


class TooLong(PhasemapError):
    """An answer that takes longer than the page may."""


class Compiling:
    """Watch of the compiler: whether it works now, and how long it did in each thread [s of the processor]."""

    def __init__(self) -> None:
        self._depth, self._began, self._spent = 0, 0.0, threading.local()
        self.first = 0.0  # when it began for the first time [s of a clock]
        watch(self._start, self._end)

    def _start(self) -> None:
        """Note the begin of compilation, in one thread at a time; functions called are compiled within it."""
        self._began = self._began if self._depth else time.thread_time()
        self.first = self.first or time.monotonic()
        self._depth += 1

    def _end(self) -> None:
        """Note the end of compilation."""
        self._depth -= 1
        if not self._depth:
            self._spent.seconds = self.spent + time.thread_time() - self._began

    @property
    def going_on(self) -> bool:
        """True while kernels are compiled."""
        return self._depth > 0

    @property
    def spent(self) -> float:
        """Time that this thread compiled."""
        return float(getattr(self._spent, "seconds", 0.0))


compiling = Compiling()


def limiter(name: str, scope: Microscope) -> Callable[[], None]:
    """Function that raises `TooLong` once the time of the answer that begins now, by its name in the page, is over."""
    limit = LIMITS.get(name, WHOLE)

    def clock() -> float:
        return time.monotonic() if limit is WHOLE else time.thread_time() - compiling.spent

    began = clock()

    def check() -> None:
        if clock() - began > limit.seconds:
            why = far_off(scope) or "Set the sliders back a little."
            raise TooLong(
                f"This takes longer than the {limit.seconds:g} s that the page has for {limit.what}. {why} "
                f"The scene that the page saves runs without a limit, by {limit.command}."
            )

    return check


def accuracy_of(scope: Microscope) -> Accuracy:
    """The accuracy of what is shown: the default, but fewer periods where each of them is long."""
    return Accuracy(periods=max(1, round(MOST_PERIODS * min(1.0, scope.frequency_ratio / FULL))))


def check_frequency(scope: Microscope) -> None:
    """Refuse a drive so slow that a single period of it takes too long; no answer could be stopped in time."""
    if not LOWEST <= scope.frequency_ratio <= HIGHEST:
        resonance = scope.cantilever.resonance_frequency
        low, high, drive = (say(ratio * resonance, "Hz") for ratio in (LOWEST, HIGHEST, scope.frequency_ratio))
        allowed = f"{low} to {high} in the page, for a resonance at {say(resonance, 'Hz')}"
        hint = "So far from it each material is integrated in time, which takes minutes; phasemap run does it."
        raise InputError("drive frequency", Word(drive), allowed, hint)


def far_off(scope: Microscope) -> str:
    """A sentence where the drive is far from the resonance; else nothing."""
    from phasemap._kernels.lever import NEAREST

    if abs(1 - scope.frequency_ratio**2) < NEAREST:
        return ""
    resonance = scope.cantilever.resonance_frequency
    drive = say(scope.frequency_ratio * resonance, "Hz", 4)
    return (
        f"The drive at {drive} is far from the resonance at {say(resonance, 'Hz', 4)}, where each material is "
        "integrated in time, which takes long. A frequency nearer to the resonance is solved at once."
    )
