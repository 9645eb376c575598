"""Ctrl-C, SIGTERM and work that is no longer wanted: how all end, without harm to files and without a traceback."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

from phasemap._shared.notices import temporarily

T = TypeVar("T")

STOPPING = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}  # what stops a command, in words
GRACE = 1.0  # seconds after Ctrl-C in which another one changes nothing


class EndlessError(Exception):
    """Work that did not end in its time."""


_check: ContextVar[Callable[[], None]] = ContextVar("_check", default=lambda: None)


@contextmanager
def stoppable(check: Callable[[], None]) -> Iterator[None]:
    """Let work of this thread call `check` every now and then, which raises where the work is to end.

    It is called between compiled functions, which cannot be stopped, and most of which take milliseconds.
    """
    with temporarily(_check, check):
        yield


def check_stopped() -> None:
    """Raise the error that ends the work of this thread, if it is to end."""
    _check.get()()


_stopped_by = signal.SIGINT
_left: list[threading.Event] = []  # the ends of what nobody waits for any more


def interruptible(task: Callable[[], T], limit: float | None = None) -> T:
    """Result of the task; stop waiting for it at Ctrl-C, or with EndlessError after the limit [s].

    Compiled code cannot be interrupted: it goes on in the background, and `still_busy` says so.
    """
    done: list[T] = []
    failed: list[BaseException] = []
    ended = threading.Event()  # until Python 3.13 a thread is taken for dead once its `join` was interrupted

    def work() -> None:
        try:
            done.append(task())
        except BaseException as error:
            failed.append(error)
        finally:
            ended.set()

    try:
        threading.Thread(target=work, daemon=True).start()
        if not ended.wait(limit):
            raise EndlessError
    except BaseException:
        _left.append(ended)
        raise
    if failed:
        raise failed[0]
    return done[0]


def stopped(state: str = "") -> int:
    """Say on stderr what stopped the command and what is left of it; returns the exit code, as shells have it."""
    print(f"phasemap: {STOPPING[_stopped_by]}; {state or 'nothing was written'}.", file=sys.stderr, flush=True)
    return 128 + _stopped_by


def leave(ended: threading.Event) -> None:
    """Wait no more for what goes on in threads of its own until this is set; `still_busy` says so."""
    _left.append(ended)


def still_busy() -> bool:
    """True if something goes on in the background: end the process by `os._exit`, or it waits for that, or crashes."""
    return not all(ended.is_set() for ended in _left)


@contextmanager
def ending_at_once(done: str = "nothing was written") -> Iterator[None]:
    """Let Ctrl-C end the process at once and say what is done: in an import, libraries make other errors of it."""

    def end() -> None:
        os._exit(stopped(done))

    with _at_interrupt(end):
        yield


@contextmanager
def interrupted_once() -> Iterator[None]:
    """Let Ctrl-C or SIGTERM raise KeyboardInterrupt once: more of them should not break what that sets going."""

    def interrupt() -> None:
        raise KeyboardInterrupt

    with _at_interrupt(interrupt):
        yield


class _Once:
    """Handler that acts once at Ctrl-C; at another one some time later, for the first may be lost, the process ends."""

    def __init__(self, do: Callable[[], None]) -> None:
        self._do = do
        self._since: float | None = None

    def __call__(self, by: int, _: object) -> None:
        global _stopped_by
        if self._since is None:
            self._since, _stopped_by = time.monotonic(), signal.Signals(by)
            self._do()
        elif time.monotonic() - self._since > GRACE:
            os._exit(128 + _stopped_by)


@contextmanager
def _at_interrupt(do: Callable[[], None]) -> Iterator[None]:
    """Do something at Ctrl-C or SIGTERM, unless that is seen to by others."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    once, before = _Once(do), {}
    for by, usual in ((signal.SIGINT, signal.default_int_handler), (signal.SIGTERM, signal.SIG_DFL)):
        handler = signal.getsignal(by)
        if isinstance(handler, _Once) or handler is usual:
            before[by] = signal.signal(by, once)
    try:
        yield
    finally:
        for by, handler in before.items():
            signal.signal(by, handler)
