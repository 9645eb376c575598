"""The commands ``phasemap warm``, which compiles kernels ahead of their first use, and ``bench``, which measures."""

from __future__ import annotations

import argparse
import importlib
import sys
from pathlib import Path

from phasemap._shared.errors import PhasemapError

WARM_EXAMPLES = """examples:
  phasemap warm
  phasemap warm --all

Numerical code is compiled when it is first used, and kept on disk. This compiles it in advance, as for a container.
"""


def add_warm(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument("--all", action="store_true", help="compile march, inversion and every contact law too")


def warm(arguments: argparse.Namespace) -> None:
    """Compile kernels ahead, and say what it cost."""
    from phasemap._kernels.compilation import COMPILES

    if not COMPILES:
        print("nothing is left to compile: this installation brings its compiled code")
        return
    from phasemap._kernels.compilation.disk_cache import folder
    from phasemap.cli.kinds_of_work import ALL, USUAL, Cost, in_processes

    whole = Cost.of_all(in_processes(ALL if arguments.all else USUAL))
    if not whole.functions:
        print(f"nothing left to compile; kept in {folder()}")
        return
    print(f"{whole.seconds:.0f} s of processor time, {whole.size / 1e6:.1f} MB kept in {folder()}")


REPOSITORY = Path(__file__).parents[2]
"""Folder that phasemap is imported from: a clone of the repository, or where packages are installed."""


def add_bench(parser: argparse.ArgumentParser) -> None:
    """Take every word that follows the command; `benchmarks.command` declares what they may be."""
    parser.set_defaults(rest=[])


def bench(arguments: argparse.Namespace) -> None:
    """Run the measurements that the words ask for."""
    if not (REPOSITORY / "benchmarks" / "command.py").exists():
        raise PhasemapError(
            "bench is not part of the installed package: clone the repository, or unpack the source archive, and run "
            "'pip install -e .' there."
        )
    sys.path.insert(0, str(REPOSITORY))  # before a folder of the same name in the current one
    command = importlib.import_module("benchmarks.command")
    command.add_arguments(arguments.parser)
    command.bench(arguments.parser.parse_args(arguments.rest))
