"""A line on stderr while kernels are compiled: how far that is, and about how long it will take.

One line after two seconds, too early to say how long it will take; on a terminal it has a bar that moves, and says that
of the part at hand: which others are needed shows later. The environment variable PHASEMAP_QUIET, set to anything,
keeps it away.
"""

from __future__ import annotations

import os
import sys
import threading
import time
from typing import Any

FIRST_WORD = 2.0  # seconds before anything is said
NEXT_WORD = 0.5  # seconds between two of a bar
BAR_WIDTH = 24  # characters
SHARE_OF_THE_END = 0.25  # of the whole time, in which what is typed is optimised and emitted: measured, 0.15 to 0.35


class FirstUse:
    """Progress of compiling the kernels that one entry needs.

    Parameters
    ----------
    expected : int
        Functions that are to be typed.
    """

    said = False  # where there is no bar, one line a process is enough

    def __init__(self, expected: int) -> None:
        self.expected, self.done = max(expected, 1), 0
        self._started = time.monotonic()
        self._ended = threading.Event()
        self._bar = bool(getattr(sys.stderr, "isatty", bool)())

    def __enter__(self) -> FirstUse:
        """Print progress, from a thread of its own, unless PHASEMAP_QUIET is set."""
        if not os.environ.get("PHASEMAP_QUIET"):
            threading.Thread(target=self._print, daemon=True).start()
        return self

    def __exit__(self, *_: Any) -> None:
        self._ended.set()

    def line(self) -> str:
        """Line that is shown: how far the compilation is, and how long it will take."""
        spent = time.monotonic() - self._started
        share = (1.0 - SHARE_OF_THE_END) * min(self.done / self.expected, 1.0)
        left = f", about {max(spent / share - spent, 1.0):.0f} s left of this part" if share > 0.1 else ""
        filled = round(BAR_WIDTH * share)
        bar = (
            f" [{'#' * filled}{'.' * (BAR_WIDTH - filled)}]{left}" if self._bar else ", which may take a minute or more"
        )
        return f"phasemap: compiling kernels for their first use{bar}; later runs load them."

    def _print(self) -> None:
        """Print the line until the work has ended."""
        longest, wait = 0, FIRST_WORD
        while not self._ended.wait(wait):
            line, wait = self.line(), NEXT_WORD
            if not self._bar:
                if not FirstUse.said:
                    print(line, file=sys.stderr, flush=True)
                FirstUse.said = True
                return
            longest = max(longest, len(line))
            print(f"\r{line:<{longest}}", end="", file=sys.stderr, flush=True)
        if longest:
            print("\r" + " " * longest + "\r", end="", file=sys.stderr, flush=True)
