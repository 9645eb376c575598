"""``phasemap warm``."""

from __future__ import annotations

import argparse
import subprocess
import sys

from phasemap._shared.errors import PhasemapError

__all__ = ["EXAMPLES", "add_arguments", "warm"]

EXAMPLES = """examples:
  phasemap warm
  phasemap warm --all

Kernels are compiled when they are first used, and kept on disk. This compiles them ahead, in a container for example.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command.

    Parameters
    ----------
    parser : ArgumentParser
        Of the command.
    """
    parser.add_argument("--all", action="store_true", help="march, inversion and every contact law too")


def warm(arguments: argparse.Namespace) -> None:
    """Compile kernels ahead, and say what it cost."""
    from phasemap.validation.kinds_of_work import ALL, USUAL, Cost, in_processes

    costs: list[Cost] = []

    def told(cost: Cost) -> None:
        costs.append(cost)
        print(line(cost), file=sys.stderr, flush=True)

    try:
        in_processes(ALL if arguments.all else USUAL, told)
    except subprocess.CalledProcessError:
        raise PhasemapError("a process that compiled kernels failed; it said why above.") from None
    from phasemap._kernels.disk_cache import folder

    if not sum(cost.functions for cost in costs):
        print(f"nothing left to compile; kept in {folder()}")
        return
    seconds, size = sum(cost.seconds for cost in costs), sum(cost.size for cost in costs)
    print(f"{seconds:.0f} s of processor time, {size / 1e6:.1f} MB kept in {folder()}")


def line(cost: object) -> str:
    """What one kind of work cost, in a line."""
    from phasemap.validation.kinds_of_work import Cost

    assert isinstance(cost, Cost)
    return f"{cost.kind:24s} {cost.seconds:6.1f} s {cost.functions:5d} functions {cost.size / 1e6:6.2f} MB"
