"""The command ``phasemap check``: whether what an image says of itself holds."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from phasemap._shared.interrupts import interruptible
from phasemap._shared.units import image_size
from phasemap.cli.arguments import add_options, whole
from phasemap.cli.console import progress_bar

if TYPE_CHECKING:
    import xarray as xr

    from phasemap.experiment.surface import Surface
    from phasemap.validation.checking.result import Check

FAILED = 1  # exit code where a claim fails
EXAMPLES = """examples:
  phasemap check blend.nc
  phasemap check blend.nc --pixels 500 --seed 7
  phasemap check flake.nc --scene flake.toml
  phasemap check image.nc --surface surface.nc

Exit code: 0 if no claim fails, 1 if one does, 2 if there is nothing to check (a file that cannot be read, no surface).
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument("image", metavar="IMAGE.nc", type=Path, help="simulated image, as `phasemap run` wrote it")
    about = "pixels also integrated in time; default: 64"
    parser.add_argument("--pixels", type=whole, default=64, metavar="N", help=about)
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="seed of the choice of pixels; default: 0")
    surface = parser.add_mutually_exclusive_group()
    about = "scene of the surface; default: the image's own"
    surface.add_argument("--scene", metavar="SCENE.toml", type=Path, help=about)
    surface.add_argument("--surface", metavar="SURFACE.nc", type=Path, help="file whose surface is used")
    add_options(parser, "threads")
    parser.add_argument("--quiet", action="store_true", help="the verdict only")


def check(arguments: argparse.Namespace) -> int:
    """Check an image and say what was found; returns the exit code."""
    from phasemap.io.netcdf import load

    image = load(arguments.image)
    surface = _surface(arguments)
    found = interruptible(lambda: _checked(image, surface, arguments))
    print(found.verdict if arguments.quiet else "\n".join([*_header(image), "", str(found)]))
    return 0 if found.holds else FAILED


def _surface(arguments: argparse.Namespace) -> Surface | None:
    """The surface that is named, None for that of the image's scene."""
    from phasemap.experiment.surface import Surface
    from phasemap.io.netcdf import load
    from phasemap.scenes.scene import load_scene

    if arguments.scene is not None:
        return load_scene(arguments.scene).surface
    return None if arguments.surface is None else Surface.from_dataset(load(arguments.surface), allow_nan=True)


def _checked(image: xr.Dataset, surface: Surface | None, arguments: argparse.Namespace) -> Check:
    """Check, with a bar on stderr."""
    from phasemap.validation.checking.check import check as check_image

    with progress_bar("", arguments.quiet) as progress:
        return check_image(
            image, surface, folders=(arguments.image.parent, "."), pixels=arguments.pixels, seed=arguments.seed,
            threads=arguments.threads, progress=progress,
        )  # fmt: skip


def _header(image: xr.Dataset) -> list[str]:
    """Lines about the image that is checked."""
    from phasemap.validation.checking.claims import claims_of

    claims = claims_of(image)
    control = " ".join(filter(None, (str(claims.control), str(claims.realism) and f"with {claims.realism}")))
    return [
        f"image    {image_size(claims.shape, claims.pixel_size)}",
        f"made by  phasemap {str(image.attrs.get('phasemap_version', ''))[:20]}, solver {claims.solver}, {control}",
    ]
