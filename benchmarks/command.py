"""What ``phasemap bench`` is asked for."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module

from phasemap._shared.errors import PhasemapError
from phasemap.cli.arguments import add_files, check_files, print_files, whole_number

EXAMPLES = """examples:
  phasemap bench --quick
  phasemap bench --output bench.nc --plot bench.png
  phasemap bench --seed 7 --pixels 80 --no-peers
  phasemap bench --box --materials 1000 --microscopes 100
  phasemap bench --compile

Peers (numbalsoda, heyoka, scipy) are measured where they are installed: pip install -e ".[bench]".
A full run takes some minutes, and times mean something only if nothing else runs on the machine.
"""
TABLES = {
    "box": "solve materials drawn at random instead, and say what became of them and how long they took",
    "compile": "say what the first use of each kind of work takes instead",
    "scans": "compare both engines of a scan in time instead",
    "blocks": "say what it costs to simulate block by block instead; needs Dask",
    "hard": "solve named hard cases instead, and say what is wrong on them",
}
"""Modules that print a table of their own."""
OF_THE_BOX = ("materials", "microscopes")


@contextmanager
def saying() -> Iterator[Callable[[str], None]]:
    """Say on stderr what is being done: on one line that changes or, where that is not a terminal, on a line each."""
    terminal, last = sys.stderr.isatty(), ""

    def say(text: str) -> None:
        nonlocal last
        what = text.partition(":")[0]  # what follows counts
        if terminal:
            print(f"\r\x1b[K{text} ...", end="", file=sys.stderr, flush=True)
        elif what != last:
            print(f"{what} ...", file=sys.stderr, flush=True)
        last = what

    try:
        yield say
    finally:
        if terminal:
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.epilog = EXAMPLES
    parser.add_argument("-h", "--help", action="help", help="show this help message and exit")
    parser.add_argument("--quick", action="store_true", help="few cases, in under a minute")
    instead = parser.add_mutually_exclusive_group()
    for name, about in TABLES.items():
        instead.add_argument(f"--{name}", action="store_const", dest="table", const=name, help=about)
    parser.add_argument(
        "--pixels", type=whole_number, metavar="N", help="cases a regime that are compared; default: 40"
    )
    parser.add_argument("--materials", type=whole_number, metavar="N", help="with --box, in all; default: 10000")
    parser.add_argument("--microscopes", type=whole_number, metavar="N", help="with --box; default: 300")
    parser.add_argument("--seed", type=int, default=1, help="of the cases drawn; default: 1")
    parser.add_argument("--no-peers", action="store_true", help="measure the solvers of phasemap only")
    add_files(parser, "write everything measured as netCDF", "draw work-precision diagrams (.png, .pdf, .svg)")


def bench(arguments: argparse.Namespace) -> None:
    """Measure every solver, or print the table that is asked for instead."""
    given = [name for name in ("output", "plot", "pixels", *OF_THE_BOX) if getattr(arguments, name) is not None]
    if arguments.table is None:
        if strange := [name for name in given if name in OF_THE_BOX]:
            raise PhasemapError(f"--{strange[0]} goes with --box only.")
        _time_against_error(arguments)
        return
    allowed = OF_THE_BOX if arguments.table == "box" else ()
    if strange := [name for name in given if name not in allowed]:
        raise PhasemapError(
            f"--{strange[0]} does not go with --{arguments.table}, which prints a table of its own cases."
        )
    table = import_module(f"benchmarks.{arguments.table}").table
    drawn = (arguments.materials, arguments.microscopes, arguments.seed) if allowed else ()
    with saying() as say:
        said = table(say, *drawn)
    print(said)


def _time_against_error(arguments: argparse.Namespace) -> None:
    from benchmarks import accuracy
    from benchmarks.accuracy import picture
    from benchmarks.accuracy.report import listing, table
    from phasemap.io.netcdf import save

    check_files(arguments)
    with saying() as say:
        measured = accuracy.bench(arguments.pixels, arguments.seed, not arguments.no_peers, arguments.quick, say)
    print(table(measured))
    if failed := listing(measured):
        print(f"\n{failed}")
    if arguments.output is not None:
        save(measured, arguments.output, arguments.overwrite)
    if arguments.plot is not None:
        picture.draw(measured, arguments.plot, arguments.overwrite)
    print_files(arguments)
