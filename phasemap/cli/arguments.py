"""Arguments that several commands have, each declared once, their values read, and their files checked and written."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from phasemap._shared.errors import InputError
from phasemap._shared.files import check_target
from phasemap._shared.quantities import KINDS, NotThatUnit, range_in_si

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr

    from phasemap.experiment.material import Material

SURFACE_UNUSED = "the scene file; its surface is not used"


def whole_number(text: str) -> int:
    """Read a whole number of at least 1."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number of at least 1")
    return int(text)


OPTIONS: dict[str, dict[str, Any]] = {
    "quiet": {"action": "store_true", "help": "no progress and no summary"},
    "threads": {"type": whole_number, "metavar": "N", "help": "number of threads; default: all cores"},
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
    about = "key of the scene, such as tip.radius=20nm"
    parser.add_argument("overrides", metavar="key=value", nargs="*", default=[], help=about)


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

    output, plot = arguments.output, arguments.plot
    for name in NAMES if plot is None else ():
        if (given := getattr(arguments, name, None)) is not None:
            raise InputError(f"--{name}", given, "nothing without --plot")
    if plot is not None and plot == output:
        raise InputError("--plot", str(plot), "another file than that of -o")
    if output is not None:
        check_dataset(output, arguments.overwrite)
    if plot is not None:
        from phasemap.plot.page import check_format

        check_target(plot, arguments.overwrite)
        check_format(plot)


def conclude(
    arguments: argparse.Namespace, result: xr.Dataset, draw: str, summary: Iterable[str], started: float | None = None,
    width: int = 12, **options: Any,
) -> None:  # fmt: skip
    """Write the result and its picture, where the command names files, and print its summary.

    `draw`: the function of `phasemap.plot`. `started`: when the work began [s]; without it no time is said.
    """
    if arguments.output is not None:
        from phasemap.io.netcdf import save

        save(result, arguments.output, arguments.overwrite)
    if arguments.plot is not None:
        from phasemap import plot

        getattr(plot, draw)(result, arguments.plot, overwrite=arguments.overwrite, **options)
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


def known_in(text: str | None, material_of: Callable[[str], Material]) -> dict[int, Material]:
    """Read materials by the label of their region, from LABEL=NAME with commas between them."""
    known = {}
    for word in text.split(",") if text else ():
        label, equals, name = word.partition("=")
        if not equals or not label.strip().lstrip("-").isdecimal():
            raise InputError("--known", text, "LABEL=NAME, such as 0=substrate, several with commas between them")
        known[int(label)] = material_of(name.strip())
    return known


LABELS = ("labels", "label")  # maps of regions, as files call them


def number_or_range(name: str, text: str, unit: str, allowed: str = "a number in SI units") -> tuple[float, ...]:
    """Read one number, or START, STOP and N, of the command line; `allowed` is told in errors, but for units."""
    try:
        return range_in_si(text, unit)
    except NotThatUnit:
        with_one = "" if unit == "1" else f", or with a unit such as {KINDS[unit][1].replace(' ', '')}"
        raise InputError(name, text, allowed + with_one) from None


def one_each(name: str, text: str | None, unit: str, count: int, each: str, words: Sequence[str] = ()) -> Any:
    """Read as many numbers as there are images or files, or one for all of them; `name` is the argument's in Python."""
    if text is None or text in words:
        return text
    option = f"--{name.replace('_', '-')}"
    allowed = f"a number, or {count} with commas between them, one {each}"
    numbers = [number for part in text.split(",") for number in number_or_range(option, part, unit, allowed)]
    if len(numbers) not in (1, count):
        raise InputError(option, text, allowed)
    return numbers * (count // len(numbers))


def labels_in(path: str) -> np.ndarray:
    """Read the map of regions of a netCDF file, shape (rows, columns)."""
    import numpy as np

    from phasemap.io.netcdf import load

    maps = load(path)
    name = next((name for name in LABELS if name in maps), None)
    if name is None:
        held = ", ".join(map(str, maps.data_vars))
        raise InputError(f"what {path} holds", held, f"a map {' or '.join(LABELS)}, as phasemap scene writes it")
    return np.asarray(maps[name].values)


def number_in(name: str, unit: str) -> Callable[[str], float]:
    """Read one number as an option of argparse."""

    def read(text: str) -> float:
        try:
            (number,) = number_or_range(name, text, unit)
        except ValueError:  # START:STOP:N too
            raise argparse.ArgumentTypeError(f"{text!r} is no number in {unit}") from None
        return number

    return read


NAMES = ("vmin", "vmax", "cmap")


def add_colours(parser: argparse.ArgumentParser, of: str, example: str) -> None:
    """Declare the arguments. `of`: what limits and colour map belong to."""
    parser.add_argument("--vmin", metavar="VALUE", help=f"lowest value of the colours of {of}, such as {example}")
    parser.add_argument("--vmax", metavar="VALUE", help=f"highest value of the colours of {of}")
    parser.add_argument("--cmap", metavar="NAME", help=f"matplotlib colour map of {of}, such as gray")


def colours_of(arguments: argparse.Namespace) -> dict[str, Any]:
    """Colours that were given, by the arguments of `phasemap.plot.plot`; of several variables by name."""
    return {name: _by_name(getattr(arguments, name)) for name in NAMES}


def _by_name(text: str | None) -> float | str | dict[str, float | str] | None:
    """Number or text, or a number or text for each name, from "name=value,name=value"."""
    if text is None or "=" not in text:
        return text if text is None else _number_or_text(text)
    parts = [part.partition("=") for part in text.split(",")]
    return {name.strip(): _number_or_text(value.strip()) for name, _, value in parts}


def _number_or_text(text: str) -> float | str:
    """Number in a text as a float, or else the text."""
    try:
        return float(text)
    except ValueError:
        return text
