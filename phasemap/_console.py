"""What commands say while they work."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

T = TypeVar("T")

PATIENCE = 3.0  # seconds without a first result after which a word is due
STILL_COMPILING = "phasemap: no result yet; a first run compiles the solvers, about a minute, later runs start at once."


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


class Abandoned(KeyboardInterrupt):
    """Ctrl-C while work goes on in the background, for compiled code cannot be interrupted: end the process."""


def interruptible(task: Callable[[], T]) -> T:
    """Return what the task does, or stop waiting for it at Ctrl-C, whatever it is doing.

    Raises
    ------
    Abandoned
        At Ctrl-C.
    """
    done: list[T] = []
    failed: list[BaseException] = []

    def work() -> None:
        try:
            done.append(task())
        except BaseException as error:
            failed.append(error)

    worker = threading.Thread(target=work, daemon=True)
    worker.start()
    try:
        worker.join()
    except KeyboardInterrupt:
        raise Abandoned from None
    if failed:
        raise failed[0]
    return done[0]
