"""Maps of a sample: their values, the materials in them, and some of their rows."""

from __future__ import annotations

import copy
from dataclasses import dataclass, field
from typing import Self

import numpy as np
from numpy.typing import NDArray

from phasemap._shared.arrays import Array, IntArray, chunks_of, is_lazy
from phasemap._shared.asked import asked_as
from phasemap._shared.errors import InputError, Word
from phasemap._shared.pixels import centres
from phasemap._shared.units import say
from phasemap.experiment.material_rows import MORE, distinct_materials
from phasemap.experiment.surface_maps import QUANTITIES


@dataclass(frozen=True, init=False, repr=False, eq=False)
class Maps:
    """Read-only maps of one shape, as `phasemap.Surface` describes and makes them."""

    modulus: Array
    adhesion: Array
    damping: Array | None
    viscosity: Array | None
    poisson_ratio: Array
    topography: Array | None
    thickness: Array | None
    relaxed_modulus: Array | None
    relaxation_time: Array | None
    liquid_film: Array | None
    contact_angle: Array | None
    relaxation: Array | None
    pixel_size: tuple[float, float]
    shape: tuple[int, int]
    allow_nan: bool
    _unique: tuple[Array, IntArray] | None = field(init=False)

    def coords(self) -> tuple[Array, Array]:
        """Positions of the pixel centres from the bottom left corner of the image; row 0 is the top.

        Returns
        -------
        y : ndarray, shape (ny,)
            [m], decreasing with the row.
        x : ndarray, shape (nx,)
            [m], increasing with the column.
        """
        y, x = (centres(count, step) for count, step in zip(self.shape, self.pixel_size, strict=True))
        return y[::-1], x

    @property
    def lazy(self) -> bool:
        """True if some map is a Dask array."""
        return any(is_lazy(getattr(self, name)) for name in QUANTITIES)

    @property
    def relaxes(self) -> bool:
        """True if some material has relaxation times."""
        return self.relaxation_time is not None or self.relaxation is not None

    def _refuse_lazy(self) -> None:
        """Refuse an operation that looks at all pixels at once, on maps that are lazy."""
        if self.lazy:
            raise InputError("surface", Word("in Dask arrays"), "maps in memory", "Take surface.compute().")

    def unique(self) -> tuple[Array, IntArray]:
        """Find the distinct materials, so that each is solved once.

        Returns
        -------
        rows : ndarray, shape (n, 4) or (n, 10)
            Modulus [Pa], adhesion [J/m2], damping [1] or viscosity [Pa s], whichever there is, Poisson's ratio [1]; and
            if there is one of them, thickness [m], relaxed modulus [Pa], relaxation time [s], liquid film [m],
            contact angle [degree] and key of a spectrum, infinite where a material has none.
        inverse : ndarray of int32, shape (ny, nx)
            Which row each pixel has: ``rows[inverse, 0]`` is the modulus map, bit for bit. Both are computed once and
            read-only.
        """
        self._refuse_lazy()
        distinct = self._unique
        if distinct is None:
            distinct = distinct_materials(self.columns)
            object.__setattr__(self, "_unique", distinct)
        return distinct

    @property
    def found(self) -> tuple[Array, IntArray] | None:
        """Distinct materials as `unique` gives them, if they are known already, else None."""
        return self._unique

    def materials(self, pixels: slice | NDArray[np.intp]) -> Array:
        """Rows as `unique` gives them, of some pixels.

        Parameters
        ----------
        pixels : slice or ndarray of int
            In the order of the rows of the image, ``row * nx + column``.
        """
        self._refuse_lazy()
        return np.column_stack([column.reshape(-1)[pixels] for column in self.columns])

    @property
    def columns(self) -> list[Array]:
        """The maps that make up a material."""
        loss = self.viscosity if self.damping is None else self.damping
        assert loss is not None
        columns, more = [self.modulus, self.adhesion, loss, self.poisson_ratio], [getattr(self, name) for name in MORE]
        if all(one is None for one in more):
            return columns
        none = {"relaxed_modulus": self.modulus}
        endless = np.broadcast_to(np.inf, self.shape)
        return columns + [none.get(name, endless) if one is None else one for name, one in zip(MORE, more, strict=True)]

    @asked_as()
    def rows(self, rows: slice) -> Self:
        """Some rows of the sample, as a surface that shares its maps.

        Parameters
        ----------
        rows : slice
            At least one row.

        Returns
        -------
        Surface
            It remembers what `unique` found here; some of these materials may be in no pixel of it.
        """
        part = copy.copy(self)
        for name in QUANTITIES:
            if (value := getattr(self, name)) is not None:
                object.__setattr__(part, name, value[rows])
        object.__setattr__(part, "shape", part.modulus.shape)
        if self._unique is not None:
            object.__setattr__(part, "_unique", (self._unique[0], self._unique[1][rows]))
        return part

    def __eq__(self, other: object) -> bool:
        """True if both have the same values everywhere; NaN equals NaN."""
        if not isinstance(other, Maps):
            return NotImplemented
        if (self.shape, self.pixel_size) != (other.shape, other.pixel_size):
            return False
        for name in QUANTITIES:
            a, b = getattr(self, name), getattr(other, name)
            if (a is None) != (b is None) or (a is not None and not np.array_equal(a, b, equal_nan=True)):
                return False
        return True

    def __repr__(self) -> str:
        """Say the size of the map and the range of each quantity."""
        rows, columns = self.shape
        tall, wide = (say(side, "m") for side in self.pixel_size)
        parts = [f"{rows} x {columns} pixels of {tall if tall == wide else f'{tall} x {wide}'}"]
        for name in QUANTITIES:
            value = getattr(self, name) if name not in ("poisson_ratio", "relaxation") else None
            if is_lazy(value):
                blocks = chunks_of(value)
                parts.append(f"{name} in Dask blocks of {blocks[0][0]} x {blocks[1][0]} pixels")
            elif value is not None:
                ends = [say(float(end.reduce(value, None)), QUANTITIES[name].unit) for end in (np.fmin, np.fmax)]
                parts.append(f"{name} {' to '.join(dict.fromkeys(ends))}")
        return f"Surface({', '.join(parts)})"
