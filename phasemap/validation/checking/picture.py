"""An image as it was before offsets of lines and quantisation, in arrays of one shape."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from phasemap._kernels import columns as col
from phasemap._shared.arrays import Array
from phasemap.experiment.realism import DIGITISED
from phasemap.imaging.imperfections import finish
from phasemap.results.variables import FLAGS, FLOATS
from phasemap.validation.checking.claims import Claims

# Three standard errors of a mean over a hundred times that the lock-in remembers, in standard deviations behind it.
MEAN = 0.3


@dataclass(frozen=True, eq=False)
class Picture:
    """The variables of an image, each of shape (directions, ny, nx) also where there is one direction only."""

    image: xr.Dataset  # of the dims and shape that `claims` has
    claims: Claims

    @property
    def shape(self) -> tuple[int, int, int]:
        """Directions, rows and columns."""
        return (max(len(self.claims.control.directions), 1), *self.claims.shape)

    def __contains__(self, name: str) -> bool:
        """Whether the image has this variable."""
        return name in self.image.data_vars

    def has(self, *names: str) -> bool:
        """Whether the image has all of these."""
        return all(name in self for name in names)

    def raw(self, name: str) -> NDArray[Any]:
        """The values in the file."""
        values: NDArray[Any] = self.image[name].values.reshape(self.shape)
        return values

    def __getitem__(self, name: str) -> Array:
        """The values less the random offsets of lines, which the seed gives again."""
        values = self.raw(name)
        return np.asarray(values - self._offsets[name] if name in self._offsets else values)

    @cached_property
    def _offsets(self) -> dict[str, Array]:
        """Offsets of lines, by name of the variable."""
        realism = replace(self.claims.realism, bits=None)
        flat = {name: xr.zeros_like(self.image[name]) for name in ("height", "phase") if name in self}
        added = finish(xr.Dataset(flat), realism)
        return {name: added[name].values.reshape(self.shape) for name in flat if "comment" in added[name].attrs}

    def coarse(self, name: str) -> float:
        """Half the step of the quantisation, in the variable's unit; 0 without one, or without the variable."""
        bits = self.claims.realism.bits
        if bits is None or name not in DIGITISED or name not in self:
            return 0.0
        values = self.raw(name)
        known = values[np.isfinite(values.astype(np.float64))].astype(np.float64)
        return 0.5 * float(np.ptp(known)) / (2**bits - 1) if known.size else 0.0

    @cached_property
    def good(self) -> NDArray[np.bool_]:
        """Where the status is good."""
        return np.asarray(self.raw("status") == col.GOOD)

    @cached_property
    def solved(self) -> NDArray[np.bool_]:
        """Where there should be numbers: good pixels, and those of a scanner at the end of its range."""
        kept = [col.GOOD, col.OUT_OF_RANGE] if self.claims.control.in_time else [col.GOOD]
        return np.isin(self.raw("status"), kept)

    @cached_property
    def irregular(self) -> NDArray[np.bool_]:
        """Where the image says that the motion is not periodic: phase and amplitude are means there."""
        return np.asarray(self.raw("motion") == 1) if "motion" in self else np.zeros(self.shape, bool)

    def spread(self, name: str) -> Array:
        """Standard deviation behind the lock-in that the image states [degree or m], 0 where it states none."""
        stated = f"{name}_spread"
        return np.asarray(np.nan_to_num(self.raw(stated))) if stated in self else np.zeros(self.shape)

    def unknown_phase(self) -> Array:
        """By how much the phase may be off [rad]: what the image states, and its quantisation; 0 where not stated."""
        stated = np.nan_to_num(self["error_phase"]) if "error_phase" in self else np.zeros(self.shape)
        interpolated = self.raw("solver") == col.INTERPOLATED if "solver" in self else np.zeros(self.shape, bool)
        # The interpolant of energies is asked for what this error of the phase does to them
        # (`imaging.tolerances.tolerances_of`).
        stated = np.where(interpolated, np.maximum(stated, self.claims.accuracy.phase), stated)
        return np.asarray(np.radians(stated + self.coarse("phase")))

    def floats(self) -> list[str]:
        """Names of the float variables, in the order of the image."""
        return [str(name) for name in self.image.data_vars if name in FLOATS and name not in FLAGS]

    def places(self, places: Sequence[tuple[int, int, int]]) -> str:
        """Say where pixels are."""
        names = self.claims.control.directions
        return "; ".join(f"row {y}, column {x}" + (f" ({names[d]})" if names else "") for d, y, x in places)
