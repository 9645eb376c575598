"""Files that the ``[surface]`` table of a scene names: where they are, what was in them, and the arrays they hold."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from phasemap._shared.errors import FileError, InputError, PhasemapError
from phasemap._shared.files import digest_of, size_of
from phasemap._shared.memory import check_fits
from phasemap.io.netcdf import load

TEXT = 8  # byte of memory at most for a byte of text: "0," becomes a float64, and lists grow by doubling
SUFFIXES = (".npy", ".csv", ".txt", ".nc")  # of files with a map


class Files:
    """Finds the files that a scene names, and remembers what was in them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.digests: dict[str, str] = {}

    def find(self, key: str, name: object) -> Path:
        """The path of a file that the scene names under `key`."""
        if not isinstance(name, str) or not name:
            raise InputError(f"[surface] {key}", name, "a file name")
        path = self.folder / name
        if name.startswith("package:"):
            package, _, inside = name.removeprefix("package:").partition("/")
            spec = _installed(package)
            if spec is None or not spec.submodule_search_locations:
                raise FileError(f"cannot read {name}: the package {package!r} is not installed.")
            path = Path(spec.submodule_search_locations[0], inside)
        what = f"{path}, named in [surface] {key}"
        check_fits(what, size_of(path, what), "Take a smaller map.")
        self.digests[name] = digest_of(path, what)
        return path


def _installed(package: str) -> ModuleSpec | None:
    """Where an installed package lies; it is not imported."""
    try:
        return find_spec(package) if package.isidentifier() else None
    except ValueError:  # __main__, say, was not found as others are
        return None


def read_array(key: str, path: Path, variable: object) -> np.ndarray:
    """The array in a .npy, .csv, .txt or netCDF file."""
    readers: dict[str, Callable[[], np.ndarray]] = {
        ".npy": lambda: _read_npy(path),
        ".csv": lambda: np.loadtxt(path, delimiter=",", ndmin=2),
        ".txt": lambda: np.loadtxt(path, ndmin=2),
        ".nc": lambda: _read_variable(path, variable),
    }
    suffix = path.suffix.lower()
    if suffix in (".csv", ".txt"):
        check_fits(f"{path}, named in [surface] {key},", TEXT * path.stat().st_size, "Take a smaller map.")
    if suffix not in readers:
        raise InputError(f"[surface] {key}", path.name, "a file that ends in " + ", ".join(readers))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", UserWarning)  # loadtxt only warns of a file without numbers
            return readers[suffix]()
    except PhasemapError:
        raise
    except Exception as error:  # numpy passes on what its parsers raise where a file is damaged
        reason = (str(error) or type(error).__name__).splitlines()[0].rstrip(".")
        raise FileError(f"cannot read {path}, named in [surface] {key}: {reason}.") from error


def _read_npy(path: Path) -> np.ndarray:
    """The array in a .npy file, not an archive, which `numpy.load` reads too and which may unpack to gigabytes."""
    values = np.load(path, allow_pickle=False)  # takes no memory for what is declared and not there
    if not isinstance(values, np.ndarray):
        values.close()
        raise ValueError("it is an archive, not an array")
    return values


def _read_variable(path: Path, variable: object) -> np.ndarray:
    """One variable of a netCDF file."""
    dataset = load(path)
    if variable not in list(dataset.data_vars):
        held = ", ".join(map(repr, dataset.data_vars))
        raise FileError(f"cannot use {path}: there is no variable {variable!r}; it holds {held}.")
    values: np.ndarray = dataset[str(variable)].values
    return values
