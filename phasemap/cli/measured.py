"""The commands ``phasemap scene``, from a measured image to a scene, and ``phasemap export``, to Gwyddion."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from phasemap._shared.notices import untold
from phasemap._shared.sentences import image_size
from phasemap.cli.arguments import add_files, add_options, add_overrides, whole

if TYPE_CHECKING:
    import xarray as xr

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
    parser.add_argument("--phases", type=whole, metavar="N", help=about)
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
    from phasemap.io.whole_files import check_target
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
    from phasemap.results.variables import phase_lag

    with untold():
        image = read_image(arguments.image)
    if arguments.lag and "phase" in image:
        image = image.assign(phase=phase_lag(image["phase"]))
    write(image, arguments.output, arguments.variable, arguments.direction, overwrite=arguments.overwrite)
    _print_warnings(image)
    print(f"written to  {arguments.output}")


def _print_warnings(image: xr.Dataset) -> None:
    """What the reader has to say about the file."""
    for line in str(image.attrs.get("warnings", "")).splitlines():
        print(f"note        {line}")
