"""What commands say while they work."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

T = TypeVar("T")

INTERRUPTED = 130  # exit code: 128 + SIGINT, as shells have it
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


class EndlessError(Exception):
    """Work that did not end in its time."""


_left: list[threading.Thread] = []  # threads nobody waits for any more


def interruptible(task: Callable[[], T], limit: float | None = None) -> T:
    """Return what the task does, or stop waiting for it, whatever it is doing.

    Compiled code cannot be interrupted: it goes on in the background, and `still_busy` says so.

    Parameters
    ----------
    task : callable
    limit : float, optional
        How long to wait [s].

    Raises
    ------
    KeyboardInterrupt
        At Ctrl-C.
    EndlessError
        After the limit.
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
        worker.join(limit)
        if worker.is_alive():
            raise EndlessError
    except BaseException:
        _left.append(worker)
        raise
    if failed:
        raise failed[0]
    return done[0]


def still_busy() -> bool:
    """Whether something goes on in the background: end the process by `os._exit`, or it waits for that, or crashes."""
    return any(worker.is_alive() for worker in _left)


@contextmanager
def starting() -> Iterator[None]:
    """Let Ctrl-C end the process at once while nothing is done yet: in an import, libraries make other errors of it."""

    def end(*_: object) -> None:
        print("phasemap: interrupted; nothing was written.", file=sys.stderr, flush=True)
        os._exit(INTERRUPTED)

    in_main = threading.current_thread() is threading.main_thread()
    if not in_main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    signal.signal(signal.SIGINT, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
