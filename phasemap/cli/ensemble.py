"""The commands ``phasemap run`` and ``validate`` where the scene is an ensemble."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from phasemap._shared.errors import PhasemapError
from phasemap._shared.interrupts import ending_at_once
from phasemap._shared.sentences import counted
from phasemap.cli.console import bar_of, patience

if TYPE_CHECKING:
    from phasemap.scenes.ensemble import Ensemble

Progress = Callable[[int, int], None]

FEW = 6  # values that are listed


def run(arguments: argparse.Namespace, ensemble: Ensemble, output: Path) -> None:
    """Simulate an ensemble into a file; Ctrl-C says what is kept."""
    from phasemap._shared.threads import workers_of
    from phasemap.scenes.data_card import card_beside

    if arguments.threads or arguments.strict:
        option = "--threads" if arguments.threads else "--strict"
        raise PhasemapError(f"{option} is for one image; an ensemble takes --workers, and its file counts what failed.")
    started, workers = time.perf_counter(), workers_of(arguments.workers)
    if arguments.quiet:
        with _resumable(output) as watched:
            ensemble.simulate(output, workers=workers, overwrite=arguments.overwrite, progress=watched)
        return
    with patience() as first_result, _bar(first_result) as shown, _resumable(output, shown) as watched:
        ensemble.simulate(output, workers=workers, overwrite=arguments.overwrite, progress=watched)
    with ending_at_once(f"the images are in {output}"):
        print_ensemble(ensemble)
        if (irregular := _count(output, "irregular")) != "none":
            print(f"motion      {irregular} irregular")
        print(f"failed      {_count(output, 'failed')}")
        print(f"took        {time.perf_counter() - started:.2f} s")
        print(f"written to  {output}\ndata card   {card_beside(output)}")


def print_ensemble(ensemble: Ensemble) -> None:
    """How many samples there are, and what is varied from where to where."""
    print(f"samples     {len(ensemble)}")
    for key in ensemble.keys:
        values = [sample[key] for sample in ensemble.samples]
        if all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in values):
            said = f"{min(values):.6g} to {max(values):.6g}"
        else:
            words = sorted({str(value) for value in values})
            said = ", ".join(words) if len(words) <= FEW else f"{len(words)} values, such as {words[0]}"
        print(f"varied      {key}: {said}")


@contextmanager
def _resumable(output: Path, shown: Progress | None = None) -> Iterator[Progress]:
    """Give a function of progress that remembers it, so that an interrupt can say what is kept."""
    kept = "nothing was written"

    def progress(done: int, total: int) -> None:
        nonlocal kept
        if done:
            kept = f"{done} of {total} samples are kept in {output}.parts; run the same command again to go on"
        if shown is not None:
            shown(done, total)

    try:
        yield progress
    except KeyboardInterrupt:
        raise KeyboardInterrupt(kept) from None


@contextmanager
def _bar(first_result: Callable[[], None]) -> Iterator[Progress]:
    """Give a function of progress that draws a bar on stderr if it takes more than a second."""
    with bar_of(" samples") as bar:

        def progress(done: int, total: int) -> None:
            if bar.total is None:  # the first call says what an earlier run has done
                bar.total, bar.initial = total, done
                if done:
                    print(f"phasemap: {done} of {total} samples were done already.", file=sys.stderr)
            if done == total or done > bar.initial:
                first_result()
            bar.update(done - bar.n)

        yield progress


def _count(output: Path, name: str) -> str:
    """How many pixels of how many samples "failed" or are "irregular", in words."""
    import numpy as np
    import xarray as xr

    with xr.open_dataset(output, engine="zarr" if output.suffix == ".zarr" else "netcdf4") as ds:
        counts, pixels = ds[name].values if name in ds else np.zeros(1), ds["status"].size
    count = int(counts.sum())
    if not count:
        return "none"
    return f"{counted(count, pixels, 'pixels')}, in {int((counts > 0).sum())} samples"
