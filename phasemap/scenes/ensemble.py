"""Ensembles: a scene in many variants, simulated into one file with the truth behind each image.

docs/howto/ensembles.md says what its table ``[ensemble]`` holds.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from phasemap._shared.asked import asked_as
from phasemap._shared.checks import check_choice, whole
from phasemap._shared.errors import FileError, InputError, InputErrors
from phasemap._shared.notices import once, untold
from phasemap._shared.processes import in_processes
from phasemap._shared.units import UDUNITS
from phasemap.io.netcdf import check_dataset, save
from phasemap.results.variables import provenance
from phasemap.scenes.ensemble_file import PartsFolder, assemble
from phasemap.scenes.samples import check_overrides, make_samples, unit_of
from phasemap.scenes.scene import TABLES, Scene, scene_from_tables
from phasemap.scenes.tables import Complaints, missing, read_tables, with_value

Table = dict[str, Any]
ImageForm = tuple[tuple[int, int], tuple[float, float]]  # shape and pixel size of an image


@dataclass(frozen=True, repr=False)
class Ensemble:
    """A scene, and the keys of it that each sample has values of its own for.

    Parameters
    ----------
    tables : mapping
        The tables of the scene, as its file has them, ``[ensemble]`` included.
    samples : tuple of dict
        The values of the varied keys, ``{"scan.setpoint": 0.7, ...}``, of each sample.
    folder : Path
        Where relative file names start.
    """

    tables: Mapping[str, Any]
    samples: tuple[Mapping[str, Any], ...]
    folder: Path

    def __len__(self) -> int:
        return len(self.samples)

    def __repr__(self) -> str:
        """Say how many scenes there are, and what is varied."""
        return f"Ensemble({len(self)} samples, varied: {', '.join(self.keys)})"

    @property
    def keys(self) -> tuple[str, ...]:
        """The keys that are varied."""
        return tuple(self.samples[0])

    @property
    def output(self) -> Path | None:
        """The file that ``[output]`` names."""
        file = self.tables.get("output", {}).get("file")
        return self.folder / file if file else None

    def scene(self, sample: int) -> Scene:
        """Make the scene of one sample, which gives its image by itself too.

        Parameters
        ----------
        sample : int
            From 0.
        """
        whole("sample", sample, 0, len(self) - 1)
        with _naming_sample(sample):
            return scene_from_tables(self._tables(sample), self.folder)

    @once()
    def check(self, every_surface: bool = True) -> None:
        """Check the scenes of all samples.

        Parameters
        ----------
        every_surface : bool
            Make the surface of every sample, and not only of the first. Where surfaces are generated or read, that may
            take as long as to simulate their images.
        """
        first = self.scene(0)
        same_surface = not any(key.startswith("surface.") for key in self.keys) or not every_surface
        for sample in range(1, len(self)):
            with _naming_sample(sample):
                made = scene_from_tables(self._tables(sample), self.folder, first.surface if same_surface else None)
                _check_form(made, _form(first))

    def simulate(
        self,
        path: str | os.PathLike[str],
        *,
        workers: int = 1,
        overwrite: bool = False,
        progress: Callable[[int, int], None] | None = None,
    ) -> Path:
        """Simulate all samples into one file, and go on where an earlier call was stopped.

        Samples that are done are kept in the folder ``PATH.parts`` until all are.

        Parameters
        ----------
        path : path-like
            The file to write, netCDF.
        workers : int
            How many processes, each with one thread. The bytes of the file do not depend on it. A script must call
            this under ``if __name__ == "__main__"`` for more than one.
        overwrite : bool
            Whether an existing file may be replaced.
        progress : callable, optional
            Called as ``progress(done, total)``, in samples: at first with what was done already.

        Returns
        -------
        Path
            The file: the image variables of `phasemap.simulate` with a dimension ``sample`` in front; so too what is
            under the tip, as `Scene.truth` has it, ``label`` and the maps of properties; over the samples, the varied
            keys as coordinates, how many pixels ``failed`` and how many have ``irregular`` motion, and the numbers
            among the attributes of single images; and the scene as JSON.

        Raises
        ------
        InputError, FileError
            If a sample cannot be simulated, with its number, or the images of two samples differ in size; those that
            are done are kept. If the file is there, and `overwrite` is False.
        """
        path = check_dataset(path, overwrite)
        whole("workers", workers, 1)
        first = self.scene(0)
        parts = PartsFolder(path, (self._tables(sample) for sample in range(len(self))), self.folder)
        try:
            if progress is not None:
                progress(parts.done, len(self))
            jobs = ((sample, self._tables(sample), file) for sample, file in parts.missing())
            named = not any(key.startswith("surface.materials") for key in self.keys)  # the same in all samples
            make = partial(_make, folder=self.folder, form=_form(first), named=named)
            with closing(in_processes(make, jobs, workers)) as made:
                for file in made:
                    done = parts.add(file)
                    if progress is not None:
                        progress(done, len(self))
            columns = [(name_of(key), _attributes_of(key), [one[key] for one in self.samples]) for key in self.keys]
            assemble(path, parts.files, columns, self._attributes(), overwrite)
            parts.remove()
        finally:
            parts.leave()
        return path

    def _tables(self, sample: int) -> Table:
        """The tables of the scene of one sample."""
        tables = {name: table for name, table in self.tables.items() if name != "ensemble"}
        for key, value in sorted(self.samples[sample].items(), key=lambda one: not one[0].endswith(".preset")):
            tables = with_value(tables, key, value)
        return tables

    def _attributes(self) -> dict[str, Any]:
        """Global attributes of the file: no time is among them, for the same ensemble gives the same bytes."""
        about = provenance({}, "")
        return {
            **{name: about[name] for name in ("Conventions", "source", "phasemap_version")},
            "scene": json.dumps(self.tables, ensure_ascii=False, default=str),
            **({"license": licence} if (licence := self.tables["ensemble"].get("licence")) else {}),
        }


def is_ensemble(path: str | os.PathLike[str], overrides: Iterable[str] = ()) -> bool:
    """True if a scene file has a table ``[ensemble]``."""
    return "ensemble" in read_tables(path, overrides)


@asked_as()
def load_ensemble(path: str | os.PathLike[str], overrides: Iterable[str] = ()) -> Ensemble:
    """Read a scene file with a table ``[ensemble]``, and draw or read the values of its samples.

    The scenes of all samples are checked; of their surfaces that of the first only, see `Ensemble.check`.

    The values of a sample depend on the seed, the key and the number of the sample only: neither on how many samples
    there are, nor on what else is varied.

    Parameters
    ----------
    path : path-like
        A TOML file.
    overrides : iterable of str
        ``"table.key=value"``, as in `phasemap.load_scene`; ``"ensemble.count=1000"`` too.

    Examples
    --------
    >>> few = load_ensemble("samples/ensemble.toml", ["ensemble.count=2"])
    >>> many = load_ensemble("samples/ensemble.toml", ["ensemble.count=9"])
    >>> few.samples == many.samples[:2]
    True
    """
    overrides, folder = list(overrides), Path(path).parent
    tables = read_tables(path, overrides)
    if "ensemble" not in tables:
        raise missing("[ensemble]", "count")
    samples = make_samples(tables["ensemble"], folder)
    for key in samples[0]:
        _check_key(key, tables)
    check_overrides(overrides, samples)
    names = [name_of(key) for key in samples[0]]
    if len(set(names)) < len(names):
        raise InputError("names of variables", ", ".join(names), "another one for each key")
    ensemble = Ensemble(tables, samples, folder)
    ensemble.check(every_surface=False)
    return ensemble


def name_of(key: str) -> str:
    """The name of the variable that holds a key: the key, without characters that file formats refuse."""
    return re.sub(r"[^\w.]", "_", key)


def _attributes_of(key: str) -> dict[str, str]:
    """Attributes of the variable that holds the values of a key."""
    from phasemap.solvers.continuation.path import UNITS

    *tables, name = key.split(".")
    about = {"long_name": " ".join([*tables, name]).replace("_", " "), "key": key}
    unit = unit_of(key)
    units = UDUNITS.get(unit, unit) or (UNITS.get(name) if tables[0] != "surface" else None)
    return about if units is None else {**about, "units": units}


def _check_key(key: str, tables: Table) -> None:
    """Refuse a key of no table, or of a material that the scene does not have: a new one would have no effect."""
    table, *rest = key.split(".")
    if not rest or not all(rest):
        raise InputError("key of [ensemble]", key, "table.key, such as scan.setpoint")
    check_choice(f"the table of {key}", table, [known for known in TABLES if known != "output"])
    materials = tables.get("materials")
    if table == "materials" and isinstance(materials, dict):
        check_choice(f"the material of {key}", rest[0], materials)


def _form(scene: Scene) -> ImageForm:
    """Shape and pixel size, which the images of all samples must share."""
    return scene.surface.shape, scene.surface.pixel_size


def _check_form(scene: Scene, first: ImageForm) -> None:
    """Refuse an image that does not fit on that of the first sample."""
    for name, value, same in zip(("number of pixels", "pixel size"), _form(scene), first, strict=True):
        if value != same:
            raise InputError(name, value, f"{same}, as in sample 0")


@contextmanager
def _naming_sample(sample: int) -> Iterator[None]:
    """Name the sample in errors that are raised within."""
    try:
        yield
    except (InputError, FileError) as error:
        complaints = Complaints()
        for part in error.errors if isinstance(error, InputErrors) else (error,):
            if isinstance(part, InputError):
                complaints.add(InputError(f"{part.name} of sample {sample}", part.value, part.allowed, part.hint))
            else:
                complaints.add(FileError(f"sample {sample}: {part}"))
        complaints.make()


def _make(job: tuple[int, Table, Path], folder: Path, form: ImageForm, named: bool) -> Path:
    """Simulate a sample into its file, with the numbers among its attributes, but for the time it took."""
    sample, tables, file = job
    with _naming_sample(sample):
        scene = scene_from_tables(tables, folder)
        _check_form(scene, form)
        with untold():  # status is in the file, and counted when all are done
            image = scene.simulate(threads=1)
    truth = scene.truth()
    if "label" in truth and not named:  # what a label means is among what is varied
        del truth.label.attrs["flag_values"], truth.label.attrs["flag_meanings"]
    image = image.assign(truth.drop_vars(["y", "x"]).data_vars)
    image.attrs = {
        name: value for name, value in image.attrs.items() if isinstance(value, (int, float)) and name != "seconds"
    }
    return save(image, file, overwrite=True)
