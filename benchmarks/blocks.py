"""What it costs to simulate block by block, alone, on two cores and on many: ``phasemap bench --blocks``.

The projection to more cores is of a map of N blocks on p cores, with the times that were measured here::

    T(p) = N g + max(ceil(N / p) c, N m o) + s

where a block takes one process of a cluster c seconds (it is made twice, surveyed and filled), the client g to
describe, and the scheduler o for each of its m tasks, one after another; s is the plan of the image, for which all
wait. The efficiency is N c / (p T(p)). What travels between machines, and files, are not in it.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from timeit import repeat
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from benchmarks.tables import machine, markdown, versions
from phasemap._shared.errors import PhasemapError
from phasemap.experiment.control import Control, Engage, Feedback, Raster
from phasemap.experiment.material import Material
from phasemap.experiment.microscope import Cantilever, Drive, Microscope, Tip
from phasemap.experiment.surface import Surface
from phasemap.imaging.simulation import simulate

if TYPE_CHECKING:
    import xarray as xr

Array = np.ndarray
Say = Callable[[str], None]

SIDE, GRID = 1024, 4
"""Side of a block in pixels, and blocks along a side of the map."""
MAPS, CORES = (16384, 131072), (10, 100, 1000)
"""Sides of the maps, and numbers of cores, to which is projected."""
TIMES, SPUN = 3, 1 << 25
"""How often each is timed, of which the least counts; bytes of a text that a thread digests."""
EMPTY = 1000  # tasks that do nothing, to time the scheduler
SCOPE, SETPOINT = Microscope(Cantilever(40.0, 300e3, 400.0), Tip(10e-9), Drive(20e-9)), 0.7
DOMAINS = {0: Material(3e9, adhesion=0.05, damping=0.004), 1: Material(0.5e9, adhesion=0.08, damping=0.03)}
VARIABLES = ("height", "phase")

ALONE = "A block of {side} x {side} pixels by itself, in memory, on one core."
TWICE = (
    "{count} such blocks on one core and on two: T1 / (2 T2). `threads` are those of an image in memory, a cluster has "
    "one process with one thread for each core. Two threads that only compute reach {ceiling:.0f} % on this machine. "
    "Overhead is the wall time on one core less the sum of the tasks, over it."
)
FORWARD = (
    "Projected from these: T(p) = N g + max(ceil(N/p) c, N m o) + s for N blocks on p cores, with c for a block on a "
    "process, g to describe it, o for each of its m tasks in the scheduler, s for the plan; files and network are not "
    "in it. The efficiency is N c / (p T(p))."
)


def wave(seed: float, low: float, high: float, block_info: Any = None) -> Array:
    """A smooth map in which all pixels differ, of a block of it."""
    (top, bottom), (left, right) = block_info[None]["array-location"]
    y, x = np.ogrid[top:bottom, left:right]
    share = 0.5 + 0.25 * (np.sin(y / 37.0 + seed) * np.cos(x / 29.0 - seed) + np.sin((x + 2 * y) / 61.0 + 2 * seed))
    return np.asarray(low + (high - low) * share)


def _domains(block_info: Any = None) -> Array:
    return (wave(1.0, 0.0, 1.0, block_info) > 0.5).astype(np.int8)


def few_materials(side: int, block: int) -> Surface:
    """Two materials under relief, in Dask arrays."""
    labels, relief = _lazy(_domains, np.int8, side, block), partial(wave, 0.3, 0.0, 3e-9)
    return Surface.from_labels(labels, DOMAINS, pixel_size=2e-9, topography=_lazy(relief, np.float64, side, block))


def continuous(side: int, block: int) -> Surface:
    """Three maps in which all pixels differ, in Dask arrays."""
    ranges = ((1.0, 1e9, 3e9), (2.0, 0.03, 0.08), (3.0, 0.002, 0.02))
    modulus, adhesion, damping = (_lazy(partial(wave, *one), np.float64, side, block) for one in ranges)
    return Surface(modulus, adhesion, damping, pixel_size=2e-9)


def _lazy(make: Callable[..., Array], dtype: type, side: int, block: int) -> Any:
    import dask.array as da

    cut = da.core.normalize_chunks((block, block), (side, side))
    return da.map_blocks(make, chunks=cut, dtype=dtype, meta=np.empty((0, 0), dtype))


@dataclass(frozen=True)
class Kind:
    """A kind of image."""

    name: str
    surface: Callable[[int, int], Surface]  # of the side of a map and of a block
    control: Control
    lines: int | None = None  # of a block, if not all

    def image(self, surface: Surface, threads: int | None = None) -> xr.Dataset:
        """Height and phase."""
        return simulate(surface, SCOPE, SETPOINT, control=self.control, variables=VARIABLES, threads=threads)


ENGAGED = (Kind("two materials", few_materials, Engage()), Kind("three continuous maps", continuous, Engage()))
KINDS = (
    *ENGAGED,
    Kind("two materials, Raster", few_materials, Raster()),
    Kind("two materials, one line of Feedback", few_materials, Feedback(line_rate=1.0), 1),
)


def table(say: Say, side: int = SIDE, grid: int = GRID) -> str:
    """Measure all that, in one run.

    `side`, `grid`: pixels along a side of a block, blocks along a side of a map.
    Returns three tables in Markdown: a block alone, two cores and overhead, more cores.
    Raises PhasemapError if Dask is not installed.
    """
    if not (find_spec("dask") and find_spec("distributed")):
        raise PhasemapError('this takes Dask: pip install "afm-phasemap[dask]".')
    started = time.perf_counter()
    parts = [ALONE.format(side=side), alone(side, say)]
    costs = {kind.name: _cost(kind, side, grid, say) for kind in ENGAGED}
    about = TWICE.format(count=grid**2, ceiling=100 * ceiling())
    parts += [about, twice(costs), FORWARD, forward(costs)]
    said = f"{machine()}; {versions('dask', 'distributed')}; took {time.perf_counter() - started:.0f} s."
    return "\n\n".join([*parts, said])


# A block alone


def alone(side: int, say: Say) -> str:
    """The table of blocks by themselves."""
    lines = []
    for kind in KINDS:
        say(f"a block alone: {kind.name}")
        surface = kind.surface(side, side).compute().rows(slice(0, kind.lines or side))
        task = partial(kind.image, surface, 1)
        task()  # loads what is compiled
        processor, wall = _least(task, time.process_time), _least(task)
        pixel = 1e6 * processor / (surface.shape[0] * surface.shape[1])
        lines.append([kind.name, f"{processor:.3g}", f"{wall:.3g}", f"{pixel:.3g}"])
    return markdown(("image", "processor time [s]", "wall time [s]", "processor time a pixel [µs]"), lines)


def _least(task: Callable[[], object], clock: Callable[[], float] = time.perf_counter) -> float:
    """The least of a few times [s]: what else runs only adds."""
    return min(repeat(task, timer=clock, repeat=TIMES, number=1))


# One core and two


def ceiling() -> float:
    """The efficiency of two threads that only compute: cores may share what they are made of, or a machine."""
    text = b"x" * SPUN

    def spin(_: int) -> bytes:
        return hashlib.sha256(text).digest()  # lets other threads run

    with ThreadPoolExecutor(2) as pool:
        alone = _least(lambda: [spin(i) for i in range(8)])
        together = _least(lambda: list(pool.map(spin, range(8))))
    return alone / (2 * together)


class Run(NamedTuple):
    """A lazy image that was computed."""

    wall: float  # [s]
    tasks: dict[str, list[float]]  # seconds of each task, by what it does

    @property
    def busy(self) -> float:
        """Seconds in tasks."""
        return sum(map(sum, self.tasks.values()))

    @property
    def overhead(self) -> float:
        """Wall time beyond that in tasks, over it; of one core."""
        return self.wall / self.busy - 1


class Cost(NamedTuple):
    """What was measured of one kind of image."""

    threads: tuple[float, float]  # wall time in memory with one thread and with two [s]
    cluster: tuple[Run, Run]  # on one process and on two
    threaded: Run  # by Dask's threaded scheduler with one thread
    describe: float  # to describe a block [s]
    empty: float  # processor time of client and scheduler for a task that does nothing [s]
    number: int  # of blocks

    @property
    def block(self) -> float:
        """Seconds that a process takes for a block, with what goes with it."""
        return (self.cluster[0].wall - self.plan) / self.number

    @property
    def plan(self) -> float:
        """Seconds of the plan of the image."""
        return sum(self.cluster[0].tasks["phasemap-plan"])

    @property
    def tasks(self) -> float:
        """Tasks of a block."""
        return sum(map(len, self.cluster[0].tasks.values())) / self.number

    def wall(self, number: int, cores: int) -> float:
        """Projected wall time of so many blocks [s]."""
        work, scheduler = -(-number // cores) * self.block, number * self.tasks * self.empty
        return number * self.describe + max(work, scheduler) + self.plan


def _cost(kind: Kind, side: int, grid: int, say: Say) -> Cost:
    lazy = kind.surface(grid * side, side)
    surface = lazy.compute()
    say(f"threads in memory: {kind.name}")
    kind.image(surface, 1)  # loads what is compiled
    one_thread, two_threads = (_least(partial(kind.image, surface, number)) for number in (1, 2))
    say(f"threaded scheduler: {kind.name}")
    threaded = _threaded(kind, lazy)
    say(f"cluster: {kind.name}")
    one, two = _on_cluster(kind, lazy, 1), _on_cluster(kind, lazy, 2)
    started = time.perf_counter()
    kind.image(lazy)
    describe = (time.perf_counter() - started) / grid**2
    return Cost((one_thread, two_threads), (one, two), threaded, describe, _empty(), grid**2)


def _means(kind: Kind, surface: Surface) -> list[Any]:
    """What takes the whole image and is small."""
    image = kind.image(surface)
    return [image[name].data.mean() for name in VARIABLES]


def _threaded(kind: Kind, surface: Surface) -> Run:
    from dask import config
    from dask.base import compute
    from dask.diagnostics.profile import Profiler

    means = _means(kind, surface)
    with config.set(scheduler="threads", num_workers=1), Profiler() as profiler:
        started = time.perf_counter()
        compute(*means)
        wall = time.perf_counter() - started
    return Run(wall, _by_name((result.key, result.end_time - result.start_time) for result in profiler.results))


def _on_cluster(kind: Kind, surface: Surface, processes: int) -> Run:
    """A run on single-threaded processes."""
    from dask.base import compute
    from distributed import get_task_stream

    with _cluster(processes) as client:
        client.run(_loaded, kind)
        runs = []
        for _ in range(TIMES):
            with get_task_stream(client) as stream:
                started = time.perf_counter()
                compute(*_means(kind, surface))
                wall = time.perf_counter() - started
            runs.append(Run(wall, _by_name((task["key"], _computing(task["startstops"])) for task in stream.data)))
        return min(runs, key=lambda run: run.wall)


def _computing(parts: list[dict[str, Any]]) -> float:
    """Seconds of a task without what was sent for it."""
    return float(sum(part["stop"] - part["start"] for part in parts if part["action"] == "compute"))


def _empty() -> float:
    """Processor time that client and scheduler, which are in this process, take for a task that does nothing [s]."""
    with _cluster(1) as client:
        started = time.process_time()
        client.gather(client.map(abs, range(EMPTY), pure=False))
        return (time.process_time() - started) / EMPTY


@contextmanager
def _cluster(processes: int) -> Iterator[Any]:
    """Single-threaded processes of this machine."""
    from distributed import Client, LocalCluster

    with (
        LocalCluster(
            n_workers=processes, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0", memory_limit=0
        ) as cluster,
        Client(cluster) as client,
    ):
        yield client


def _loaded(kind: Kind) -> None:
    """Load in a process what is compiled."""
    kind.image(kind.surface(64, 64).compute(), 1)


def _by_name(seconds: Any) -> dict[str, list[float]]:
    """Seconds of tasks, by what they do."""
    from dask.utils import key_split

    tasks: dict[str, list[float]] = {}
    for key, one in seconds:
        tasks.setdefault(key_split(key), []).append(one)
    return tasks


def twice(costs: dict[str, Cost]) -> str:
    """The table of efficiencies and overheads."""
    heads = (
        "image", "efficiency of two threads [%]", "of two processes of a cluster [%]", "overhead of a cluster [%]",
        "of the threaded scheduler [%]",
    )  # fmt: skip
    lines = []
    for name, cost in costs.items():
        one, two = cost.cluster
        efficiency = (cost.threads[0] / (2 * cost.threads[1]), one.wall / (2 * two.wall))
        shares = (*efficiency, one.overhead, cost.threaded.overhead)
        lines.append([name, *(f"{100 * share:.1f}" for share in shares)])
    return markdown(heads, lines)


# More cores


def forward(costs: dict[str, Cost]) -> str:
    """The table of what is to be expected of more cores."""
    ends = (f"{cores} cores: wall time [s] / efficiency [%]" for cores in CORES)
    lines = []
    for name, cost in costs.items():
        for side in MAPS:
            number = (side // SIDE) ** 2
            walls = [(cores, cost.wall(number, cores)) for cores in CORES]
            lines.append([
                name, f"{side} x {side}", f"{cost.block:.3g}", f"{1e3 * cost.describe:.2g}", f"{cost.tasks:.2g}",
                f"{1e3 * cost.empty:.2g}", f"{cost.plan:.2g}",
                *(f"{wall:.3g} / {100 * number * cost.block / (cores * wall):.0f}" for cores, wall in walls),
            ])  # fmt: skip
    return markdown(("image", "map", "c [s]", "g [ms]", "m", "o [ms]", "s [s]", *ends), lines)
