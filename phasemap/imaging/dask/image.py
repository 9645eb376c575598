"""Images of surfaces whose maps are Dask arrays: the same numbers, block by block and only when they are asked for.

The survey of the surface is a task for each block, joined in a tree; the plan of the image is one task; and each part
of it is filled by one more. The blocks of the maps are computed twice, for the survey and again after the plan, so
that none is kept in between. Where a tip goes along lines, parts are whole lines; where it carries a state from line to
line, each waits for the one above, and a row of blocks is not computed before the tip has left the row above it.
"""

from __future__ import annotations

import uuid
from dataclasses import replace
from functools import partial, reduce
from operator import getitem
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from phasemap._shared.errors import InputError, Word
from phasemap.experiment.realism import Realism
from phasemap.experiment.surface import Surface
from phasemap.imaging.canvas import Canvas, image_of, joined_notes
from phasemap.imaging.dask.parts import Maps, Part
from phasemap.imaging.job import Job
from phasemap.imaging.materials.survey import Place, Survey, survey
from phasemap.imaging.plan import Stretch, fill_part, plan_image, simulator_of
from phasemap.results.variables import FLAGS

Array = np.ndarray
Key = tuple[str, int] | str
Filled = tuple[dict[str, Array], dict[str, float], Any]  # variables, what the control found out, the tip's state

FAN = 16  # surveys that are joined at a time


def check_lazy(realism: Realism, strict: bool, progress: object, checkpoint: object) -> None:
    """Refuse what needs the whole image at once."""
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
    """Make the image of a surface in Dask arrays, as Dask arrays.

    Returns the image variables, and what a control finds out (gains of a feedback) as variables without dimension.
    """
    try:
        import dask.array as da
        from dask.delayed import delayed
    except ImportError as error:
        raise InputError("surface", Word("in Dask arrays"), "maps in memory", f"Dask is not whole: {error}.") from error
    tiny = delayed(replace(job, surface=_placeholder(job.surface)), traverse=False)
    maps = Maps.of(job.surface)
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


def _one(key: Key, name: str, tasks: dict[Any, Any], below: list[Any]) -> Any:
    """One of these tasks, on top of those of collections."""
    from dask.delayed import Delayed

    return Delayed(key, _graph(name, tasks, below), layer=name)


def _placeholder(surface: Surface) -> Surface:
    """One pixel of the same kind."""
    more = {"viscosity": 0.0} if surface.viscosity is not None else {"damping": 0.0}
    more |= {} if surface.thickness is None else {"thickness": 1e-8}
    more |= {"relaxed_modulus": 1e9, "relaxation_time": 1e-7} if surface.relaxes else {}
    return Surface(1e9, **more, pixel_size=surface.pixel_size, shape=(1, 1), allow_nan=surface.allow_nan)


def _planned(job: Job, tiny: Any, maps: Maps) -> Any:
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
    return _one(plan, token, tasks, [tiny, *maps.lazy])


def _survey(most: int, place: Place, lines: slice, job: Job, pieces: list[Any]) -> Survey:
    return survey(Part(place, lines, pieces).surface(job.surface), most, place)


def _join(most: int, surveys: list[Survey]) -> Survey:
    return reduce(lambda one, other: one.joined(other, most), surveys)


def _filling(job: Job, tiny: Any, maps: Maps, plan: Any) -> Filling:
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
        last = _one(state or key, token, tasks, [tiny, plan, last, *fresh.lazy])
    widths = maps.chunks[1] if lines is None else (sum(maps.chunks[1]),)
    return Filling(keys, (tuple(heights), widths), last)


def _fill(place: Place, lines: slice, job: Job, stretches: list[Stretch], state: Any, pieces: list[Any]) -> Filled:
    part = replace(job, surface=Part(place, lines, pieces).surface(job.surface), place=place)
    canvas = Canvas(part.surface, job.names, job.control.directions)
    state = fill_part(part, stretches, canvas, state)
    return canvas.arrays(), canvas.notes, state


def _notes(job: Job, filled: Filling) -> dict[str, Any]:
    """What a control finds out, as variables that are not known before they are computed."""
    import dask.array as da
    from dask.delayed import delayed

    long_names, token = simulator_of(job.control).notes, _token("notes")
    tasks: dict[Any, Any] = {(token, n): (getitem, key, 1) for n, key in enumerate(filled.keys.values())}
    whole = _token("notes")
    tasks[whole] = (_joined_notes, list(tasks))
    notes = _one(whole, token, tasks, [filled.last])
    return {
        name: xr.DataArray(
            da.from_delayed(delayed(getitem)(notes, name), (), np.float64), attrs={"long_name": long_name}
        )
        for name, long_name in long_names.items()
    }


def _joined_notes(notes: list[dict[str, float]]) -> dict[str, Array]:
    return {name: np.array(value, np.float64) for name, value in joined_notes(*notes).items()}
