"""How long compilation takes, in a process of its own with an empty cache.

Run as ``python -m phasemap.validation.bench.compiling``; prints seconds by solver as JSON. What a solver shares with
those before it in `ORDER` is compiled with the first of them.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable

import numpy as np

from phasemap.experiment.accuracy import Accuracy
from phasemap.solvers.run import run
from phasemap.solvers.solver import by_name

ORDER = ("orbit", "averaging", "auto", "march")


def first_calls() -> dict[str, float]:
    """Seconds until each solver has solved its first pixels in this process."""
    from phasemap.validation.bench.regimes import REGIMES, draw

    (batch,) = draw(REGIMES[0], 1, 32, np.random.default_rng(0))
    work = batch.work()
    seconds = {}
    for name in ORDER:
        started = time.perf_counter()
        run(by_name(name), work, Accuracy(), threads=1)
        seconds[name] = time.perf_counter() - started
    return seconds


class ColdStart:
    """Compiles everything anew in a process beside this one, while this one does something that is not timed."""

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="phasemap-bench-")
        self._process = subprocess.Popen(
            [sys.executable, "-m", "phasemap.validation.bench.compiling"],
            env={**os.environ, "NUMBA_CACHE_DIR": self._folder.name},
            stdout=subprocess.PIPE,
            text=True,
        )

    def seconds(self) -> dict[str, float]:
        """Wait until it is done; NaN for every solver if it failed or was stopped."""
        if self._process.returncode is None:
            self._said = self._process.communicate()[0]
            self._folder.cleanup()
        if self._process.returncode != 0:
            return dict.fromkeys(ORDER, float("nan"))
        return {name: float(value) for name, value in json.loads(self._said).items()}

    def stop(self) -> None:
        """End the process if it still runs."""
        if self._process.poll() is None:
            self._process.kill()
            self._process.communicate()
            self._folder.cleanup()


def table(progress: Callable[[str], None]) -> str:
    """What the first use of each kind of work takes, in a process that finds nothing on disk and does all in order."""
    from phasemap.validation.kinds_of_work import Cost, in_an_empty_cache

    costs: list[Cost] = []

    def told(cost: Cost) -> None:
        costs.append(cost)
        progress(f"{cost.kind}: {cost.seconds:.1f} s")

    in_an_empty_cache(told)
    head = "first use of: processor time, kernels compiled, kept on disk"
    return "\n".join([head, *map(str, costs), str(Cost.of_all(costs))])


if __name__ == "__main__":
    print(json.dumps(first_calls()))
