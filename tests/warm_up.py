"""Compiles what most tests need, beside the first of them: `python tests/warm_up.py FILE`.

It is one process, for two would type many functions twice. What is compiled here, all test processes load. No kernel
may be compiled twice for arguments that differ in nothing but how they were written. What was computed meanwhile goes
into the file, bit by bit: tests/_kernels/test_first_results.py asks whether a process that loads finds the same.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from bits import bits
from numba.core import types

from phasemap._kernels.compilation.entries import _all_kernels
from phasemap.cli.kinds_of_work import KINDS

EXPECTED_VERSIONS = {"copy": 2}
"""Kernels that may be typed more than once: `copy` for numbers and for indices."""


def compiled_more_than_once() -> dict[str, int]:
    """Kernels of this process compiled for more sets of argument types than needed, and the number of sets.

    One set is needed for each kind of plug-in, which are named tuples.
    """
    found = {}
    for one in _all_kernels():
        sets, kinds = len(one.linked.overloads), len({_tuples_in(args) for args in one.linked.overloads})
        if sets > max(kinds, EXPECTED_VERSIONS.get(one.__name__, 1)):
            found[f"{one.__module__}.{one.__name__}"] = sets
    return found


def _tuples_in(given: Any) -> tuple[type, ...]:
    """Classes of the named tuples among types, and of those in them."""
    named = [one for one in given if isinstance(one, types.BaseNamedTuple)]
    return tuple(kind for one in named for kind in (one.instance_class, *_tuples_in(one.types)))


if __name__ == "__main__":
    found = {kind: bits(work()) for kind, work in KINDS.items()}
    if several := compiled_more_than_once():
        sys.exit(f"kernels that are compiled more than once: {several}")
    Path(sys.argv[1]).write_text(json.dumps(found))
