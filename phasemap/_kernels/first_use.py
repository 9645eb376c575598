"""A word on stderr while kernels are compiled: what for, how far it is, and about how long it will take.

One line after two seconds; on a terminal it has a bar that moves. The environment variable PHASEMAP_QUIET, set to
anything, keeps it away.
"""

from __future__ import annotations

import os
import sys
import threading
import time
from typing import Any

PATIENCE, EVERY = 2.0, 0.5  # seconds before the first word, and between two of a bar
WIDTH = 24
SHARE_OF_THE_END = 0.25  # of the whole time, in which what is typed is optimised and emitted: measured, 0.15 to 0.35


class FirstUse:
    """The kernels that one entry needs, as they are compiled.

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
        if not os.environ.get("PHASEMAP_QUIET"):
            threading.Thread(target=self._speak, daemon=True).start()
        return self

    def __exit__(self, *_: Any) -> None:
        self._ended.set()

    def line(self) -> str:
        """What to say now."""
        spent = time.monotonic() - self._started
        share = (1.0 - SHARE_OF_THE_END) * min(self.done / self.expected, 1.0)
        left = f", about {max(spent / share - spent, 1.0):.0f} s left" if share > 0.1 else ""
        filled = round(WIDTH * share)
        bar = f" [{'#' * filled}{'.' * (WIDTH - filled)}]" if self._bar else ""
        return f"phasemap: compiling kernels for their first use{bar}{left}; later runs load them."

    def _speak(self) -> None:
        """Say it until the work has ended."""
        longest, wait = 0, PATIENCE
        while not self._ended.wait(wait):
            line, wait = self.line(), EVERY
            if not self._bar:
                if not FirstUse.said:
                    print(line, file=sys.stderr, flush=True)
                FirstUse.said = True
                return
            longest = max(longest, len(line))
            print(f"\r{line:<{longest}}", end="", file=sys.stderr, flush=True)
        if longest:
            print("\r" + " " * longest + "\r", end="", file=sys.stderr, flush=True)
