"""Makes ``xarray.open_dataset(file, engine="phasemap")`` work."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from typing import Any, ClassVar

import xarray as xr
from xarray.backends import BackendEntrypoint

from phasemap.io.read import read_image

SUFFIXES = (".nid", ".spm", ".di", ".ibw", ".jpk", ".gwy", ".gsf")  # .tiff, .stp and .top are of others too
NUMBERED = re.compile(r"\.\d{3}$")  # as NanoScope numbers its images


class PhasemapBackend(BackendEntrypoint):
    """Opens microscopes' files, as `phasemap.read_image` does."""

    description: ClassVar[str] = "Images of atomic force microscopes (NanoScope, .nid, .ibw, JPK, .gwy, .gsf, ...)"
    open_dataset_parameters: ClassVar[tuple[str, ...]] = (
        "filename_or_obj", "drop_variables", "height", "phase", "amplitude",
    )  # fmt: skip

    def open_dataset(
        self, filename_or_obj: Any, *, drop_variables: str | Iterable[str] | None = None, height: str | None = None,
        phase: str | None = None, amplitude: str | None = None,
    ) -> xr.Dataset:  # fmt: skip
        """Read an image into memory, with the channels of `phasemap.read_image`, without the variables to drop."""
        ds = read_image(filename_or_obj, height=height, phase=phase, amplitude=amplitude)
        dropped = [drop_variables] if isinstance(drop_variables, str) else list(drop_variables or [])
        return ds.drop_vars(dropped, errors="ignore")

    def guess_can_open(self, filename_or_obj: Any) -> bool:
        """True if the file's name ends as a microscope's does; other files need ``engine="phasemap"``."""
        if not isinstance(filename_or_obj, str | os.PathLike):
            return False
        name = os.fspath(filename_or_obj).lower()
        return str(name).endswith(SUFFIXES) or bool(NUMBERED.search(str(name)))
