"""How a surface whose maps are Dask arrays is cut into parts, each of which a task can work on."""

from __future__ import annotations

import uuid
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from phasemap._shared.dask_arrays import chunks_of, is_lazy
from phasemap._shared.errors import InputError
from phasemap.experiment.surface import Surface
from phasemap.experiment.surface_variables import QUANTITIES
from phasemap.imaging.materials.survey import Place

LINES = 1 << 20  # pixels of a part where parts are whole lines, at least one line


class Part(NamedTuple):
    """A part of an image, and what it takes to make its surface."""

    place: Place
    lines: slice  # of the blocks
    # Of each quantity None, a number, an array of the part, or a list of blocks beside each other; before they
    # are computed, of their keys
    pieces: list[Any]

    def surface(self, like: Surface) -> Surface:
        """The surface of the part, when its blocks are computed.

        `like`: with the same size of pixels.
        """
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
        cut = [block[self.lines] for block in blocks]
        return cut[0] if len(cut) == 1 else np.concatenate(cut, axis=1)


class Maps(NamedTuple):
    """The maps of a surface, or some of its rows, in blocks of the same size."""

    values: list[Any]  # of each quantity None, an array in memory, or a Dask array
    chunks: tuple[tuple[int, ...], tuple[int, ...]]  # heights and widths of the blocks, those of the first Dask array
    place: Place

    @classmethod
    def of(cls, surface: Surface) -> Maps:
        """Those of a surface."""
        values = [getattr(surface, name) for name in QUANTITIES]
        rows, columns = chunks_of(next(value for value in values if is_lazy(value)))
        chunks = tuple(filter(None, rows)), tuple(filter(None, columns))  # a block may be empty
        values = [value.rechunk(chunks) if is_lazy(value) else value for value in values]
        return cls(values, chunks, Place(0, 0, surface.shape))

    @property
    def lazy(self) -> list[Any]:
        """The Dask arrays among them."""
        return [value for value in self.values if is_lazy(value)]

    def rows(self) -> Iterator[Maps]:
        """Each row of blocks by itself."""
        top = 0
        for height in self.chunks[0]:
            values = [None if value is None else value[top : top + height] for value in self.values]
            yield Maps(values, ((height,), self.chunks[1]), self.place._replace(row=self.place.row + top))
            top += height

    def after(self, task: Any) -> Maps:
        """The same maps, but no block is computed before a task is done, even if it was before."""
        import dask.array as da
        from dask.highlevelgraph import HighLevelGraph

        mark = uuid.uuid4().hex
        tasks = _again(self.lazy, mark, task.key)  # together, so that what they share stays shared

        def later(value: Any) -> Any:
            name = _renamed(value.name, mark)
            return da.Array(HighLevelGraph.from_collections(name, tasks, [task]), name, value.chunks, value.dtype)

        return self._replace(values=[later(value) if is_lazy(value) else value for value in self.values])

    def lines(self) -> int:
        """How many lines are filled together: as many as divide a block evenly, for Zarr wants chunks of one size."""
        height, most = self.chunks[0][0], LINES // sum(self.chunks[1])
        return max((lines for lines in range(1, min(most, height) + 1) if height % lines == 0), default=1)

    def parts(self, lines: int | None = None) -> Iterator[list[Part]]:
        """Parts beside each other, from top to bottom: the blocks, or so many whole lines of a row of blocks."""
        heights, widths = self.chunks
        edges = [0, *np.cumsum(widths).tolist()]
        spans = [(i, i + 1) for i in range(len(widths))] if lines is None else [(0, len(widths))]
        top = 0
        for row, height in enumerate(heights):
            for first in range(0, height, lines or height):
                last = min(first + (lines or height), height)
                yield [
                    Part(
                        Place(self.place.row + top + first, edges[left], self.place.image),
                        slice(first, last),
                        self._pieces(row, range(left, right), slice(top + first, top + last), edges),
                    )
                    for left, right in spans
                ]
            top += height

    def _pieces(self, row: int, columns: range, rows: slice, edges: list[int]) -> list[Any]:
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
    return value


def _renamed(key: Any, mark: str) -> Any:
    return (_renamed(key[0], mark), *key[1:]) if isinstance(key, tuple) else f"{key}-{mark}"
