"""The command ``phasemap bench``: time against error of every solver, or tables of a kind of their own."""

from __future__ import annotations

import argparse

from phasemap._shared.errors import PhasemapError
from phasemap.cli.arguments import add_files, check_files, whole
from phasemap.cli.console import saying

EXAMPLES = """examples:
  phasemap bench --quick
  phasemap bench --output bench.nc --plot bench.png
  phasemap bench --seed 7 --pixels 80 --no-peers
  phasemap bench --box --materials 1000 --microscopes 100
  phasemap bench --compile

Peers (numbalsoda, heyoka, scipy) are measured where they are installed: pip install "afm-phasemap[bench]".
A full run takes some four minutes, and times mean something only if nothing else runs on the machine.
"""


MOVED = {"hard": "hard", "scan": "scans", "blocks": "blocks"}  # options of former versions, and where they went


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument("--quick", action="store_true", help="few cases, in under a minute")
    instead = parser.add_mutually_exclusive_group()
    about = "solve materials drawn at random instead, and say what became of them and how long they took"
    instead.add_argument("--box", action="store_true", help=about)
    about = "say what the first use of each kind of work takes instead"
    instead.add_argument("--compile", action="store_true", help=about)
    for name in MOVED:
        instead.add_argument(f"--{name}", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--pixels", type=whole, metavar="N", help="cases a regime that are compared; default: 40")
    parser.add_argument("--materials", type=whole, metavar="N", help="with --box, in all; default: 10000")
    parser.add_argument("--microscopes", type=whole, metavar="N", help="with --box; default: 300")
    parser.add_argument("--seed", type=int, default=1, help="of the cases drawn; default: 1")
    parser.add_argument("--no-peers", action="store_true", help="measure the solvers of phasemap only")
    add_files(parser, "write everything measured as netCDF", "draw work-precision diagrams (.png, .pdf, .svg)")


def bench(arguments: argparse.Namespace) -> None:
    """Measure every solver, or what there are tables of their own for."""
    for name, script in MOVED.items():
        if getattr(arguments, name):
            raise PhasemapError(f"--{name} has moved: in a copy of the repository, run python tests/bench/{script}.py.")
    if arguments.box or arguments.compile:
        _bench_of_its_own(arguments)
        return
    for name in ("materials", "microscopes"):
        if getattr(arguments, name) is not None:
            raise PhasemapError(f"--{name} goes with --box only.")
    from phasemap.io.netcdf import save
    from phasemap.validation.bench import PIXELS, QUICK_PIXELS
    from phasemap.validation.bench import bench as measure
    from phasemap.validation.bench.picture import draw
    from phasemap.validation.bench.report import listing, table

    check_files(arguments)
    pixels = arguments.pixels or (QUICK_PIXELS if arguments.quick else PIXELS)
    with saying() as say:
        measured = measure(pixels, arguments.seed, not arguments.no_peers, arguments.quick, say)
    print(table(measured))
    if failed := listing(measured):
        print(f"\n{failed}")
    if arguments.output is not None:
        save(measured, arguments.output, arguments.overwrite)
        print(f"\nwritten to  {arguments.output}")
    if arguments.plot is not None:
        draw(measured, arguments.plot, arguments.overwrite)
        print(f"\nwritten to  {arguments.plot}")


def _bench_of_its_own(arguments: argparse.Namespace) -> None:
    """Solve materials drawn at random, or say what first uses compile."""
    kind = "box" if arguments.box else "compile"
    for name in ("output", "plot", "pixels", *(() if kind == "box" else ("materials", "microscopes"))):
        if getattr(arguments, name) is not None:
            raise PhasemapError(f"--{name} does not go with --{kind}, which prints a table of its own cases.")
    with saying() as say:
        if kind == "box":
            from phasemap.validation.bench.box import MATERIALS, MICROSCOPES, box

            count = arguments.materials or MATERIALS
            said = box(count, arguments.microscopes or min(MICROSCOPES, count), arguments.seed, say)
        else:
            from phasemap.validation.bench.compiling import table

            said = table(say)
    print(said)
