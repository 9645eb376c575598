"""What the first use of the solvers, and of each kind of work, compiles, and how long that takes."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Sequence
from unittest.mock import patch

from phasemap.cli.kinds_of_work import KINDS, Cost, in_processes

FIRST = {"orbit": "orbit", "averaging": "averaging", "auto": "image", "march": "march"}
"""The kind of work that compiles a solver; what solvers share is compiled with the first of them."""


def of_solvers(empty: bool) -> dict[str, float]:
    """Seconds of the processor until each solver has solved its first pixels.

    `empty`: whether the process finds nothing on disk.
    """
    kinds = list(FIRST.values())
    costs = in_an_empty_cache(kinds) if empty else in_processes([kinds])
    seconds = {cost.kind: cost.seconds for cost in costs}
    return {solver: seconds[kind] for solver, kind in FIRST.items()}


def in_an_empty_cache(kinds: Sequence[str]) -> list[Cost]:
    """Do work of these kinds, one after the other, in a process that finds nothing on disk."""
    with (
        tempfile.TemporaryDirectory(prefix="phasemap-bench-") as folder,
        patch.dict(os.environ, NUMBA_CACHE_DIR=folder),
    ):
        return in_processes([kinds])


def table(_say: Callable[[str], None]) -> str:
    """What the first use of each kind of work takes, in a process that finds nothing on disk and does all in order."""
    costs = in_an_empty_cache(list(KINDS))
    head = "first use of: processor time, kernels compiled, kept on disk"
    return "\n".join([head, *map(str, costs), str(Cost.of_all(costs))])
