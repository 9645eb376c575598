"""Checkpoints of a long simulation, kept in a folder, so that it goes on after it was killed."""

from __future__ import annotations

import hashlib
import inspect
import json
import os
import re
import sys
import time
import uuid
import warnings
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from phasemap._kernels.columns import RELEASE, ROW
from phasemap._kernels.law import digest_of
from phasemap._shared.errors import FileError
from phasemap._shared.files import replacing
from phasemap.experiment.interaction import ContactLaw
from phasemap.experiment.interaction.base import is_own
from phasemap.experiment.surface import Surface
from phasemap.experiment.surface_maps import QUANTITIES
from phasemap.imaging.canvas import Values
from phasemap.results.variables import provenance

EVERY = 2.0  # seconds of work that may be lost
GROWTH = 4  # at most, of what is done at a time
LIST = "names"  # of what is in a file, for a damaged one may have lost some
PART = re.compile(r"[0-9a-f]{64}-(lines-\d+-\d+|materials-\d+)\.npz")


class FilledLines(NamedTuple):
    """Lines that were filled."""

    # first, last: from this line to before that one
    first: int
    last: int
    arrays: Values  # their variables
    notes: dict[str, float]
    state: Values  # in which the tip left them, as `job.Simulator.freeze` gives it


class Checkpoint:
    """Folder with the lines that one simulation has done, made when there is something to be kept.

    The names of its files begin with the SHA-256 of all that the image depends on, `configuration`, so that what
    another simulation left is never taken for it. A file appears whole or not at all. Where none can be written, a
    warning says so once and the simulation goes on without; only something else in its place is an error.
    """

    def __init__(
        self, folder: str | os.PathLike[str], surface: Surface, law: ContactLaw, configuration: Mapping[str, Any]
    ) -> None:
        self.folder = Path(folder)
        if os.path.exists(self.folder) and not os.path.isdir(self.folder):
            raise FileError(f"cannot keep what is done in {self.folder}: it is no folder.")
        self._name = _identity(surface, law, configuration)
        self._writes, self._last = True, time.monotonic()

    def portions(self, first: int, last: int, least: int, most: int) -> Iterator[slice]:
        """Slices from `first` to `last`, each of which takes the time between two files, by what the last one took.

        They have multiples of `least`, and mostly no more than `most`.
        """
        size = GROWTH * least
        while first < last:
            began = time.monotonic()
            yield slice(first, min(first + size, last))
            first, wanted = first + size, size * EVERY / max(time.monotonic() - began, 1e-6)
            size = least * max(1, int(min(wanted, GROWTH * size, most)) // least)

    def recall(self, name: str) -> Values:
        """Arrays kept under this name; empty if there are none, or they cannot be read."""
        return _read(self.folder / f"{self._name}-{name}.npz")

    @property
    def due(self) -> bool:
        """True if the last file is some seconds ago."""
        return time.monotonic() - self._last >= EVERY

    def remember(self, name: str, values: Values) -> None:
        """Keep arrays, in place of those that were kept under this name."""
        self._write(f"{self._name}-{name}.npz", values)

    def lines(self) -> Iterator[FilledLines]:
        """Yield the lines of the image that were kept, from the first on as far as there is no gap."""
        bounds: list[list[int]] = []
        with suppress(OSError):
            names = [name for name in os.listdir(self.folder) if PART.fullmatch(name)]
            mine = [name.removesuffix(".npz") for name in names if name.startswith(f"{self._name}-lines-")]
            bounds = [[int(bound) for bound in name.split("-")[2:]] for name in mine]
        kept = {first: last for first, last in sorted(bounds) if first < last}  # the longest that begin there
        first = 0
        while first in kept:
            last = kept[first]
            arrays = _read(self.folder / self._lines(first, last))
            if not arrays:
                return
            notes = {name: value.item() for name, value in _of_kind("note", arrays).items()}
            yield FilledLines(first, last, _of_kind("variable", arrays), notes, _of_kind("state", arrays))
            first = last

    def keep(self, lines: FilledLines) -> None:
        """Keep lines."""
        variables = {f"variable.{name}": values for name, values in lines.arrays.items()}
        notes = {f"note.{name}": np.array(value) for name, value in lines.notes.items()}
        state = {f"state.{name}": values for name, values in lines.state.items()}
        self._write(self._lines(lines.first, lines.last), {**variables, **notes, **state})

    def _lines(self, first: int, last: int) -> str:
        """Name of the file of lines `first` to `last`, which `lines` reads back."""
        return f"{self._name}-lines-{first:08}-{last:08}.npz"

    def _write(self, name: str, values: Values) -> None:
        """Write a file at once or not at all; after the first failure warn, and write no more."""
        if not self._writes:
            return
        try:
            self.folder.mkdir(exist_ok=True)
            with replacing(self.folder / name, overwrite=True) as temporary:
                np.savez(temporary, **{**values, LIST: np.array(list(values))})
        except (OSError, ValueError) as error:  # ValueError: a folder that no file system can name
            self._writes = False
            warnings.warn(f"nothing is kept for another try: {error}", stacklevel=2)
        self._last = time.monotonic()


def discard(folder: str | os.PathLike[str]) -> None:
    """Delete the files that simulations kept in a folder, and the folder if it is empty then."""
    with suppress(OSError):
        for name in os.listdir(folder):
            if PART.fullmatch(name) or (name.startswith(".") and name.endswith(".tmp.npz")):
                Path(folder, name).unlink(missing_ok=True)
        os.rmdir(folder)


def _law_in_words(law: ContactLaw) -> str:
    """Text that tells a user's law from others: its parameters, its code, and what its formulas use."""
    if not is_own(law):
        return ""
    try:
        modules = sorted({kind.__module__ for kind in type(law).__mro__ if issubclass(kind, ContactLaw)})
        code = [inspect.getsource(sys.modules[name]) for name in modules]
        stiffness, adhesion, radius = np.array([1e9]), np.array([0.05]), 1e-8
        row = np.zeros(ROW)
        for j, column in enumerate(law.columns(stiffness, adhesion, radius)):
            row[j] = np.broadcast_to(column, 1)[0]
        row[RELEASE] = np.broadcast_to(law.release(stiffness, adhesion, radius), 1)[0]
        formulas = law.force, law.slope, law.damping, law.damping_slope, law.attraction.force, law.attraction.slope
        digests = [digest_of(one) for one in formulas]
        if None not in digests:
            return repr([code, getattr(law, "__dict__", {}), row.tolist(), digests])
    except Exception:  # typed into a shell, or methods that do not work here
        pass
    return str(uuid.uuid4())  # nothing that was kept is taken for it


def _identity(surface: Surface, law: ContactLaw, configuration: Mapping[str, Any]) -> str:
    """The SHA-256 of all that an image depends on."""
    digest = hashlib.sha256(provenance({}, "")["phasemap_version"].encode())
    digest.update(json.dumps([_law_in_words(law), configuration], sort_keys=True, default=str).encode())
    for name in QUANTITIES:
        value = getattr(surface, name)
        digest.update(name.encode())
        if value is not None:
            digest.update(np.ascontiguousarray(value if any(value.strides) else value[:1, :1]).data)
    return digest.hexdigest()


def _read(file: Path) -> Values:
    """The arrays in a file; empty if there is none, or it is damaged."""
    try:
        with file.open("rb") as opened, np.load(opened, allow_pickle=False) as archive:
            if archive.zip.testzip() is not None:
                return {}
            arrays = dict(archive)
            return arrays if set(arrays.pop(LIST).tolist()) == set(arrays) else {}
    except Exception:  # whatever the libraries meet in a damaged file
        return {}


def _of_kind(kind: str, arrays: Values) -> Values:
    """Arrays whose names begin with the kind, by the rest of their names."""
    return {name.removeprefix(f"{kind}."): one for name, one in arrays.items() if name.startswith(f"{kind}.")}
