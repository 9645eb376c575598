"""Images of surfaces whose maps are Dask arrays: the same numbers, block by block and only when they are asked for.

The survey of the surface is a task for each block, joined in a tree; the plan of the image is one task; and each block
is painted by one more. Where a control carries a state the blocks are whole lines and each waits for the one above it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from phasemap.canvas import Canvas, image_of, joined_notes
from phasemap.dataset import FLAGS
from phasemap.errors import InputError, Word
from phasemap.job import Job
from phasemap.lazy import chunks_of, is_lazy
from phasemap.painting import Stretch, paint_part, painter_of, plan_image
from phasemap.realism import Realism
from phasemap.surface import Surface
from phasemap.surface_dataset import QUANTITIES
from phasemap.survey import Place, Survey, survey

if TYPE_CHECKING:
    import xarray as xr

Array = np.ndarray
Chunks = tuple[tuple[int, ...], tuple[int, ...]]
Blocks = list[tuple[Place, list[Any]]]  # where each lies, and its maps, rows of blocks one after the other

LINES = 1 << 20  # pixels of a block where blocks are whole lines, at least one line
FAN = 16  # surveys that are joined at a time


def check_lazy(realism: Realism, strict: bool, progress: object, checkpoint: object) -> None:
    """Refuse what needs the whole image at once.

    Raises
    ------
    InputError
    """
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


def paint_lazily(job: Job) -> xr.Dataset:
    """Make the image of a surface in Dask arrays, as Dask arrays.

    Parameters
    ----------
    job : Job
        For the whole image.

    Returns
    -------
    xarray.Dataset
        The image variables, and what a control finds out (gains of a feedback) as variables without dimension.

    Raises
    ------
    InputError
        If Dask is not there.
    """
    delayed, _ = _dask()
    chunks = _chunks(job)
    blocks = list(_blocks(job.surface, chunks))
    tiny = delayed(replace(job, surface=_placeholder(job.surface)))
    most = painter_of(job.control).most(job)
    stretches = delayed(plan_image)(tiny, _surveyed([delayed(_survey)(tiny, most, *block) for block in blocks], most))
    paint, state = delayed(_paint, nout=3), None
    painted = []
    for place, maps in blocks:
        arrays, notes, left = paint(tiny, stretches, state, place, maps)
        state = left if job.control.carried else None
        painted.append((arrays, notes))
    image = image_of(job.surface, _variables(job, chunks, [arrays for arrays, _ in painted]), job.control.directions)
    return image.assign(_notes(job, [notes for _, notes in painted]))


def _dask() -> tuple[Any, Any]:
    """`dask.delayed`, for tasks that are never the same as others, and `dask.array`."""
    try:
        import dask.array
        from dask.delayed import delayed
    except ImportError as error:
        raise InputError("surface", Word("in Dask arrays"), "maps in memory", f"Dask is not whole: {error}.") from error
    return delayed, dask.array


def _chunks(job: Job) -> Chunks:
    """Heights and widths of the blocks: those of the first lazy map, or whole lines where a tip goes along them."""
    first = next(value for name in QUANTITIES if is_lazy(value := getattr(job.surface, name)))
    rows, columns = chunks_of(first)
    if not job.control.directions:
        return rows, columns
    ny, nx = job.surface.shape
    height = min(max(LINES // nx, 1), max(rows))
    return tuple(min(height, ny - top) for top in range(0, ny, height)), (nx,)


def _blocks(surface: Surface, chunks: Chunks) -> Iterator[tuple[Place, list[Any]]]:
    """Where the blocks lie, and their maps: numbers, parts of arrays in memory, or tasks."""
    maps = [getattr(surface, name) for name in QUANTITIES]
    grids = [value.rechunk(chunks).to_delayed() if is_lazy(value) else None for value in maps]
    top = 0
    for i, height in enumerate(chunks[0]):
        left = 0
        for j, width in enumerate(chunks[1]):
            cut = np.s_[top : top + height, left : left + width]
            parts = [
                value if value is None else _part(value[cut]) if grid is None else grid[i, j]
                for value, grid in zip(maps, grids, strict=True)
            ]
            yield Place(top, left, surface.shape), parts
            left += width
        top += height


def _part(values: Array) -> Array | float:
    """Part of a map in memory; one number where it is the same everywhere."""
    return float(values[0, 0]) if not any(values.strides) else values


def _placeholder(surface: Surface) -> Surface:
    """One pixel of the same kind."""
    loss = {"viscosity": 0.0} if surface.viscosity is not None else {"damping": 0.0}
    return Surface(1.0, **loss, pixel_size=surface.pixel_size, shape=(1, 1), allow_nan=surface.allow_nan)


def _surface(job: Job, place: Place, maps: list[Any]) -> Surface:
    """The surface of a block."""
    shape = next(value.shape for value in maps if isinstance(value, np.ndarray))
    given = dict(zip(QUANTITIES, maps, strict=True))
    try:
        return Surface(**given, pixel_size=job.surface.pixel_size, shape=shape, allow_nan=job.surface.allow_nan)
    except InputError as error:
        where = f"Counted from row {place.row}, column {place.column} of the image, where this block begins."
        raise InputError(error.name, error.value, error.allowed, f"{error.hint} {where}".strip()) from error


def _survey(job: Job, most: int, place: Place, maps: list[Any]) -> Survey:
    return survey(_surface(job, place, maps), most, place)


def _surveyed(surveys: list[Any], most: int) -> Any:
    """One task for the survey of all."""
    delayed, _ = _dask()
    while len(surveys) > 1:
        surveys = [delayed(_join)(surveys[i : i + FAN], most) for i in range(0, len(surveys), FAN)]
    return surveys[0]


def _join(surveys: list[Survey], most: int) -> Survey:
    first, *others = surveys
    for other in others:
        first = first.joined(other, most)
    return first


def _paint(
    job: Job, stretches: list[Stretch], state: Any, place: Place, maps: list[Any]
) -> tuple[dict[str, Array], dict[str, float], Any]:
    """Variables of a block, what the control found out, and the state in which the tip leaves it."""
    part = replace(job, surface=_surface(job, place, maps), place=place)
    canvas = Canvas(part.surface, job.names, job.control.directions)
    state = paint_part(part, stretches, canvas, state)
    return canvas.arrays(), canvas.notes, state


def _variables(job: Job, chunks: Chunks, painted: list[Any]) -> dict[str, Any]:
    """Dask arrays of the image variables, from the tasks that paint the blocks."""
    delayed, da = _dask()
    front = (len(job.control.directions),) if job.control.directions else ()
    rows, columns = chunks

    def variable(name: str) -> Any:
        dtype = np.int8 if name in FLAGS else np.float64
        of_name = (delayed(dict.__getitem__)(arrays, name) for arrays in painted)
        grid = [[da.from_delayed(next(of_name), (*front, h, w), dtype) for w in columns] for h in rows]
        return da.block(grid)

    return {name: variable(name) for name in job.names}


def _notes(job: Job, notes: list[Any]) -> dict[str, Any]:
    """What a control finds out, as variables that are not known before they are computed."""
    import xarray as xr

    delayed, da = _dask()
    whole = delayed(_joined_notes)(notes)
    scalars = {}
    for name, long_name in painter_of(job.control).notes.items():
        value = da.from_delayed(delayed(dict.__getitem__)(whole, name), (), np.float64)
        scalars[name] = xr.DataArray(value, attrs={"long_name": long_name})
    return scalars


def _joined_notes(notes: list[dict[str, float]]) -> dict[str, Array]:
    return {name: np.array(value, np.float64) for name, value in joined_notes(*notes).items()}
