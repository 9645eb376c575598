"""The command ``phasemap plot``: pictures of what other commands wrote."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from phasemap._shared.errors import PhasemapError
from phasemap.cli.arguments import add_files
from phasemap.cli.colours import add_colours, colours_of
from phasemap.cli.fit import add_columns, columns_of

if TYPE_CHECKING:
    import xarray as xr

EXAMPLES = """examples:
  phasemap plot blend.nc
  phasemap plot flake.nid
  phasemap plot curve.txt --columns "z [nm],amplitude [V],lag [degree]"
  phasemap plot blend.nc -o blend.pdf
  phasemap plot blend.nc --vmin -30 --vmax 60 --cmap height=gray
  phasemap plot rubber.nc --mark-irregular
  phasemap plot ensemble.nc --sample 3
  phasemap plot curve.nc --quantities amplitude,phase,dissipation
  phasemap plot curve.nc --trace 12e-9 -o trace.png
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    about = "file that a command wrote, or a measured image or curve: a microscope's file, or columns of text"
    parser.add_argument("file", metavar="FILE", type=Path, help=about)
    add_columns(parser)
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--quantities", metavar="A,B", help="variables to draw, such as phase,dissipation")
    what.add_argument("--sample", metavar="N", type=int, help="image of an ensemble, counted from 0")
    what.add_argument("--trace", metavar="AT", help="draw one period at this value, of a sweep made with --samples")
    parser.add_argument("--mark-irregular", action="store_true", help="mark pixels with irregular motion by dots")
    parser.add_argument("--lag", action="store_true", help="draw the phase as the lag, 90 degrees for the free lever")
    add_colours(parser, "a map", "-30 (of the phase) or height=0,phase=-30")
    add_files(parser, "picture to write (.png, .pdf, .svg); default: FILE.png", plot=None, metavar="OUT.png")


def plot(arguments: argparse.Namespace) -> None:
    """Draw an image or a sweep into a file."""
    from phasemap.io.netcdf import load_sample
    from phasemap.io.whole_files import check_target
    from phasemap.plot import plot as draw
    from phasemap.plot import trace

    if arguments.file.suffix == ".toml":
        file, image = arguments.file, arguments.file.with_suffix(".nc").name
        raise PhasemapError(f"{file} is a scene: phasemap run {file} -o {image}, then plot {image}.")
    output = arguments.output or arguments.file.with_suffix(".png")
    check_target(output, arguments.overwrite)
    ds = _load(arguments) if arguments.sample is None else load_sample(arguments.file, arguments.sample)
    with _as_written_by_phasemap(arguments.file):
        if arguments.trace is not None:
            trace(ds, arguments.trace, output, arguments.overwrite)
        else:
            wanted = arguments.quantities and [name.strip() for name in arguments.quantities.split(",")]
            if wanted is None and "vendor_metadata" in ds.attrs:  # a measured image may lack one of them
                wanted = [name for name in ("height", "phase") if name in ds]
            options = {"variables": wanted, "mark_irregular": arguments.mark_irregular, "lag": arguments.lag}
            draw(ds, output, arguments.overwrite, **options, **colours_of(arguments))
    print(f"written to  {output}")


def _load(arguments: argparse.Namespace) -> xr.Dataset:
    """What a file holds: an image, a curve, or what a command wrote; doubts about it are printed."""
    from phasemap._shared.notices import untold
    from phasemap.io.curves import is_curve, read_curve
    from phasemap.io.netcdf import load
    from phasemap.io.netcdf_image import NETCDF
    from phasemap.io.read import read_image

    path = arguments.file
    if path.suffix.lower() in NETCDF:
        return load(path)
    with untold():
        ds = read_curve(path, **columns_of(arguments)) if is_curve(path) else read_image(path)
    for line in str(ds.attrs.get("warnings", "")).splitlines():
        print(f"note        {line}")
    return ds


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
