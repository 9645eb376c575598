"""Images of surfaces whose maps are Dask arrays: the same numbers, block by block and only when they are asked for.

The survey of the surface is a task for each block, joined in a tree; the plan of the image is one task; and each part
of it is filled by one more. The blocks of the maps are computed twice, for the survey and again after the plan, so
that none is kept in between. Where a tip goes along lines, parts are whole lines; where it carries a state from line to
line, each waits for the one above, and a row of blocks is not computed before the tip has left the row above it.
"""

from __future__ import annotations

import uuid
from collections.abc import Iterator
from dataclasses import replace
from functools import partial, reduce
from operator import getitem
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from phasemap._shared.arrays import Array, chunks_of, is_lazy
from phasemap._shared.errors import InputError, Word
from phasemap.experiment.realism import Realism
from phasemap.experiment.surface import Surface
from phasemap.experiment.surface_maps import QUANTITIES
from phasemap.imaging.canvas import Canvas, image_of, joined_notes
from phasemap.imaging.job import Job, LineRun, fill_part, plan_image, simulator_of
from phasemap.imaging.materials import Survey, Window, films_alike, survey
from phasemap.results.variables import FLAGS

Key = tuple[str, int] | str
Filled = tuple[dict[str, Array], dict[str, float], Any]  # variables, what the control found out, the tip's state

FAN = 16  # surveys that are joined at a time


def check_lazy(realism: Realism, strict: bool, progress: object, checkpoint: object) -> None:
    """Refuse options that need the whole image at once."""
    if strict:
        raise InputError(
            "strict", strict, "False for a surface in Dask arrays", "Look at `status` when it is computed."
        )
    if progress is not None:
        hint = "Dask has progress bars: dask.diagnostics.ProgressBar."
        raise InputError("progress", Word("given"), "None for a surface in Dask arrays", hint)
    if checkpoint is not None:
        hint = "Write the image with to_zarr, some of its rows at a time."
        raise InputError("checkpoint", checkpoint, "None for a surface in Dask arrays", hint)
    for name, none in (("drift", (0.0, 0.0, 0.0)), ("bits", None)):
        if (value := getattr(realism, name)) != none:
            hint = "It needs the whole image at once: take surface.compute()."
            raise InputError(name, value, f"{none} for a surface in Dask arrays", hint)


def simulate_lazily(job: Job) -> xr.Dataset:
    """Image variables in Dask arrays, and findings of a control, as variables without dimension."""
    try:
        import dask.array as da
        from dask.delayed import delayed
    except ImportError as error:
        raise InputError("surface", Word("in Dask arrays"), "maps in memory", f"Dask is not whole: {error}.") from error
    tiny = delayed(replace(job, surface=_placeholder(job.surface)), traverse=False)
    maps = BlockMaps.of(job.surface)
    filled = _filling(job, tiny, maps, _planned(job, tiny, maps))
    directions = job.control.directions
    front = (0,) if directions else ()
    chunks = (*((len(directions),) for _ in front), *filled.chunks)
    variables = {}
    for name in job.names:
        token = _token(name)
        tasks = {(token, *front, *at): (getitem, (getitem, key, 0), name) for at, key in filled.keys.items()}
        graph = _graph(token, tasks, [filled.last])
        variables[name] = da.Array(graph, token, chunks, np.int8 if name in FLAGS else np.float64)
    return image_of(job.surface, variables, directions).assign(_notes(job, filled))


class Filling(NamedTuple):
    """Tasks that fill an image and give a `Filled` of each part."""

    keys: dict[tuple[int, int], Key]  # their keys, by the number of the part from the top and from the left
    chunks: tuple[tuple[int, ...], tuple[int, ...]]  # heights and widths of the parts
    last: Any  # of the last of them, whose graph has all others in it


def _token(name: str) -> str:
    """A name that no other task has, of this process or another."""
    return f"phasemap-{name.replace('_', '')}-{uuid.uuid4().hex}"


def _graph(name: str, tasks: dict[Any, Any], below: list[Any]) -> Any:
    """Tasks on top of those of collections."""
    from dask.highlevelgraph import HighLevelGraph

    return HighLevelGraph.from_collections(name, tasks, below)


def _delayed(key: Key, name: str, tasks: dict[Any, Any], below: list[Any]) -> Any:
    """Delayed value of one of these tasks, on top of those of collections."""
    from dask.delayed import Delayed

    return Delayed(key, _graph(name, tasks, below), layer=name)


def _placeholder(surface: Surface) -> Surface:
    """Surface of two pixels in place of one whose maps are not computed: the plan asks only which maps there are.

    Films differ in it unless all are known to be alike, for the plan interpolates between alike ones only.
    """
    more: dict[str, Any] = {"viscosity": 0.0} if surface.viscosity is not None else {"damping": 0.0}
    thickness = 1e-8 if films_alike(surface) else [[1e-8, 2e-8]]
    more |= {} if surface.thickness is None else {"thickness": thickness}
    more |= {"relaxed_modulus": 1e9, "relaxation_time": 1e-7} if surface.relaxes else {}
    return Surface(1e9, **more, pixel_size=surface.pixel_size, shape=(1, 2), allow_nan=surface.allow_nan)


def _planned(job: Job, tiny: Any, maps: BlockMaps) -> Any:
    """The plan of the image, after a survey of each block."""
    most, token, joined = simulator_of(job.control).most(job), _token("survey"), _token("join")
    tasks: dict[Any, Any] = {}
    for part in (part for beside in maps.parts() for part in beside):
        tasks[token, len(tasks)] = (partial(_survey, most, part.place, part.lines), tiny.key, part.pieces)
    keys = list(tasks)
    while len(keys) > 1:
        groups = [keys[i : i + FAN] for i in range(0, len(keys), FAN)]
        keys = [(joined, len(tasks) + n) for n in range(len(groups))]
        tasks |= {key: (partial(_join, most), group) for key, group in zip(keys, groups, strict=True)}
    plan = _token("plan")
    tasks[plan] = (plan_image, tiny.key, keys[0])
    return _delayed(plan, token, tasks, [tiny, *maps.lazy])


def _survey(most: int, place: Window, lines: slice, job: Job, pieces: list[Any]) -> Survey:
    """Survey of one part of the image, in its task."""
    return survey(ImagePart(place, lines, pieces).surface(job.surface), most, place)


def _join(most: int, surveys: list[Survey]) -> Survey:
    """Survey of several parts together, in its task."""
    return reduce(lambda one, other: one.joined(other, most), surveys)


def _filling(job: Job, tiny: Any, maps: BlockMaps, plan: Any) -> Filling:
    """The parts of the image, each with a task of its own."""
    lines = maps.lines() if job.control.directions else None
    keys: dict[tuple[int, int], Key] = {}
    heights: list[int] = []
    state, last = None, plan
    for rows in maps.rows() if job.control.carried else [maps]:
        fresh, token, tasks = rows.after(last), _token("fill"), dict[Any, Any]()
        for beside in fresh.parts(lines):
            for column, part in enumerate(beside):
                key = token, len(tasks)
                tasks[key] = (partial(_fill, part.place, part.lines), tiny.key, plan.key, state, part.pieces)
                keys[len(heights), column] = key
            if job.control.carried:
                state = _token("state")
                tasks[state] = (getitem, key, 2)
            heights.append(part.lines.stop - part.lines.start)
        last = _delayed(state or key, token, tasks, [tiny, plan, last, *fresh.lazy])
    widths = maps.chunks[1] if lines is None else (sum(maps.chunks[1]),)
    return Filling(keys, (tuple(heights), widths), last)


def _fill(place: Window, lines: slice, job: Job, stretches: list[LineRun], state: Any, pieces: list[Any]) -> Filled:
    """Variables, notes and the tip's state after one part of the image, in its task."""
    part = replace(job, surface=ImagePart(place, lines, pieces).surface(job.surface), place=place)
    canvas = Canvas(part.surface, job.names, job.control.directions)
    state = fill_part(part, stretches, canvas, state)
    return canvas.arrays(), canvas.notes, state


def _notes(job: Job, filled: Filling) -> dict[str, Any]:
    """Findings of a control, as variables that are not known before they are computed."""
    import dask.array as da
    from dask.delayed import delayed

    long_names, token = simulator_of(job.control).notes, _token("notes")
    tasks: dict[Any, Any] = {(token, n): (getitem, key, 1) for n, key in enumerate(filled.keys.values())}
    whole = _token("notes")
    tasks[whole] = (_joined_notes, list(tasks))
    notes = _delayed(whole, token, tasks, [filled.last])
    return {
        name: xr.DataArray(
            da.from_delayed(delayed(getitem)(notes, name), (), np.float64), attrs={"long_name": long_name}
        )
        for name, long_name in long_names.items()
    }


def _joined_notes(notes: list[dict[str, float]]) -> dict[str, Array]:
    """Findings of the control over the whole image, in their task."""
    return {name: np.array(value, np.float64) for name, value in joined_notes(*notes).items()}


LINES = 1 << 20  # pixels of a part where parts are whole lines, at least one line


class ImagePart(NamedTuple):
    """Part of an image, with all that is needed to make its surface."""

    place: Window
    lines: slice  # of the blocks
    # Of each quantity None, a number, an array of the part, or a list of blocks beside each other; before they
    # are computed, of their keys
    pieces: list[Any]

    def surface(self, like: Surface) -> Surface:
        """The surface of the part, when its blocks are computed. `like`: with the same size of pixels."""
        maps = [self._whole(piece) if isinstance(piece, list) else piece for piece in self.pieces]
        shape = next(value.shape for value in maps if isinstance(value, np.ndarray))
        given = dict(zip(QUANTITIES, maps, strict=True))
        try:
            return Surface(**given, pixel_size=like.pixel_size, shape=shape, allow_nan=like.allow_nan)
        except InputError as error:
            row, column, _ = self.place
            where = f"Counted from row {row}, column {column} of the image, where this block begins."
            raise InputError(error.name, error.value, error.allowed, f"{error.hint} {where}".strip()) from error

    def _whole(self, blocks: list[Any]) -> Any:
        """Map of the part from the blocks beside each other, of which it has some lines."""
        cut = [block[self.lines] for block in blocks]
        return cut[0] if len(cut) == 1 else np.concatenate(cut, axis=1)


class BlockMaps(NamedTuple):
    """The maps of a surface, or some of its rows, in blocks of the same size."""

    values: list[Any]  # of each quantity None, an array in memory, or a Dask array
    chunks: tuple[tuple[int, ...], tuple[int, ...]]  # heights and widths of the blocks, those of the first Dask array
    place: Window

    @classmethod
    def of(cls, surface: Surface) -> BlockMaps:
        """Make the maps of a surface."""
        values = [getattr(surface, name) for name in QUANTITIES]
        rows, columns = chunks_of(next(value for value in values if is_lazy(value)))
        chunks = tuple(filter(None, rows)), tuple(filter(None, columns))  # a block may be empty
        values = [value.rechunk(chunks) if is_lazy(value) else value for value in values]
        return cls(values, chunks, Window(0, 0, surface.shape))

    @property
    def lazy(self) -> list[Any]:
        """The Dask arrays among them."""
        return [value for value in self.values if is_lazy(value)]

    def rows(self) -> Iterator[BlockMaps]:
        """Yield the maps of each row of blocks."""
        top = 0
        for height in self.chunks[0]:
            values = [None if value is None else value[top : top + height] for value in self.values]
            yield BlockMaps(values, ((height,), self.chunks[1]), self.place._replace(row=self.place.row + top))
            top += height

    def after(self, task: Any) -> BlockMaps:
        """Maps of the same values, but no block is computed before a task is done, even if it was before."""
        import dask.array as da
        from dask.highlevelgraph import HighLevelGraph

        mark = uuid.uuid4().hex
        tasks = _again(self.lazy, mark, task.key)  # together, so that what they share stays shared

        def later(value: Any) -> Any:
            name = _renamed(value.name, mark)
            return da.Array(HighLevelGraph.from_collections(name, tasks, [task]), name, value.chunks, value.dtype)

        return self._replace(values=[later(value) if is_lazy(value) else value for value in self.values])

    def lines(self) -> int:
        """Number of lines that are filled together: they divide a block evenly, for Zarr wants chunks of one size."""
        height, most = self.chunks[0][0], LINES // sum(self.chunks[1])
        return max((lines for lines in range(1, min(most, height) + 1) if height % lines == 0), default=1)

    def parts(self, lines: int | None = None) -> Iterator[list[ImagePart]]:
        """Parts beside each other, from top to bottom: the blocks, or so many whole lines of a row of blocks."""
        heights, widths = self.chunks
        edges = [0, *np.cumsum(widths).tolist()]
        spans = [(i, i + 1) for i in range(len(widths))] if lines is None else [(0, len(widths))]
        top = 0
        for row, height in enumerate(heights):
            for first in range(0, height, lines or height):
                last = min(first + (lines or height), height)
                yield [
                    ImagePart(
                        Window(self.place.row + top + first, edges[left], self.place.image),
                        slice(first, last),
                        self._pieces(row, range(left, right), slice(top + first, top + last), edges),
                    )
                    for left, right in spans
                ]
            top += height

    def _pieces(self, row: int, columns: range, rows: slice, edges: list[int]) -> list[Any]:
        """For each quantity, what `ImagePart.pieces` takes: for Dask arrays the keys of their blocks."""
        cut = np.s_[rows, edges[columns.start] : edges[columns.stop]]

        def piece(value: Any) -> Any:
            if value is None:
                return None
            if is_lazy(value):
                return [(value.name, row, column) for column in columns]
            return value[cut] if any(value.strides) else float(value[0, 0])  # one number that is everywhere

        return [piece(value) for value in self.values]


def _again(arrays: list[Any], mark: str, after: Any) -> dict[Any, Any]:
    """The tasks that make some arrays, under other names, where those that wait for none wait for one.

    `dask.graph_manipulation.bind` leaves many of them as they are (dask 2026.8).
    """
    from dask._task_spec import convert_legacy_graph
    from dask.core import flatten
    from dask.highlevelgraph import HighLevelGraph

    graph = dict(HighLevelGraph.merge(*(array.__dask_graph__() for array in arrays)))
    nodes = convert_legacy_graph(graph)
    waiting = list(flatten(array.__dask_keys__() for array in arrays))
    tasks: dict[Any, Any] = {}
    while waiting:
        key = waiting.pop()
        name = _renamed(key, mark)
        if name in tasks:
            continue
        if key not in nodes:  # what a cluster keeps stays where it is
            tasks[key], tasks[name] = graph[key], key
            continue
        node = nodes[key]
        waiting += node.dependencies
        again = node.substitute({one: _renamed(one, mark) for one in node.dependencies}, key=name)
        tasks[name] = again if node.dependencies else (_first, again, after)
    return tasks


def _first(value: Any, _after: Any) -> Any:
    """The value, once the task after which it has to be is done."""
    return value


def _renamed(key: Any, mark: str) -> Any:
    """Key of a task under the name that this mark gives it."""
    return (_renamed(key[0], mark), *key[1:]) if isinstance(key, tuple) else f"{key}-{mark}"
