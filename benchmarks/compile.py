"""What the first use of the solvers, and of each kind of work, compiles, and how long that takes."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable

from phasemap.cli.kinds_of_work import KINDS, Cost, in_processes

FIRST = {"orbit": "orbit", "averaging": "averaging", "auto": "image", "march": "march"}
"""The kind of work that compiles a solver; what solvers share is compiled with the first of them."""


def of_solvers(empty: bool) -> dict[str, float]:
    """Seconds of the processor until each solver has solved its first pixels.

    `empty`: whether the process finds nothing on disk.
    """
    costs: list[Cost] = []
    if empty:
        in_an_empty_cache(FIRST.values(), costs.append)
    else:
        in_processes([FIRST.values()], costs.append)
    seconds = {cost.kind: cost.seconds for cost in costs}
    return {solver: seconds[kind] for solver, kind in FIRST.items()}


def in_an_empty_cache(kinds: Iterable[str], told: Callable[[Cost], None]) -> None:
    """Do work of these kinds, one after the other, in a process that finds nothing on disk."""
    with tempfile.TemporaryDirectory(prefix="phasemap-bench-") as folder:
        in_processes([kinds], told, folder)


def table(say: Callable[[str], None]) -> str:
    """What the first use of each kind of work takes, in a process that finds nothing on disk and does all in order."""
    costs: list[Cost] = []

    def told(cost: Cost) -> None:
        costs.append(cost)
        say(f"{cost.kind}: {cost.seconds:.1f} s")

    in_an_empty_cache(KINDS, told)
    head = "first use of: processor time, kernels compiled, kept on disk"
    return "\n".join([head, *map(str, costs), str(Cost.of_all(costs))])
