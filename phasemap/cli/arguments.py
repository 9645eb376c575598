"""Arguments that several commands have, each said once, and what is done about the files they name."""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from phasemap._shared.errors import InputError

if TYPE_CHECKING:
    import xarray as xr

SURFACE_UNUSED = "the scene file; its surface is not used"


def whole(text: str) -> int:
    """Read a whole number of at least 1."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number of at least 1")
    return int(text)


OPTIONS: dict[str, dict[str, Any]] = {
    "quiet": {"action": "store_true", "help": "no progress and no summary"},
    "threads": {"type": whole, "metavar": "N", "help": "number of threads; default: all cores"},
    "strict-units": {
        "action": "store_true", "help": "refuse values outside the usual range instead of warning of them",
    },
}  # fmt: skip


def add_scene(parser: argparse.ArgumentParser, about: str = "the scene file", overrides: bool = True) -> None:
    """Declare the arguments that name a scene; overrides may stand anywhere, `main` collects them."""
    parser.add_argument("scene", metavar="SCENE.toml", type=Path, help=about)
    if overrides:
        add_overrides(parser)


def add_overrides(parser: argparse.ArgumentParser) -> None:
    """Declare keys of a scene to be set."""
    parser.add_argument("overrides", metavar="key=value", nargs="*", help="key of the scene, such as tip.radius=20nm")


def add_files(
    parser: argparse.ArgumentParser,
    output: str = "file to write",
    plot: str | None = "picture to draw (.png, .pdf, .svg)",
    metavar: str = "OUT.nc",
) -> None:
    """Declare -o, --plot (unless it is None) and --overwrite."""
    parser.add_argument("-o", "--output", metavar=metavar, type=Path, help=output)
    if plot is not None:
        parser.add_argument("--plot", metavar="OUT.png", type=Path, help=plot)
    parser.add_argument("--overwrite", action="store_true", help="replace existing files")


def add_options(parser: argparse.ArgumentParser, *names: str) -> None:
    """Declare some of the options that several commands have."""
    for name in names:
        parser.add_argument(f"--{name}", **OPTIONS[name])


def check_files(arguments: argparse.Namespace) -> None:
    """Refuse, before any work is done, what cannot or should not be written."""
    from phasemap.io.netcdf import check_dataset
    from phasemap.io.whole_files import check_target

    output, plot = arguments.output, arguments.plot
    if plot is not None and plot == output:
        raise InputError("--plot", str(plot), "another file than that of -o")
    if output is not None:
        check_dataset(output, arguments.overwrite)
    if plot is not None:
        from phasemap.plot.figure import check_format

        check_target(plot, arguments.overwrite)
        check_format(plot)


def conclude(
    arguments: argparse.Namespace,
    found: xr.Dataset,
    draw: str,
    summary: Iterable[str],
    started: float | None = None,
    width: int = 12,
    **options: Any,
) -> None:
    """Write what was found, and its picture, where the command names files for them, and say what was found.

    `draw`: the function of `phasemap.plot` that draws it, with `options`.
    `started`: when the work began [s]; without it no time is said.
    `width`: of the column of words.
    """
    if arguments.output is not None:
        from phasemap.io.netcdf import save

        save(found, arguments.output, arguments.overwrite)
    if arguments.plot is not None:
        from phasemap import plot

        getattr(plot, draw)(found, arguments.plot, overwrite=arguments.overwrite, **options)
    if arguments.quiet:
        return
    print("\n".join(summary))
    if started is not None:
        print(f"{'took':<{width}}{time.perf_counter() - started:.2f} s")
    print_files(arguments, width)


def print_files(arguments: argparse.Namespace, width: int = 12) -> None:
    """Say which files were written."""
    for path in (arguments.output, arguments.plot):
        if path is not None:
            print(f"{'written to':<{width}}{path}")
