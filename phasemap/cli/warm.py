"""The command ``phasemap warm``: kernels compiled ahead of their first use."""

from __future__ import annotations

import argparse
import subprocess
import sys

from phasemap._shared.errors import PhasemapError

EXAMPLES = """examples:
  phasemap warm
  phasemap warm --all

Numerical code is compiled when it is first used, and kept on disk. This compiles it in advance, as for a container.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument("--all", action="store_true", help="compile march, inversion and every contact law too")


def warm(arguments: argparse.Namespace) -> None:
    """Compile kernels ahead, and say what it cost."""
    from phasemap.cli.kinds_of_work import ALL, USUAL, Cost, in_processes

    costs: list[Cost] = []

    def told(cost: Cost) -> None:
        costs.append(cost)
        print(cost, file=sys.stderr, flush=True)

    try:
        in_processes(ALL if arguments.all else USUAL, told)
    except subprocess.CalledProcessError:
        raise PhasemapError("a process that compiled kernels failed; it said why above.") from None
    from phasemap._kernels.compilation.disk_cache import folder

    whole = Cost.of_all(costs)
    if not whole.functions:
        print(f"nothing left to compile; kept in {folder()}")
        return
    print(f"{whole.seconds:.0f} s of processor time, {whole.size / 1e6:.1f} MB kept in {folder()}")
