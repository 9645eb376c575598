"""The commands ``phasemap plot``, ``scene``, from a measured image to a scene, and ``export``, to Gwyddion."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from phasemap._shared.errors import PhasemapError
from phasemap._shared.files import check_target
from phasemap._shared.notices import untold
from phasemap._shared.units import image_size
from phasemap.cli.arguments import add_colours, add_files, add_options, add_overrides, colours_of, whole_number
from phasemap.cli.explain import add_columns, columns_of

if TYPE_CHECKING:
    import xarray as xr

PLOT_EXAMPLES = """examples:
  phasemap plot blend.nc
  phasemap plot flake.nid
  phasemap plot curve.txt --columns "z [nm],amplitude [V],lag [degree]"
  phasemap plot blend.nc -o blend.pdf
  phasemap plot at50.nc at65.nc at80.nc
  phasemap plot blend.nc --vmin -30 --vmax 60 --cmap height=gray
  phasemap plot rubber.nc --mark-irregular
  phasemap plot ensemble.nc --sample 3
  phasemap plot curve.nc --quantities amplitude,phase,dissipation
  phasemap plot curve.nc --trace 12e-9 -o trace.png
"""


def add_plot(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    about = "file that a command wrote, or a measured image or curve: a microscope's file, or columns of text"
    parser.add_argument("files", metavar="FILE", type=Path, nargs="+", help=f"{about}; images share their colours")
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
    """Draw images, sweeps and more into files, images with the same colours for the same values."""
    from phasemap.io.netcdf import load
    from phasemap.plot import plot as draw
    from phasemap.plot import trace
    from phasemap.plot.images import colours_for_all

    files = arguments.files
    for file in files:
        if file.suffix == ".toml":
            image = file.with_suffix(".nc").name
            raise PhasemapError(f"{file} is a scene: phasemap run {file} -o {image}, then plot {image}.")
    if arguments.output and len(files) > 1:
        raise PhasemapError("-o is for one FILE: of several, each is drawn into FILE.png.")
    outputs = [arguments.output or file.with_suffix(".png") for file in files]
    for output in outputs:
        check_target(output, arguments.overwrite)
    each = [_load(arguments, one) if arguments.sample is None else load(one, arguments.sample) for one in files]
    wanted = arguments.quantities and [name.strip() for name in arguments.quantities.split(",")]
    colours = [{name: one for name, one in colours_of(arguments).items() if one is not None}] * len(each)
    if len(each) > 1 and all({"y", "x"} <= set(ds.dims) and "flag" not in ds and "residual" not in ds for ds in each):
        colours = colours_for_all(each, wanted, arguments.lag, colours[0])
    for file, ds, output, own_colours in zip(files, each, outputs, colours, strict=True):
        with _as_written_by_phasemap(file):
            if arguments.trace is not None:
                trace(ds, arguments.trace, output, arguments.overwrite)
            else:
                options = {"variables": wanted, "mark_irregular": arguments.mark_irregular, "lag": arguments.lag}
                draw(ds, output, arguments.overwrite, **options, **own_colours)
        print(f"written to  {output}")


def _load(arguments: argparse.Namespace, path: Path) -> xr.Dataset:
    """Dataset in a file: an image, a curve, or what a command wrote; doubts about it are printed."""
    from phasemap.io.curves import is_curve, read_curve
    from phasemap.io.netcdf import load
    from phasemap.io.read import NETCDF, read_image

    if path.suffix.lower() in NETCDF:
        return load(path)
    with untold():
        ds = read_curve(path, **columns_of(arguments)) if is_curve(path) else read_image(path)
    _print_warnings(ds)
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


SCENE_EXAMPLES = """examples:
  phasemap scene MoS2.nid -o mos2.toml tip.radius=10e-9 drive.free_amplitude=40e-9
  phasemap scene grains.001 -o grains.toml --phases 3 --direction retrace scan.setpoint=0.7
  phasemap run mos2.toml -o mos2.nc

What the file does not say is asked for. The materials are placeholders: change them in the scene, or give
materials.material_0.modulus=1e9, counted from the lowest phase.
"""
EXPORT_EXAMPLES = """examples:
  phasemap export blend.nc blend.gwy
  phasemap export blend.nc phase.gsf --variable phase
  phasemap export MoS2.nid backward.gwy --direction retrace
"""


def add_scene(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of ``phasemap scene``."""
    parser.usage = "%(prog)s IMAGE [-o SCENE.toml] [--phases N] [options] [key=value ...]"
    parser.add_argument("image", metavar="IMAGE", type=Path, help="a microscope's file, or an image in netCDF")
    add_overrides(parser)
    about = "number of materials to distinguish; default: 2, or 1 if the image shows only one"
    parser.add_argument("--phases", type=whole_number, metavar="N", help=about)
    about = "channel that distinguishes the materials; default: phase"
    parser.add_argument("--by", choices=("phase", "height"), default="phase", help=about)
    parser.add_argument("--height", metavar="NAME", help="channel of the height; default: the first")
    parser.add_argument("--phase", metavar="NAME", help="channel of the phase; default: the first")
    parser.add_argument("--direction", metavar="NAME", help="trace or retrace; default: the first in the file")
    add_files(parser, "scene to write; default: IMAGE.toml", plot=None, metavar="SCENE.toml")
    add_options(parser, "strict-units")


def add_export(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of ``phasemap export``."""
    parser.add_argument("image", metavar="IMAGE", type=Path, help="an image in netCDF, or a microscope's file")
    parser.add_argument("output", metavar="OUT", type=Path, help="file to write, .gwy or .gsf")
    parser.add_argument("--variable", metavar="NAME", help="write this variable only; a .gsf file holds one")
    parser.add_argument("--direction", metavar="NAME", help="write trace or retrace only")
    parser.add_argument("--lag", action="store_true", help="write the phase as the lag, 90 degrees for the free lever")
    parser.add_argument("--overwrite", action="store_true", help="replace an existing file")


def scene(arguments: argparse.Namespace) -> None:
    """Write the scene of a measured image."""
    from phasemap.io.read import read_image
    from phasemap.scenes.measured import scene_from

    output = check_target(arguments.output or arguments.image.with_suffix(".toml"), arguments.overwrite)
    with untold():  # it is printed below
        image = read_image(arguments.image, height=arguments.height, phase=arguments.phase)
    _print_warnings(image)  # what is missing may stand there
    options = {"direction": arguments.direction, "by": arguments.by, "overwrite": arguments.overwrite}
    made = scene_from(image, output, arguments.phases, arguments.overrides, **options)
    print(f"image       {image_size(made.surface.shape, made.surface.pixel_size)}")
    for line in output.read_text(encoding="utf-8").splitlines():
        if line.startswith("[materials."):
            name, _, share = line.removeprefix("[materials.").partition("]")
            print(f"{name:<12}{share.removeprefix('  # ')}")
    print(f"written to  {output}")


def export(arguments: argparse.Namespace) -> None:
    """Write an image for Gwyddion."""
    from phasemap.io.export import export as write
    from phasemap.io.read import read_image
    from phasemap.results.channels import as_lag

    with untold():
        image = read_image(arguments.image)
    if arguments.lag and "phase" in image:
        image = as_lag(image)
    write(image, arguments.output, arguments.variable, arguments.direction, overwrite=arguments.overwrite)
    _print_warnings(image)
    print(f"written to  {arguments.output}")


def _print_warnings(image: xr.Dataset) -> None:
    """Print the reader's warnings about the file."""
    for line in str(image.attrs.get("warnings", "")).splitlines():
        print(f"note        {line}")
