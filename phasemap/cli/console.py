"""Output of commands: while they work, and in their summaries."""

from __future__ import annotations

import sys
import textwrap
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from phasemap._shared.notices import PlausibilityWarning, ResultWarning

if TYPE_CHECKING:
    import xarray as xr

WIDTH = 100  # letters on a line of a summary, beside its words


def bar_of(unit: str) -> Any:
    """Make a bar on stderr, which is drawn if the work takes more than a second."""
    from tqdm import tqdm

    interval = 0.1 if sys.stderr.isatty() else 10.0
    return tqdm(delay=1.0, mininterval=interval, unit=unit, file=sys.stderr, leave=False)


@contextmanager
def progress_bar(unit: str, quiet: bool = False) -> Iterator[Callable[[int, int], None] | None]:
    """Yield a function of the work done and of all work, which draws a bar; None where no bar is wanted."""
    if quiet:
        yield None
        return
    with bar_of(unit) as bar:

        def progress(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        yield progress


def in_two_columns(texts: Iterable[tuple[str, str]], first: int = 12) -> list[str]:
    """Lay out words, each where it changes, beside what is said of them. `first`: width of the column of words."""
    lines, before = [], ""
    for word, text in texts:
        for line in textwrap.wrap(text, WIDTH):
            lines.append(f"{'' if word == before else word:<{first}}{line}")
            before = word
    return lines


def remarks(ds: xr.Dataset, what: str = "pixels") -> list[str]:
    """Lines below a summary: on motion, on the limits of the model, and on failures."""
    from phasemap.results.descriptions import describe_failures, describe_irregular, describe_validity

    texts = {
        "motion": describe_irregular(ds, what),
        "validity": describe_validity(ds, what),
        "failed": describe_failures(ds, what) or ["none"],
    }
    return [f"{word:<12}{line}" for word, lines in texts.items() for line in lines]


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
