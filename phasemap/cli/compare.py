"""The commands ``phasemap compare``, for two images, and ``check``, whether what an image says of itself holds."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from phasemap._shared.errors import InputError
from phasemap._shared.interrupts import interruptible
from phasemap._shared.units import image_size
from phasemap.cli.arguments import (
    add_colours,
    add_files,
    add_options,
    check_files,
    colours_of,
    conclude,
    number_in,
    number_or_range,
    whole_number,
)
from phasemap.cli.console import in_two_columns, progress_bar

if TYPE_CHECKING:
    import xarray as xr

    from phasemap.experiment.surface import Surface
    from phasemap.validation.picture import Check

COMPARE_EXAMPLES = """examples:
  phasemap compare measured.nid simulated.nc --plot page.png
  phasemap compare measured.ibw simulated.nc -o result.nc --offset fixed
  phasemap compare measured.nid simulated.nc --offset 62.5 --sign -1 --regions 3 --plot page.pdf
  phasemap compare scan.nc scan.nc --direction trace,retrace --limit 100e-9 --plot page.png

Files are netCDF (.nc), or what an instrument wrote: pip install "afm-phasemap[read,compare]".
"""


def add_compare(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument("measured", metavar="MEASURED", type=Path, help="measured image: a microscope's file or netCDF")
    parser.add_argument("simulated", metavar="SIMULATED", type=Path, help="simulated image, or a second measured one")
    parser.add_argument(
        "--offset", default="recorded", metavar="DEGREES",
        help="zero of the recorded phase: a number, free (fitted), fixed (the phase recorded in free air), or recorded "
        "(default: the same if the file has it, else fitted)",
    )  # fmt: skip
    parser.add_argument(
        "--sign", default="recorded", choices=("recorded", "free", "1", "-1"),
        help="sign of the recorded phase; default: from the file, else the one that fits better",
    )  # fmt: skip
    about = "number of materials to distinguish, at most 4, region 0 the largest; default: 2"
    parser.add_argument("--regions", type=whole_number, default=2, metavar="N", help=about)
    about = "longest shift to align the images; 0 for none; default: a tenth of the side"
    parser.add_argument("--limit", type=number_in("--limit", "m"), metavar="METRES", help=about)
    about = "trace (default) or retrace; or one for each, such as trace,retrace"
    parser.add_argument("--direction", metavar="NAME", help=about)
    parser.add_argument("--names", metavar="A,B", help="names of the images in the answer; default: measured,simulated")
    about = "row of the line profile, counted from 0; default: the middle"
    parser.add_argument("--row", type=int, metavar="N", help=about)
    add_files(parser, plot="page to draw (.png, .pdf, .svg)")
    add_colours(parser, "both phases on the page", "-30")
    add_options(parser, "quiet")


def compare(arguments: argparse.Namespace) -> None:
    """Compare two images, write the files asked for, and print the findings."""
    from phasemap.comparison.result import NAMES
    from phasemap.comparison.result import compare as compare_images
    from phasemap.io.measured import one_scan
    from phasemap.io.read import read_image

    check_files(arguments)
    if arguments.row is not None and arguments.plot is None:
        raise InputError("--row", arguments.row, "none without --plot")
    direction = _split_names("--direction", arguments.direction)
    options: dict[str, Any] = {
        "offset": _offset(arguments.offset),
        "sign": arguments.sign if arguments.sign in ("recorded", "free") else int(arguments.sign),
        "regions": arguments.regions if arguments.regions > 1 else None,
        "limit": arguments.limit,
        "direction": direction[0] if direction and len(direction) == 1 else direction,
        "names": _split_names("--names", arguments.names, exactly=2) or NAMES,
    }
    images = [read_image(path) for path in (arguments.measured, arguments.simulated)]
    for image in images:
        if "channels" in image.attrs:
            one_scan(image)  # which says what the file has if a channel is missing
    comparison = compare_images(*images, **options)
    options = {"row": arguments.row, **colours_of(arguments)}
    conclude(arguments, comparison, "comparison", summary(comparison), width=17, **options)


def summary(comparison: xr.Dataset) -> list[str]:
    """Findings of a comparison, as lines of a word and a sentence, the verdict last."""
    from phasemap.comparison.findings import lines_of, verdict_of

    size = f"{comparison.sizes['x']} x {comparison.sizes['y']} pixels"
    lines = [("compared", size), *lines_of(comparison), ("verdict", verdict_of(comparison))]
    return in_two_columns(lines, 17)


def _offset(text: str) -> str | float:
    """Offset as a word, or as a number of degrees."""
    if text in ("recorded", "free", "fixed"):
        return text
    return number_or_range("--offset", text, "degree", "recorded, free, fixed, or a number of degrees")[0]


def _split_names(option: str, text: str | None, exactly: int | None = None) -> tuple[str, ...] | None:
    """Name, or two with a comma between them, as a tuple."""
    if text is None:
        return None
    names = tuple(name.strip() for name in text.split(","))
    if not all(names) or len(names) > 2 or (exactly is not None and len(names) != exactly):
        allowed = "two names with a comma between them" if exactly else "one name, or two with a comma between them"
        raise InputError(option, text, allowed)
    return names


FAILED = 1  # exit code where a claim fails
CHECK_EXAMPLES = """examples:
  phasemap check blend.nc
  phasemap check blend.nc --pixels 500 --seed 7
  phasemap check flake.nc --scene flake.toml
  phasemap check image.nc --surface surface.nc

Exit code: 0 if no claim fails, 1 if one does, 2 if there is nothing to check (a file that cannot be read, no surface).
"""


def add_check(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument("image", metavar="IMAGE.nc", type=Path, help="simulated image, as `phasemap run` wrote it")
    about = "pixels also integrated in time; default: 64"
    parser.add_argument("--pixels", type=whole_number, default=64, metavar="N", help=about)
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="seed of the choice of pixels; default: 0")
    surface = parser.add_mutually_exclusive_group()
    about = "scene of the surface; default: the image's own"
    surface.add_argument("--scene", metavar="SCENE.toml", type=Path, help=about)
    surface.add_argument("--surface", metavar="SURFACE.nc", type=Path, help="file whose surface is used")
    add_options(parser, "threads")
    parser.add_argument("--quiet", action="store_true", help="the verdict only")


def check(arguments: argparse.Namespace) -> int:
    """Check an image and print the findings; returns the exit code."""
    from phasemap.io.netcdf import load

    image = load(arguments.image)
    surface = _surface(arguments)
    checked = interruptible(lambda: _checked(image, surface, arguments))
    print(checked.verdict if arguments.quiet else "\n".join([*_header(image), "", str(checked)]))
    return 0 if checked.holds else FAILED


def _surface(arguments: argparse.Namespace) -> Surface | None:
    """The surface that is named, None for that of the image's scene."""
    from phasemap.experiment.surface import Surface
    from phasemap.io.netcdf import load
    from phasemap.scenes.scene import load_scene

    if arguments.scene is not None:
        return load_scene(arguments.scene).surface
    return None if arguments.surface is None else Surface.from_dataset(load(arguments.surface), allow_nan=True)


def _checked(image: xr.Dataset, surface: Surface | None, arguments: argparse.Namespace) -> Check:
    """Check of the image, with a bar on stderr."""
    from phasemap.validation.check import check as check_image

    with progress_bar("", arguments.quiet) as progress:
        return check_image(
            image, surface, folders=(arguments.image.parent, "."), pixels=arguments.pixels, seed=arguments.seed,
            threads=arguments.threads, progress=progress,
        )  # fmt: skip


def _header(image: xr.Dataset) -> list[str]:
    """Lines about the image that is checked."""
    from phasemap.validation.claims import claims_of

    claims = claims_of(image)
    control = " ".join(filter(None, (str(claims.control), str(claims.realism) and f"with {claims.realism}")))
    return [
        f"image    {image_size(claims.shape, claims.pixel_size)}",
        f"made by  phasemap {str(image.attrs.get('phasemap_version', ''))[:20]}, solver {claims.solver}, {control}",
    ]
