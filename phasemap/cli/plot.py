"""The command ``phasemap plot``: pictures of what other commands wrote."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from phasemap._shared.errors import PhasemapError
from phasemap.cli.arguments import add_files
from phasemap.cli.colours import add_colours, colours_of

EXAMPLES = """examples:
  phasemap plot blend.nc
  phasemap plot blend.nc -o blend.pdf
  phasemap plot blend.nc --vmin -30 --vmax 60 --cmap height=gray
  phasemap plot rubber.nc --mark-irregular
  phasemap plot ensemble.nc --sample 3
  phasemap plot curve.nc --quantities amplitude,phase,dissipation
  phasemap plot curve.nc --trace 12e-9 -o trace.png
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    about = "file that `phasemap run`, `sweep`, `contrast`, `compare`, `series` or `invert` wrote"
    parser.add_argument("file", metavar="FILE.nc", type=Path, help=about)
    what = parser.add_mutually_exclusive_group()
    what.add_argument(
        "--quantities", metavar="A,B", help="variables of an image or a sweep to draw, such as phase,dissipation"
    )
    what.add_argument("--sample", metavar="N", type=int, help="image of an ensemble, counted from 0")
    what.add_argument("--trace", metavar="AT", help="draw one period at this value, of a sweep made with --samples")
    parser.add_argument("--mark-irregular", action="store_true", help="mark pixels with irregular motion by dots")
    parser.add_argument("--lag", action="store_true", help="draw the phase as the lag, 90 degrees for the free lever")
    add_colours(parser, "a map", "-30 (of the phase) or height=0,phase=-30")
    add_files(parser, "picture to write (.png, .pdf, .svg); default: FILE.png", plot=None, metavar="OUT.png")


def plot(arguments: argparse.Namespace) -> None:
    """Draw an image or a sweep into a file."""
    from phasemap.io.netcdf import load, load_sample
    from phasemap.io.whole_files import check_target
    from phasemap.plot import plot as draw
    from phasemap.plot import trace

    if arguments.file.suffix == ".toml":
        image = arguments.file.with_suffix(".nc").name
        raise PhasemapError(
            f"{arguments.file} is a scene: phasemap run {arguments.file} -o {image}, then plot {image}."
        )
    output = arguments.output or arguments.file.with_suffix(".png")
    check_target(output, arguments.overwrite)
    ds = load(arguments.file) if arguments.sample is None else load_sample(arguments.file, arguments.sample)
    with _as_written_by_phasemap(arguments.file):
        if arguments.trace is not None:
            trace(ds, arguments.trace, output, arguments.overwrite)
        else:
            wanted = arguments.quantities and [name.strip() for name in arguments.quantities.split(",")]
            options = {"variables": wanted, "mark_irregular": arguments.mark_irregular, "lag": arguments.lag}
            draw(ds, output, arguments.overwrite, **options, **colours_of(arguments))
    print(f"written to  {output}")


@contextmanager
def _as_written_by_phasemap(path: Path) -> Iterator[None]:
    """Say of a file, which may come from anywhere, that it is not what it should be."""
    try:
        yield
    except PhasemapError:
        raise
    except (AttributeError, IndexError, KeyError, RecursionError, TypeError, ValueError) as error:
        what = f"{type(error).__name__}: {error}".rstrip(".")
        raise PhasemapError(f"cannot draw {path}: it is not as phasemap writes it ({what}).") from error
