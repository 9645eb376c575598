"""What is done of a long simulation, kept in a folder, so that it goes on after it was killed."""

from __future__ import annotations

import hashlib
import inspect
import json
import os
import re
import time
import uuid
import warnings
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from phasemap.canvas import Canvas, joined_notes
from phasemap.dataset import provenance
from phasemap.errors import FileError
from phasemap.io.netcdf import replacing
from phasemap.job import Job, Values
from phasemap.painting import Stretch, paint_part, painter_of
from phasemap.surface import Surface
from phasemap.surface_dataset import QUANTITIES

__all__ = ["Checkpoint", "discard", "paint_kept"]

EVERY = 2.0  # seconds of work that may be lost
GROWTH = 4  # at most, of the number of lines that are painted at a time
PART = re.compile(r"[0-9a-f]{64}-(lines-\d+-\d+|materials-\d+)\.npz")


class Lines(NamedTuple):
    """Lines that were painted.

    Attributes
    ----------
    first, last : int
        From this line to before that one.
    arrays : dict of str to ndarray
        Their variables.
    notes : dict of str to float
    state : dict of str to ndarray
        In which the tip left them, as `Painter.freeze` gives it.
    """

    first: int
    last: int
    arrays: Values
    notes: dict[str, float]
    state: Values


class Checkpoint:
    """A folder with what is done of one simulation.

    The names of its files begin with the SHA-256 of all that the image depends on, so that what another simulation left
    is never taken for it. A file appears whole or not at all. Where none can be written, a warning says so once and the
    simulation goes on without.

    Parameters
    ----------
    folder : path-like
        Made when there is something to be kept.
    surface : Surface
    law : ContactLaw
    configuration : mapping
        Everything else.

    Raises
    ------
    FileError
        If there is something else in the place of the folder.
    """

    def __init__(
        self, folder: str | os.PathLike[str], surface: Surface, law: object, configuration: Mapping[str, Any]
    ) -> None:
        self.folder = Path(folder)
        if self.folder.exists() and not self.folder.is_dir():
            raise FileError(f"cannot keep what is done in {self.folder}: it is no folder.")
        self._name = _identity(surface, law, configuration)
        self._writes, self._last = True, time.monotonic()

    def recall(self, name: str) -> Values:
        """What was kept under this name; empty if nothing was, or it cannot be read."""
        return _read(self.folder / f"{self._name}-{name}.npz")

    def remember(self, name: str, values: Values) -> None:
        """Keep it, if the last is some seconds ago."""
        if time.monotonic() - self._last >= EVERY:
            self._write(name, values)

    def lines(self) -> Iterator[Lines]:
        """What was kept of the image, from its first line on as far as there is no gap."""
        kept: dict[int, int] = {}
        with suppress(OSError):
            for name in os.listdir(self.folder):
                if name.startswith(f"{self._name}-lines-") and PART.fullmatch(name):
                    first, last = map(int, name.removesuffix(".npz").split("-")[2:])
                    kept[first] = max(last, kept.get(first, 0))
        first = 0
        while first in kept:
            last = kept[first]
            found = _read(self.folder / self._lines(first, last))
            if not found:
                return
            notes = {name: value.item() for name, value in _under("note", found).items()}
            yield Lines(first, last, _under("variable", found), notes, _under("state", found))
            first = last

    def keep(self, lines: Lines) -> None:
        """Keep lines."""
        variables = {f"variable.{name}": values for name, values in lines.arrays.items()}
        notes = {f"note.{name}": np.array(value) for name, value in lines.notes.items()}
        state = {f"state.{name}": values for name, values in lines.state.items()}
        self._write(self._lines(lines.first, lines.last), {**variables, **notes, **state})

    def _lines(self, first: int, last: int) -> str:
        return f"{self._name}-lines-{first:08}-{last:08}.npz"

    def _write(self, name: str, values: Values) -> None:
        if not self._writes:
            return
        file = self.folder / (name if name.endswith(".npz") else f"{self._name}-{name}.npz")
        try:
            self.folder.mkdir(exist_ok=True)
            with replacing(file, overwrite=True) as temporary:
                np.savez(temporary, **values)
        except OSError as error:
            self._writes = False
            warnings.warn(f"nothing is kept for another try: {error}", stacklevel=2)
        self._last = time.monotonic()


def discard(folder: str | os.PathLike[str]) -> None:
    """Delete what simulations kept in a folder, and the folder if it is empty then."""
    with suppress(OSError):
        for name in os.listdir(folder):
            if PART.fullmatch(name) or (name.startswith(".") and name.endswith(".tmp.npz")):
                Path(folder, name).unlink(missing_ok=True)
        os.rmdir(folder)


def _source(law: object) -> str:
    """The code of a law that is not phasemap's own: with another formula it is another law."""
    if type(law).__module__.startswith("phasemap."):
        return ""
    try:
        return inspect.getsource(type(law))
    except (OSError, TypeError):  # typed into a shell
        return str(uuid.uuid4())


def _identity(surface: Surface, law: object, configuration: Mapping[str, Any]) -> str:
    """The SHA-256 of all that an image depends on."""
    digest = hashlib.sha256(provenance({}, "")["phasemap_version"].encode())
    digest.update(json.dumps([_source(law), configuration], sort_keys=True, default=str).encode())
    for name in QUANTITIES:
        value = getattr(surface, name)
        digest.update(name.encode())
        if value is not None:
            digest.update(np.ascontiguousarray(value if any(value.strides) else value[:1, :1]).data)
    return digest.hexdigest()


def _read(file: Path) -> Values:
    """The arrays in a file; empty if there is none, or it is damaged."""
    try:
        with file.open("rb") as opened, np.load(opened, allow_pickle=False) as found:
            return dict(found)
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return {}


def _under(kind: str, arrays: Values) -> Values:
    """Those whose names begin with the kind, without it."""
    return {name.removeprefix(f"{kind}."): one for name, one in arrays.items() if name.startswith(f"{kind}.")}


def paint_kept(job: Job, stretches: list[Stretch], canvas: Canvas, checkpoint: Checkpoint) -> None:
    """Fill the canvas some lines at a time, keep them every few seconds, and go on after those that were kept.

    How many lines are painted at a time depends on how long they take; the numbers do not depend on it.
    """
    painter, surface = painter_of(job.control), job.surface
    first, state = _restored(job, canvas, checkpoint)
    waiting, height, since = Lines(first, first, {}, {}, {}), 4 * job.workers, time.monotonic()
    while first < surface.shape[0]:
        rows, began = slice(first, min(first + height, surface.shape[0])), time.monotonic()
        part = canvas.part(surface.rows(rows), rows)
        mine = replace(job, surface=surface.rows(rows), place=job.place._replace(row=first))
        state = paint_part(mine, stretches, part, state)
        canvas.note(part.notes)
        waiting = waiting._replace(last=rows.stop, notes=joined_notes(waiting.notes, part.notes))
        first, now = rows.stop, time.monotonic()
        if now - since >= EVERY:
            done = slice(waiting.first, waiting.last)
            arrays = canvas.part(surface.rows(done), done).arrays()
            checkpoint.keep(waiting._replace(arrays=arrays, state=painter.freeze(state)))
            waiting, since = Lines(first, first, {}, {}, {}), time.monotonic()
        height = max(1, min(GROWTH * height, int(height * EVERY / max(now - began, 1e-6))))


def _restored(job: Job, canvas: Canvas, checkpoint: Checkpoint) -> tuple[int, Any]:
    """Fill in the lines that were kept; returns the first that is not, and the state in which the tip comes to it."""
    first, state = 0, None
    for kept in checkpoint.lines():
        rows = slice(kept.first, kept.last)
        canvas.part(job.surface.rows(rows), rows).restore(kept.arrays)
        canvas.note(kept.notes)
        first, state = kept.last, painter_of(job.control).thaw(kept.state)
    if first:
        job.report(first * job.surface.shape[1])
    return first, state
