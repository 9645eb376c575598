"""The file of an ensemble: a small file a sample while they are made, one netCDF file in the end, and a data card."""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from phasemap._shared.errors import FileError, InputError, PhasemapError
from phasemap._shared.files import digest_of, reason_of
from phasemap._shared.units import UDUNITS, WRITTEN, say
from phasemap.io.netcdf import COMPRESSION_LEVEL, opened
from phasemap.io.whole_files import replacing
from phasemap.results.variables import provenance
from phasemap.scenes.samples import Choice, Law, Range, laws_of, unit_of
from phasemap.scenes.scene import Scene

if TYPE_CHECKING:
    import netCDF4

NUMBERS = {  # long name and units, of what is a number a sample
    "failed": ("pixels without a solution", "1"),
    "irregular": ("pixels with irregular motion", "1"),
    "distinct_materials": ("materials that were solved for", "1"),
    "adhesion_force": ("largest adhesion between tip and sample", "N"),
    "lever_force": ("stiffness times free amplitude", "N"),
}

CONTENTS = "image and truth"  # of a part; one with other contents is not taken for it

Table = dict[str, Any]
Form = dict[str, tuple[int, ...]]
Key = tuple[str, Mapping[str, str], list[Any]]  # the name of a variable, its attributes, a value a sample


class Parts:
    """The folder ``OUT.nc.parts`` with one netCDF file for each sample that is done.

    The name of a file is the SHA-256 of all that its image depends on: the sample's scene, the files that the scene
    names, relative to `folder`, and the version of phasemap. So an image of another scene is never taken for it, and a
    sample that was done is not done again after others were changed or added.
    """

    def __init__(self, output: Path, scenes: Iterable[Table], folder: Path) -> None:
        self.folder = output.with_name(f"{output.name}.parts")
        digests, release = _Digests(folder), provenance({}, "")["phasemap_version"]
        self.files = [self.folder / f"{_identity(tables, digests, release)}.nc" for tables in scenes]
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


class _Digests:
    """The SHA-256 of files, each read once."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._known: dict[str, str | None] = {}

    def of(self, name: str) -> str | None:
        """Of the file with this name, None if there is none."""
        if name not in self._known:
            path = os.path.join(self._folder, name)
            self._known[name] = digest_of(path, path) if os.path.isfile(path) else None
        return self._known[name]


def _identity(tables: Table, digests: _Digests, release: str) -> str:
    """The SHA-256 of all that the image of a scene depends on."""
    files = {name: digest for name in _words(tables) if (digest := digests.of(name)) is not None}
    return hashlib.sha256(
        json.dumps([release, CONTENTS, tables, files], sort_keys=True, default=str).encode()
    ).hexdigest()


def _words(thing: Any) -> Iterator[str]:
    """Every string in a table, for any of them may name a file."""
    if isinstance(thing, str):
        yield thing
    elif isinstance(thing, (dict, list)):
        for inside in thing.values() if isinstance(thing, dict) else thing:
            yield from _words(inside)


def assemble(path: Path, files: Sequence[Path], keys: Sequence[Key], attributes: Table, overwrite: bool) -> None:
    """Write the images of all samples, whose attributes are numbers, into one file, one after the other.

    `keys`: what is varied: name of the variable, its attributes, and a value for each sample.
    """
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
    """What the images of all samples must share: variables, and attributes, which are numbers."""
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


Tables = Mapping[str, Any]

LONGEST = 60  # letters of a value that are shown
NOT_CHOSEN = (
    "Not chosen: `licence` under `[ensemble]` in the scene names one. phasemap claims nothing of what it computes; the "
    "images are of whoever made them, and maps that the scene reads from files of whoever made these."
)


def card_beside(path: Path) -> Path:
    """Where the card of a file lies."""
    return path.with_name(f"{path.name}.card.md")


def data_card(path: Path, ds: xr.Dataset, tables: Tables, samples: Sequence[Tables], first: Scene) -> str:
    """Describe the images of an ensemble in Markdown: its scene, [ensemble] included, and the varied values."""
    ensemble = tables["ensemble"]
    (ny, nx), (dy, dx) = first.surface.shape, first.surface.pixel_size
    source = f"`{ensemble['table']}`" if "table" in ensemble else f"drawn with the seed {ensemble.get('seed', 0)}"
    lines = [
        f"# {path.name}", "",
        f"{len(samples)} synthetic phase images of tapping-mode AFM with the truth behind each: {nx} x {ny} pixels, "
        f"{nx * dx * 1e9:.4g} x {ny * dy * 1e9:.4g} nm, made by phasemap {ds.attrs['phasemap_version']}. What differs "
        f"between them is {source}. The same scene, seed and version give the same numbers; the scene is JSON in the "
        "attribute `scene`.", "",
        "## What is in it", "",
        "Row 0 is the top of the image; pixels without a solution are NaN, and `status` says why.", "",
        "| variable | over | unit | what |", "|---|---|---|---|", *_variables(ds), "",
        "## What differs", "", "| key | from | drawn |", "|---|---|---|", *_varied(ensemble, samples), "",
        "## What is the same in all", "", *_fixed(tables, samples[0]), "",
        "## Known limits", "", *(f"* {one}" for one in _limits(ds, samples[0], first)), "",
        "## Licence", "", str(ensemble.get("licence", NOT_CHOSEN)),
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


def _variables(ds: xr.Dataset) -> Iterator[str]:
    """A row for each variable and each coordinate that is no axis."""
    for name, one in ds.variables.items():
        if name in ds.dims:
            continue
        what = str(one.attrs.get("long_name", ""))
        if one.attrs.get("flag_meanings"):
            codes = (int(code) for code in _list_of(one.attrs.get("flag_values", one.attrs.get("flag_masks"))))
            meanings = str(one.attrs["flag_meanings"]).split()
            what += ": " + ", ".join(f"{code} {word}" for code, word in zip(codes, meanings, strict=False))
        unit = WRITTEN.get(one.attrs.get("units", ""), one.attrs.get("units", ""))
        yield f"| `{name}` | {', '.join(map(str, one.dims))} | {unit} | {what} |"


def _list_of(values: Any) -> list[Any]:
    """Codes of flags; a single one comes back from a file as a number."""
    return list(np.atleast_1d(values))


def _varied(ensemble: Tables, samples: Sequence[Tables]) -> Iterator[str]:
    """A row for each key that is varied: what it was drawn from, and which values came out."""
    laws: dict[str, Law] = dict(laws_of(ensemble["vary"])) if "vary" in ensemble else {}
    for key in samples[0]:
        values = [sample[key] for sample in samples]
        numbers = all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in values)
        drawn = _interval(key, min(values), max(values)) if numbers else f"{len(set(map(str, values)))} values"
        yield f"| `{key}` | {_said(key, laws.get(key))} | {drawn} |"


def _said(key: str, law: Law | None) -> str:
    """What a key is drawn from."""
    if isinstance(law, Range):
        how = "whole numbers" if law.whole else "logarithm uniform" if law.scale == "log" else "uniform"
        return f"{_interval(key, law.low, law.high)}, {how}"
    if isinstance(law, Choice):
        return _short(", ".join(map(str, law.options)))
    return "the table"


def _interval(key: str, low: float, high: float) -> str:
    units = UDUNITS.get(unit_of(key), unit_of(key)) or "1"
    if units == "1" or not all(map(math.isfinite, (low, high))):
        return f"{low:.6g} to {high:.6g}"
    return f"{say(low, units)} to {say(high, units)}"


def _fixed(tables: Tables, varied: Tables, prefix: str = "") -> Iterator[str]:
    """A line for each key of the scene that no sample has of its own."""
    for name, value in tables.items():
        key = f"{prefix}{name}"
        if key in varied or (not prefix and name in ("ensemble", "output")):
            continue
        if isinstance(value, Mapping):
            yield from _fixed(value, varied, f"{key}.")
        else:
            yield f"    {key} = {_short(repr(value))}"


def _short(text: str) -> str:
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 2]} …"


def _limits(ds: xr.Dataset, varied: Tables, first: Scene) -> Iterator[str]:
    """What must not be taken for more than it is."""
    failed, pixels = int(ds["failed"].sum()), ds["status"].size
    yield f"Simulated, not measured. {failed} of {pixels} pixels have no solution."
    if "irregular" in ds and (irregular := int(ds["irregular"].sum())):
        yield f"{irregular} pixels show the mean of motion that is not periodic (`motion`)."
    control, realism = first.options["control"], first.options["realism"]
    if not control.in_time:
        yield "The feedback is perfect and at rest at every pixel: no lag, no amplitude error, no noise in time."
    elif realism.temperature is None and realism.detector_noise is None:
        yield "Scanned in time, without noise of lever or detector."
    if realism != type(realism)() and "realism.seed" not in varied:
        yield "The noise is the same in all images: `realism.seed` is not varied."
    if any(key.startswith("surface.") for key in varied):
        yield "No part is set aside for tests: samples with the same surface belong into one part."
    else:
        yield "All images are of the same surface: nothing learnt from them is known to hold on another."
    yield "Lever, tip and contact law are exact, and there is no tilt, bow or creep; see the page on limits."
