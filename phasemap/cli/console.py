"""What commands say while they work."""

from __future__ import annotations

import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from phasemap._shared.notices import ResultWarning
from phasemap._shared.plausible import PlausibilityWarning

PATIENCE = 3.0  # seconds without a first result after which a word is due
STILL_COMPILING = "phasemap: no result yet; kernels are compiled for their first use, later runs load them."


@contextmanager
def patience() -> Iterator[Callable[[], None]]:
    """Say on stderr why nothing has come yet, unless the function that is lent is called in time."""
    timer = threading.Timer(PATIENCE, print, [STILL_COMPILING], {"file": sys.stderr})
    timer.daemon = True
    timer.start()
    try:
        yield timer.cancel
    finally:
        timer.cancel()


@contextmanager
def plain_warnings() -> Iterator[None]:
    """Let warnings that are for users be one sentence, without the line of code that they come from."""
    usual = warnings.formatwarning

    def sentence(
        message: Warning | str, category: type[Warning], filename: str, lineno: int, line: str | None = None
    ) -> str:
        plain = category is UserWarning or issubclass(category, (PlausibilityWarning, ResultWarning))
        return f"phasemap: {message}\n" if plain else usual(message, category, filename, lineno, line)

    warnings.formatwarning = sentence
    try:
        yield
    finally:
        warnings.formatwarning = usual
