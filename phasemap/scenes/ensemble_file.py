"""The file of an ensemble: a small file a sample while they are made, and one netCDF file in the end."""

from __future__ import annotations

import hashlib
import json
import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from phasemap._shared.errors import FileError, InputError, PhasemapError
from phasemap._shared.files import digest_of, reason_of, replacing
from phasemap.io.netcdf import COMPRESSION_LEVEL, opened
from phasemap.results.variables import provenance
from phasemap.scenes.surface import place_of

if TYPE_CHECKING:
    import netCDF4

NUMBERS = {  # long name and units, of what is a number a sample
    "failed": ("pixels whose status is not good", "1"),
    "irregular": ("pixels with irregular motion", "1"),
    "distinct_materials": ("distinct materials; pixels where they are too many to count", "1"),
    "adhesion_force": ("largest adhesion between tip and sample", "N"),
    "lever_force": ("stiffness times free amplitude", "N"),
}

CONTENTS = "image and truth"  # of a part; one with other contents is not taken for it

Table = dict[str, Any]
Form = dict[str, tuple[int, ...]]
Key = tuple[str, Mapping[str, str], list[Any]]  # the name of a variable, its attributes, a value a sample


class PartsFolder:
    """The folder ``OUT.nc.parts`` with one netCDF file for each sample that is done.

    The name of a file is the SHA-256 of all that its image depends on: the sample's scene, the files that the scene
    names, relative to `folder`, and the version of phasemap. So an image of another scene is never taken for it, and a
    sample that was done is not done again after others were changed or added.
    """

    def __init__(self, output: Path, scenes: Iterable[Table], folder: Path) -> None:
        self.folder = output.with_name(f"{output.name}.parts")
        digest = cache(partial(_digest, folder))  # of files, each read once
        self.files = [self.folder / f"{_identity(tables, digest)}.nc" for tables in scenes]
        self._samples = Counter(self.files)
        try:
            self.folder.mkdir(exist_ok=True)
            self._present = set(os.listdir(self.folder))
        except OSError as error:
            raise FileError(f"cannot keep samples in {self.folder}: {reason_of(error, self.folder.parent)}.") from error
        self.done = sum(file.name in self._present for file in self.files)

    def missing(self) -> Iterator[tuple[int, Path]]:
        """The samples that are still to be made and their files; of samples that are the same, the first."""
        seen = set(self._present)
        for sample, file in enumerate(self.files):
            if file.name not in seen:
                seen.add(file.name)
                yield sample, file

    def add(self, file: Path) -> int:
        """Count a file that was made; returns how many samples are done."""
        self.done += self._samples[file]
        return self.done

    def remove(self) -> None:
        """Delete these samples."""
        leftovers = self.folder.glob(".*.tmp.nc")  # of a process that was killed
        for file in (*self._samples, *leftovers):
            file.unlink(missing_ok=True)
        self.leave()

    def leave(self) -> None:
        """Delete the folder if it is empty."""
        with suppress(OSError):
            self.folder.rmdir()


def _digest(folder: Path, name: str) -> str | None:
    """The SHA-256 of the file with this name, None if there is none."""
    try:
        path = place_of(name, folder)
    except FileError:
        return None
    return digest_of(path, str(path)) if os.path.isfile(path) else None


def _identity(tables: Table, digest: Callable[[str], str | None]) -> str:
    """The SHA-256 of all that the image of a scene depends on."""
    files = {name: found for name in _words(tables) if (found := digest(name)) is not None}
    about = [provenance({}, "")["phasemap_version"], CONTENTS, tables, files]
    return hashlib.sha256(json.dumps(about, sort_keys=True, default=str).encode()).hexdigest()


def _words(thing: Any) -> Iterator[str]:
    """Every string in a table, at any depth; each may name a file."""
    if isinstance(thing, str):
        yield thing
    elif isinstance(thing, (dict, list)):
        for inside in thing.values() if isinstance(thing, dict) else thing:
            yield from _words(inside)


def assemble(path: Path, files: Sequence[Path], keys: Sequence[Key], attributes: Table, overwrite: bool) -> None:
    """Write the images of all samples, whose attributes are numbers, into one file, with what is varied in each."""
    import netCDF4

    with replacing(path, overwrite) as temporary, netCDF4.Dataset(temporary, "w", format="NETCDF4") as target:
        form, _, _ = _read(files[0])
        with _open_part(files[0]) as first:
            names = _define(target, first, len(files), keys)
            numbers = {name: np.full(len(files), first.getncattr(name)) for name in first.ncattrs()}
        target.setncatts(attributes)
        for name in ("failed", *(["irregular"] if "motion" in names else [])):
            numbers[name] = np.zeros(len(files), np.int64)
        for sample, file in enumerate(files):
            found, images, about = _read(file)
            _check_form(sample, found, form)
            for name in names:
                target[name][sample] = images[name]
            for name, number in about.items():
                numbers[name][sample] = number
            numbers["failed"][sample] = np.count_nonzero(images["status"])
            if "irregular" in numbers:
                numbers["irregular"][sample] = np.count_nonzero(images["motion"] == 1)
        for name, values in numbers.items():
            made = target.createVariable(name, values.dtype, ("sample",))
            long_name, units = NUMBERS.get(name, (name.replace("_", " "), ""))
            made.setncatts({"long_name": long_name} | ({"units": units} if units else {}))
            made[:] = values


def _open_part(file: Path) -> netCDF4.Dataset:
    """Open a part of an ensemble for reading, with its values not masked or scaled."""
    try:
        source = opened(file)
    except Exception as error:  # as in _read
        raise _damaged(file) from error
    source.set_auto_maskandscale(False)
    return source


def _read(file: Path) -> tuple[Form, dict[str, np.ndarray], Table]:
    """Form, variables and attributes of a part."""
    with _open_part(file) as source:
        try:
            arrays = {name: variable[...] for name, variable in source.variables.items()}
            return _form(source), arrays, {name: source.getncattr(name) for name in source.ncattrs()}
        except Exception as error:  # whatever the library meets in a damaged file
            raise _damaged(file) from error


def _damaged(file: Path) -> PhasemapError:
    """Error for a part that cannot be read."""
    return PhasemapError(f"the sample in {file} is damaged; remove this file and run again.")


def _define(target: netCDF4.Dataset, first: netCDF4.Dataset, count: int, keys: Sequence[Key]) -> list[str]:
    """Lay out the file as its first image has it, with the samples in front; returns the names of what is to be filled.

    A chunk is one image of one sample, for that is what is written and mostly read.
    """
    target.set_auto_maskandscale(False)
    target.createDimension("sample", count)
    for name, dimension in first.dimensions.items():
        target.createDimension(name, len(dimension))
    target.createVariable("sample", np.int64, ("sample",)).setncatts({"long_name": "number of the sample"})
    target["sample"][:] = np.arange(count)
    for name, attributes, values in keys:
        column = as_column(values)
        is_text = column.dtype == object
        made = target.createVariable(name, str if is_text else column.dtype, ("sample",))
        made.setncatts({about: said for about, said in attributes.items() if about != "units" or not is_text})
        made[:] = column
    names = []
    for name, variable in first.variables.items():
        is_axis = name in first.dimensions
        dims = variable.dimensions if is_axis else ("sample", *variable.dimensions)
        layout: Table = {}
        if not is_axis:
            inner = variable.shape[-2:]
            layout = {"zlib": True, "complevel": COMPRESSION_LEVEL, "chunksizes": (1,) * (len(dims) - 2) + inner}
            layout["chunk_cache"] = 1  # byte: a chunk is written once and whole; by default 16 MiB a variable are kept
        about = {key: variable.getncattr(key) for key in variable.ncattrs()}
        made = target.createVariable(name, variable.dtype, dims, fill_value=about.pop("_FillValue", None), **layout)
        made.setncatts(about)
        if is_axis:
            made[:] = variable[...]
        else:
            made.setncattr("coordinates", " ".join(key for key, _, _ in keys))
            names.append(name)
    return names


def as_column(values: list[Any]) -> np.ndarray:
    """Values of a key over the samples: whole numbers, numbers, or text, which is JSON where they are no strings."""
    kinds = {type(value) for value in values}
    if kinds == {int} and all(abs(value) < 2**63 for value in values):
        return np.array(values, np.int64)
    if kinds <= {int, float}:
        return np.array(values, np.float64)
    return np.array([value if isinstance(value, str) else json.dumps(value) for value in values], object)


def _form(image: netCDF4.Dataset) -> Form:
    """Variables with their shapes, and attributes, which the images of all samples must share."""
    return {
        **{name: variable.shape for name, variable in image.variables.items()},
        **dict.fromkeys(image.ncattrs(), ()),
    }


def _check_form(sample: int, form: Form, first: Form) -> None:
    """Refuse an image that does not fit on the first."""
    for name in {**first, **form}:
        if form.get(name) != first.get(name):
            raise InputError(
                f"shape of {name} in sample {sample}", form.get(name), f"{first.get(name)}, as in sample 0"
            )
