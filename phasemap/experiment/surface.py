"""What lies under the tip: maps of material properties and topography on a grid of pixels.

Row 0 is the top of the image and y increases with the row index; everything is SI.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasemap._shared.checks import in_words, number, pixel_pair, shape_pair
from phasemap._shared.dask_arrays import chunks_of, is_lazy, lazy_map
from phasemap._shared.errors import InputError, Word
from phasemap._shared.memory import check_fits
from phasemap._shared.plausible import question, unquestioned
from phasemap._shared.quantities import NotThatUnit, Scalar, array_in_si, with_unit
from phasemap._shared.shown import table
from phasemap._shared.units import say
from phasemap.experiment.material import Material
from phasemap.experiment.surface_variables import QUANTITIES, Quantity, centres, coordinate_step, variable_in_si

if TYPE_CHECKING:
    import xarray as xr

    from phasemap.experiment.microscope import Microscope, Tip

__all__ = ["Surface"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]


LARGEST = 2.0**53  # up to which floats tell all whole numbers apart
PIXEL = (0.01e-9, 10e-6)  # m, of the pixels that anybody takes
_NO_BOUNDS = (("minimum", -math.inf), ("above", -math.inf), ("maximum", math.inf))


@dataclass(frozen=True, init=False, repr=False, eq=False)
class Surface:
    """A sample: material maps and topography on a grid of pixels.

    Every quantity is one number or a 2-D map, and all maps have one shape. They are in SI units, text with a unit,
    quantities of pint, or a DataArray whose attribute ``units`` says theirs. The fields are read-only float64 arrays of
    that shape; what is the same everywhere takes the memory of one number. A map that can still be written to is
    copied once, a read-only one (``a.setflags(write=False)``) is shared. A map may be a Dask array: it stays one, and
    `phasemap.simulate` then makes an image of Dask arrays, block by block; its numbers are checked when they are used.

    Parameters
    ----------
    modulus : float or array_like, shape (ny, nx)
        Young's modulus E [Pa], >= 0.
    adhesion : float or array_like, shape (ny, nx)
        Work of adhesion w [J/m2] between tip and surface, >= 0.
    damping : float or array_like, shape (ny, nx), optional
        Damping coefficient alpha1 [1], >= 0; 0 if neither `damping` nor `viscosity` is given.
    viscosity : float or array_like, shape (ny, nx), optional
        Kelvin-Voigt viscosity eta [Pa s], >= 0, in place of `damping`.
    poisson_ratio : float or array_like, shape (ny, nx)
        Poisson's ratio [1], above -1 and at most 0.5.
    topography : float or array_like, shape (ny, nx), optional
        Height of the undeformed surface [m]; None is flat.
    thickness : float or array_like, shape (ny, nx), optional
        Of a film on a rigid base [m], > 0, for the contact "film"; infinite where the material has no bottom.
    relaxed_modulus, relaxation_time : float or array_like, shape (ny, nx), optional
        [Pa, s] of materials that relax, as of `Material`; the time is infinite where one does not.
    pixel_size : float or (float, float)
        Side of a square pixel [m], or its (dy, dx); kept as (dy, dx).
    shape : (int, int), optional
        (ny, nx), needed only where no map is given.
    allow_nan : bool
        Keep NaN in material maps as pixels without a material, which stay NaN in the image, instead of raising.

    Raises
    ------
    InputError
        If a value is out of range (it says where), maps differ in shape, or both `damping` and `viscosity` are given.

    Examples
    --------
    >>> surface = Surface(modulus=[[1e9, 3e9], [3e9, 3e9]], adhesion=0.05, damping=0.01, pixel_size=4e-9)
    >>> surface
    Surface(2 x 2 pixels of 4 nm, modulus 1 GPa to 3 GPa, adhesion 0.05 J/m², damping 0.01)
    >>> float(surface.adhesion[1, 0]), surface.pixel_size
    (0.05, (4e-09, 4e-09))

    `dataclasses.replace` changes one thing:

    >>> from dataclasses import replace
    >>> replace(surface, viscosity=20.0, damping=None).viscosity.shape
    (2, 2)
    """

    modulus: FloatArray
    adhesion: FloatArray
    damping: FloatArray | None
    viscosity: FloatArray | None
    poisson_ratio: FloatArray
    topography: FloatArray | None
    thickness: FloatArray | None
    relaxed_modulus: FloatArray | None
    relaxation_time: FloatArray | None
    pixel_size: tuple[float, float]
    shape: tuple[int, int]
    allow_nan: bool
    _unique: tuple[FloatArray, IntArray] | None = field(init=False)

    def __init__(
        self,
        modulus: ArrayLike,
        adhesion: ArrayLike = 0.0,
        damping: ArrayLike | None = None,
        viscosity: ArrayLike | None = None,
        poisson_ratio: ArrayLike = 0.35,
        topography: ArrayLike | None = None,
        thickness: ArrayLike | None = None,
        relaxed_modulus: ArrayLike | None = None,
        relaxation_time: ArrayLike | None = None,
        *,
        pixel_size: float | Sequence[float],
        shape: Sequence[int] | None = None,
        allow_nan: bool = False,
    ) -> None:
        if not isinstance(allow_nan, (bool, np.bool_)):
            raise InputError("allow_nan", allow_nan, "True or False")
        if damping is None and viscosity is None:
            damping = 0.0
        elif damping is not None and viscosity is not None:
            raise InputError("viscosity", "given beside damping", "damping or viscosity, not both")
        given = {
            "modulus": modulus,
            "adhesion": adhesion,
            "damping": damping,
            "viscosity": viscosity,
            "poisson_ratio": poisson_ratio,
            "topography": topography,
            "thickness": thickness,
            "relaxed_modulus": relaxed_modulus,
            "relaxation_time": relaxation_time,
        }
        maps = {
            name: found
            for name, value in given.items()
            if (found := _made(name, value, allow_nan and name != "topography")) is not None
        }
        for name in ("modulus", "adhesion", "poisson_ratio"):
            if name not in maps:
                raise InputError(name, None, "one number or a 2-D map")
        ny_nx = _common_shape(maps, shape)
        _check_relaxation(maps)
        for name in given:
            one = maps.get(name)
            whole = one if one is None or is_lazy(one) else np.broadcast_to(one, ny_nx)
            object.__setattr__(self, name, whole)
        object.__setattr__(self, "pixel_size", _pixels(pixel_size))
        object.__setattr__(self, "shape", ny_nx)
        object.__setattr__(self, "allow_nan", bool(allow_nan))
        object.__setattr__(self, "_unique", None)

    @classmethod
    def from_labels(
        cls,
        labels: ArrayLike,
        materials: Mapping[int, Material] | Sequence[Material],
        *,
        pixel_size: float | Sequence[float],
        topography: ArrayLike | None = None,
    ) -> Surface:
        """Make a surface of a few materials.

        Parameters
        ----------
        labels : array_like of whole numbers or bool, shape (ny, nx)
            Which material each pixel is made of.
        materials : mapping of int to Material, or a sequence of them
            The material of each label, from 0 in a sequence; labels that the map does not use may be there too.
        pixel_size : float or (float, float)
            [m], as in `Surface`.
        topography : float or array_like, shape (ny, nx), optional
            [m], as in `Surface`.

        Returns
        -------
        Surface
            It remembers the labels, so that `unique` costs nothing.

        Raises
        ------
        InputError
            If a label has no material, the labels are not a 2-D map of whole numbers, or some materials have a
            viscosity and others a damping.

        Examples
        --------
        >>> soft, hard = Material(modulus=1e9, adhesion=0.1), Material(modulus=3e9, adhesion=0.05)
        >>> surface = Surface.from_labels([[0, 1], [1, 1]], {0: soft, 1: hard}, pixel_size=4e-9)
        >>> surface.modulus.tolist()
        [[1000000000.0, 3000000000.0], [3000000000.0, 3000000000.0]]
        """
        if is_lazy(labels):
            return _from_lazy_labels(lazy_map("labels", labels, int), materials, pixel_size, topography)
        label_map = as_array("labels", labels, "a 2-D map of whole numbers")
        if label_map.ndim != 2 or not label_map.size:
            raise InputError("shape of labels", label_map.shape, "(rows, columns) of a 2-D map")
        _check_map("labels", label_map, 36)  # measured, with three maps that are not uniform
        if label_map.dtype.kind == "f" and (np.abs(label_map) < LARGEST).all() and not (label_map % 1).any():
            label_map = label_map.astype(np.int64)
        if label_map.dtype.kind not in "iub":
            hint = "Try labels.astype(int)."
            if label_map.dtype.kind in "SUO":
                hint = "Number the names: names, numbers = numpy.unique(labels, return_inverse=True)."
            raise InputError("type of labels", label_map.dtype.name, "whole numbers", hint)
        names, table, viscous = _material_table(materials)
        index = _positions(label_map, names)
        used = np.bincount(index.reshape(-1), minlength=len(names)) > 0
        first, merged = _factorise(list(table[used].T))
        renumber = np.full(len(names), -1, np.int32)
        renumber[used] = merged
        rows, inverse = _read_only(table[used][first]), _read_only(renumber[index])
        columns = [column[0] if (column == column[0]).all() else _read_only(column[inverse]) for column in rows.T]
        damping, viscosity = (None, columns[2]) if viscous else (columns[2], None)
        sides, relief = _pixels(pixel_size), _made("topography", topography, False)
        with unquestioned():  # each Material was looked at when it was made
            surface = cls(
                columns[0], columns[1], damping, viscosity, columns[3], relief,
                *([None] if len(columns) == 6 else []), *columns[4:], pixel_size=sides, shape=label_map.shape,
            )  # fmt: skip
        object.__setattr__(surface, "_unique", (rows, inverse))
        return surface

    @classmethod
    def from_dataset(cls, dataset: xr.Dataset, *, allow_nan: bool = False) -> Surface:
        """Read a surface from a Dataset, as `to_dataset` writes it or with the same names.

        Parameters
        ----------
        dataset : xarray.Dataset
            Variables modulus and adhesion, and if there are any damping or viscosity, poisson_ratio, topography,
            thickness, relaxed_modulus and relaxation_time; each with dims ("y", "x") or none. Coordinates y and x,
            increasing, evenly spaced. A units attribute with a metric prefix (GPa, mJ/m2, nm) is converted, a missing
            one is SI.
        allow_nan : bool
            As in `Surface`.

        Returns
        -------
        Surface
            Its coordinates start anew at the top left corner. The size of a single row or column is read as twice its
            coordinate.

        Raises
        ------
        InputError
            If a variable or coordinate is missing, has other dims or another kind of unit, or a value is out of range.

        Examples
        --------
        >>> surface = Surface(modulus=[[1e9, 3e9]], adhesion=0.05, pixel_size=4e-9)
        >>> Surface.from_dataset(surface.to_dataset()) == surface
        True
        """
        names = [str(name) for name in dataset.data_vars]
        for needed in ("modulus", "adhesion"):
            if needed not in dataset.data_vars:
                raise InputError("list of variables in the dataset", names, f"a list that has {needed!r} in it")
        given = {name: variable_in_si(dataset[name], name) for name in QUANTITIES if name in dataset.data_vars}
        sides = coordinate_step(dataset, "y"), coordinate_step(dataset, "x")
        shape = dataset.sizes["y"], dataset.sizes["x"]
        return cls(**given, pixel_size=sides, shape=shape, allow_nan=allow_nan)

    def to_dataset(self) -> xr.Dataset:
        """Describe the surface as a Dataset that survives netCDF.

        Returns
        -------
        xarray.Dataset
            The fields as variables with dims ("y", "x"), long_name and units, on coordinates of the pixel centres [m].
            It shares the surface's memory and so cannot be written to; ``copy(deep=True)`` can.

        Examples
        --------
        >>> ds = Surface(modulus=1e9, adhesion=0.05, pixel_size=4e-9, shape=(2, 3)).to_dataset()
        >>> dict(ds.sizes), ds["adhesion"].attrs["units"]
        ({'y': 2, 'x': 3}, 'J m-2')
        """
        import xarray as xr

        y, x = self.coords()
        coords = {
            "y": ("y", y, {"long_name": "position from the top of the image", "units": "m", "axis": "Y"}),
            "x": ("x", x, {"long_name": "position from the left of the image", "units": "m", "axis": "X"}),
        }
        variables = {
            name: (("y", "x"), value, {"long_name": quantity.long_name, "units": quantity.unit})
            for name, quantity in QUANTITIES.items()
            if (value := getattr(self, name)) is not None
        }
        dataset = xr.Dataset(variables, coords, {"Conventions": "CF-1.11"})
        for name in ("y", "x"):
            dataset[name].encoding["_FillValue"] = None  # CF allows no missing coordinates
        return dataset

    def coords(self) -> tuple[FloatArray, FloatArray]:
        """Positions of the pixel centres from the top left corner of the image.

        Returns
        -------
        y : ndarray, shape (ny,)
            [m], increasing with the row.
        x : ndarray, shape (nx,)
            [m], increasing with the column.

        Examples
        --------
        >>> y, x = Surface(modulus=1e9, pixel_size=(4e-9, 2e-9), shape=(1, 2)).coords()
        >>> y, x.round(12)
        (array([2.e-09]), array([1.e-09, 3.e-09]))
        """
        y, x = (centres(count, step) for count, step in zip(self.shape, self.pixel_size, strict=True))
        return y, x

    @property
    def lazy(self) -> bool:
        """Whether some map is a Dask array."""
        return any(is_lazy(getattr(self, name)) for name in QUANTITIES)

    def compute(self) -> Surface:
        """Return the surface with all maps in memory; the same one if they are there already.

        Returns
        -------
        Surface

        Raises
        ------
        InputError
            As `Surface`.

        Examples
        --------
        >>> Surface(modulus=1e9, pixel_size=4e-9, shape=(2, 3)).compute().lazy
        False
        """
        if not self.lazy:
            return self
        maps = {name: np.asarray(value) if is_lazy(value := getattr(self, name)) else value for name in QUANTITIES}
        with unquestioned():
            return Surface(**maps, pixel_size=self.pixel_size, shape=self.shape, allow_nan=self.allow_nan)

    def _refuse_lazy(self) -> None:
        """Refuse what looks at all pixels at once."""
        if self.lazy:
            raise InputError("surface", Word("in Dask arrays"), "maps in memory", "Take surface.compute().")

    def unique(self) -> tuple[FloatArray, IntArray]:
        """Find the distinct materials, so that each is solved once.

        Returns
        -------
        rows : ndarray, shape (n, 4), (n, 5) or (n, 6)
            Modulus [Pa], adhesion [J/m2], damping [1] or viscosity [Pa s], whichever there is, Poisson's ratio [1], and
            thickness [m] if there is one, or relaxed modulus [Pa] and relaxation time [s].
        inverse : ndarray of int32, shape (ny, nx)
            Which row each pixel has: ``rows[inverse, 0]`` is the modulus map, bit for bit. Both are computed once and
            read-only.

        Examples
        --------
        >>> surface = Surface(modulus=[[1e9, 3e9, 1e9]], adhesion=0.05, pixel_size=4e-9)
        >>> rows, inverse = surface.unique()
        >>> rows[:, 0].tolist(), inverse.tolist()
        ([1000000000.0, 3000000000.0], [[0, 1, 0]])
        """
        self._refuse_lazy()
        found = self._unique
        if found is None:
            columns = self.columns
            varying = [column.reshape(-1) for column in columns if not _is_uniform(column)]
            if varying:
                first, flat = _factorise(varying)
                pixels = np.divmod(first, self.shape[1])
                rows, inverse = np.column_stack([column[pixels] for column in columns]), flat.reshape(self.shape)
            else:
                rows = np.array([[column[0, 0] for column in columns]])
                inverse = np.broadcast_to(np.int32(0), self.shape)
            found = _read_only(rows), _read_only(inverse)
            object.__setattr__(self, "_unique", found)
        return found

    @property
    def found(self) -> tuple[FloatArray, IntArray] | None:
        """What `unique` gives if that is known already, else None."""
        return self._unique

    def materials(self, pixels: slice | NDArray[np.intp]) -> FloatArray:
        """Rows as `unique` gives them, of some pixels.

        Parameters
        ----------
        pixels : slice or ndarray of int
            In the order of the rows of the image, ``row * nx + column``.

        Examples
        --------
        >>> Surface(modulus=[[1e9, 3e9]], adhesion=0.05, pixel_size=4e-9).materials(slice(1, 2)).tolist()
        [[3000000000.0, 0.05, 0.0, 0.35]]
        """
        self._refuse_lazy()
        return np.column_stack([column.reshape(-1)[pixels] for column in self.columns])

    @property
    def columns(self) -> list[FloatArray]:
        """The maps that make up a material."""
        fields = (
            self.modulus, self.adhesion, self.damping, self.viscosity, self.poisson_ratio, self.thickness,
            self.relaxed_modulus, self.relaxation_time,
        )  # fmt: skip
        return [column for column in fields if column is not None]

    def rows(self, rows: slice) -> Surface:
        """Some rows of it, as a surface that shares its maps.

        Parameters
        ----------
        rows : slice
            At least one row.

        Returns
        -------
        Surface
            It remembers what `unique` found here; some of these materials may be in no pixel of it.

        Examples
        --------
        >>> Surface(modulus=[[1e9], [3e9]], pixel_size=4e-9).rows(slice(1, 2)).modulus.tolist()
        [[3000000000.0]]
        """
        part = copy.copy(self)
        for name in QUANTITIES:
            if (value := getattr(self, name)) is not None:
                object.__setattr__(part, name, value[rows])
        object.__setattr__(part, "shape", part.modulus.shape)
        if self._unique is not None:
            object.__setattr__(part, "_unique", (self._unique[0], self._unique[1][rows]))
        return part

    def dilated(self, tip: Tip, half_angle: float | None = None) -> Surface:
        """Return the surface as a tip of finite size meets it: steps and particles look wider, pits narrower.

        Parameters
        ----------
        tip : Tip
            A sphere of its radius that goes over into a cone.
        half_angle : float, optional
            Of that cone [degree]; 20 by default.

        Returns
        -------
        Surface
            Its topography is the height of the apex, its materials are those of the points touched. See
            `phasemap.experiment.dilation.dilated`.

        Raises
        ------
        InputError
            If `half_angle` is not above 0 and below 90.
        """
        from phasemap.experiment.dilation import HALF_ANGLE, dilated

        self._refuse_lazy()
        return dilated(self, tip, HALF_ANGLE if half_angle is None else half_angle)

    def seen_by(self, scope: Microscope, setpoint: Scalar, *, depth: ArrayLike | None = None) -> Surface:
        """Return the surface as a tip sees it that touches and attracts an area: edges between materials are blurred.

        Parameters
        ----------
        scope : Microscope
        setpoint : float
            Amplitude over the free amplitude at the drive frequency, between 0 and 1.
        depth : float or array_like, shape (ny, nx), optional
            Largest indentation at each pixel [m]: ``indentation`` of an image, say. By default that of the
            repulsive orbit on DMT contact, to first order in depth over amplitude: near resonance good to some 5 %.

        Returns
        -------
        Surface
            Its plane-strain modulus and Poisson's ratio are means over the contact's disc of radius sqrt(R d) under the
            pressure of Hertz, its damping that over the disc, its adhesion that over the disc and the reach of the
            long-range force beyond. See `phasemap.experiment.footprint`. The topography stays.

        Raises
        ------
        InputError
            If `setpoint` is not between 0 and 1, `depth` has another shape, or the maps are Dask arrays.

        Examples
        --------
        >>> from phasemap.experiment.microscope import Cantilever, Drive, Microscope, Tip
        >>> edge = Surface(modulus=[[1e9] * 8 + [3e9] * 8], pixel_size=2e-9, poisson_ratio=0.3)
        >>> scope = Microscope(Cantilever(40.0, 300e3, 400.0), Tip(10e-9), Drive(40e-9))
        >>> [round(float(E) / 1e9, 2) for E in edge.seen_by(scope, 0.7).modulus[0, 5:11]]
        [1.0, 1.21, 1.7, 2.39, 2.94, 3.0]
        """
        from phasemap.experiment.footprint import seen_by

        self._refuse_lazy()
        ratio = number("setpoint", setpoint, "1", above=0, below=1)
        return seen_by(self, scope, ratio, None if depth is None else np.asarray(depth, dtype=np.float64))

    def __eq__(self, other: object) -> bool:
        """Whether both have the same values everywhere; where both have NaN they agree."""
        if not isinstance(other, Surface):
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
        return f"Surface({', '.join(f'{name} {said}'.removeprefix('size ') for name, said in self._said().items())})"

    def _repr_html_(self) -> str:
        return table("Surface", self._said())

    def _said(self) -> dict[str, str]:
        """Size and ranges in words."""
        rows, columns = self.shape
        tall, wide = (say(side, "m") for side in self.pixel_size)
        found = {"size": f"{rows} x {columns} pixels of {tall if tall == wide else f'{tall} x {wide}'}"}
        for name in (
            "modulus",
            "adhesion",
            "damping",
            "viscosity",
            "topography",
            "thickness",
            "relaxed_modulus",
            "relaxation_time",
        ):
            value = getattr(self, name)
            if is_lazy(value):
                blocks = chunks_of(value)
                found[name] = f"in Dask blocks of {blocks[0][0]} x {blocks[1][0]} pixels"
            elif value is not None:
                ends = [say(float(end.reduce(value, None)), QUANTITIES[name].unit) for end in (np.fmin, np.fmax)]
                found[name] = " to ".join(dict.fromkeys(ends))
        return found


def _from_lazy_labels(labels: Any, materials: Any, pixel_size: Any, topography: Any) -> Surface:
    """Materials that are looked up when a block of the labels is computed."""
    names, table, viscous = _material_table(materials)
    columns = [
        column[0] if (column == column[0]).all() else labels.map_blocks(_looked_up, names, column, dtype=np.float64)
        for column in table.T
    ]
    damping, viscosity = (None, columns[2]) if viscous else (columns[2], None)
    return Surface(
        columns[0], columns[1], damping, viscosity, columns[3], topography, *columns[4:], pixel_size=pixel_size,
        shape=labels.shape,
    )  # fmt: skip


def _looked_up(labels: NDArray[Any], names: list[int], column: FloatArray) -> FloatArray:
    """One property of the material of each label."""
    return column[_positions(labels, names)] if labels.size else np.empty(labels.shape)


def _pixels(value: object) -> tuple[float, float]:
    """The (dy, dx) of a pixel [m]."""
    dy, dx = pixel_pair(value)
    question("pixel_size", max(dy, dx), "m", PIXEL)
    return dy, dx


def _made(name: str, value: Any, allow_nan: bool) -> Any:
    """What the user gave as a map that a surface keeps; None stays None."""
    found = _in_si(name, value)
    if found is None:
        return None
    return lazy_map(name, found) if is_lazy(found) else _as_map(name, found, allow_nan)


def _in_si(name: str, value: Any) -> Any:
    """Numbers and maps with units, or a DataArray that says its units and dims, as plain numbers in SI."""
    if hasattr(value, "dims") and hasattr(value, "coords"):
        for dim in value.coords.keys() & {"y", "x"} & set(value.dims):
            coordinate_step(value, dim)  # refuses what is upside down or not even
        return variable_in_si(value, name)
    unit = QUANTITIES[name].unit
    try:
        return array_in_si(value, unit)
    except NotThatUnit:
        shown = value if isinstance(value, str) else "with another unit"
        raise InputError(name, shown, f"one number or a 2-D map, in {unit} or each {with_unit(unit)}") from None


def _as_map(name: str, value: ArrayLike, allow_nan: bool) -> FloatArray:
    """Return `value`, checked, as a read-only float64 array: 0-d, or a map whose strides are 0 if it is uniform."""
    quantity = QUANTITIES[name]
    if isinstance(value, np.ma.MaskedArray):
        value = _unmasked(name, value)
    given = as_array(name, value, "one number or a 2-D map")
    if given.ndim == 0 and quantity.endless and given == math.inf:
        return _read_only(np.array(math.inf))
    if given.ndim == 0:
        one = number(name, given.item(), quantity.unit, **quantity.bounds)
        question(name, one, quantity.unit, quantity.usual)
        return _read_only(np.array(one))
    if given.ndim != 2 or not given.size:
        raise InputError(f"shape of {name}", given.shape, "(rows, columns) of a 2-D map", "One number will do too.")
    if given.dtype.kind not in "fiu":
        raise InputError(f"type of {name}", given.dtype.name, "real numbers")
    if not _is_uniform(given):
        _check_map(name, given, 8)
    full = (given[:1, :1] if _is_uniform(given) else given).astype(np.float64, order="C", copy=False)
    if full is given and not _is_frozen(full):
        full = full.copy()
    low, high = full.min(), full.max()  # NaN if there is one
    if not (_inside(low, quantity) and _inside(high, quantity)):
        bad = ~_inside(full, quantity)
        if allow_nan:
            bad &= ~np.isnan(full)
        if bad.any():
            _raise_for_pixel(name, full, bad)
    ends = (low, high) if low <= high else (np.fmin.reduce(full, None), np.fmax.reduce(full, None))
    if math.isfinite(most := float(max(ends, key=abs))):
        question(name, most, quantity.unit, quantity.usual)
    bits = full.view(np.int64)
    if not low < high and (bits == bits[0, 0]).all():
        return np.broadcast_to(_read_only(np.array(full[0, 0])), given.shape)
    return _read_only(full)


def as_array(name: str, value: object, allowed: str) -> NDArray[Any]:
    """Return what the user gave as an array of whatever type.

    Raises
    ------
    InputError
        If it is none.
    """
    try:
        return np.asarray(value)
    except (MemoryError, RecursionError):
        raise
    except Exception:  # ValueError mostly; what other libraries' arrays raise is theirs
        raise InputError(name, "a list of rows of unequal length", allowed) from None


def _unmasked(name: str, value: np.ma.MaskedArray[Any, Any]) -> NDArray[Any]:
    """Return a masked array with NaN where it is masked."""
    if value.dtype.kind not in "fiu":
        raise InputError(f"type of {name}", value.dtype.name, "real numbers")
    _check_map(name, value, 8)
    return np.asarray(np.ma.filled(value.astype(np.float64), np.nan))


def _check_map(name: str, given: NDArray[Any], per_pixel: int) -> None:
    """Refuse a map that would not fit into memory; one that numpy repeats (`broadcast_to`) may be of any size."""
    ny, nx = given.shape[-2:] if given.ndim > 1 else (1, given.size)
    check_fits(f"{name} with {ny} x {nx} pixels", float(given.size) * per_pixel, "Take fewer pixels, or one number.")


def _inside(value: Any, quantity: Quantity) -> Any:
    """Whether each of `value` is finite and within the bounds."""
    least, above, most = (quantity.bounds.get(name, limit) for name, limit in _NO_BOUNDS)
    there = ~np.isnan(value) if quantity.endless else np.isfinite(value)
    return there & (value >= least) & (value > above) & (value <= most)


def _raise_for_pixel(name: str, full: FloatArray, bad: NDArray[np.bool_]) -> None:
    """Raise `InputError` for the first bad pixel and say how many there are."""
    quantity = QUANTITIES[name]
    value = full.reshape(-1)[bad.argmax()]
    hint = _where(bad)
    if math.isnan(value):
        hint += " Fill it from its neighbours" + (
            "." if name == "topography" else ", or give allow_nan=True to leave it without a material."
        )
    raise InputError(name, value, in_words(quantity.unit, **quantity.bounds), hint)


def _where(bad: NDArray[np.bool_]) -> str:
    """Say where the first bad pixel is and how many there are."""
    row, col = divmod(int(bad.argmax()), bad.shape[1])
    count = int(bad.sum())
    return f"It is at row {row}, column {col}" + (f"; {count} such pixels." if count > 1 else ".")


def _common_shape(maps: dict[str, FloatArray], shape: Sequence[int] | None) -> tuple[int, int]:
    """Return the one shape that `shape` and all maps have."""
    first, agreed = "", (0, 0)
    if shape is not None:
        first, agreed = "the one asked for", shape_pair(shape)
    for name, array in maps.items():
        if array.ndim and not first:
            first, agreed = f"that of {name}", (array.shape[0], array.shape[1])
        elif array.ndim and array.shape != agreed:
            raise InputError(f"shape of {name}", array.shape, f"{agreed}, {first}")
    if not first:
        raise InputError("shape", None, "(rows, columns), where no map is given")
    return agreed


def _check_relaxation(maps: dict[str, FloatArray]) -> None:
    """Refuse maps that are not those of standard linear solids; lazy ones are seen when they are computed."""
    given = [name for name in ("relaxed_modulus", "relaxation_time") if name in maps]
    if not given:
        return
    if len(given) < 2:
        missing = "relaxation_time" if given[0] == "relaxed_modulus" else "relaxed_modulus"
        raise InputError(missing, None, f"given together with {given[0]}")
    _refuse_films("thickness" in maps)
    if any(is_lazy(one) for one in maps.values()):
        return
    above = np.atleast_2d(maps["relaxed_modulus"] > maps["modulus"])
    if above.any():
        most = float(np.max(maps["relaxed_modulus"]))
        raise InputError("relaxed_modulus", most, "at most modulus, that of a sudden touch", _where(above))
    _refuse_losses(any(bool(np.any(maps[name] > 0)) for name in ("damping", "viscosity") if name in maps))


def _refuse_films(film: bool) -> None:
    if film:
        raise InputError("relaxation_time", Word("given beside a thickness"), "either of them: only half-spaces relax")


def _refuse_losses(loss: bool) -> None:
    if loss:
        allowed = "relaxation, or damping or viscosity, not both on one surface"
        raise InputError("relaxation_time", Word("given beside a damping or viscosity"), allowed)


def _material_table(materials: Mapping[int, Material] | Sequence[Material]) -> tuple[list[int], FloatArray, bool]:
    """Return the labels in order, one row a material as `Surface.unique` has them, and whether some are viscous."""
    if isinstance(materials, Sequence) and not isinstance(materials, str):
        materials = dict(enumerate(materials))
    if not isinstance(materials, Mapping) or not materials:
        raise InputError("materials", materials, "a dict with at least one Material, such as {0: soft, 1: hard}")
    for label, material in materials.items():
        if not isinstance(label, (int, np.integer)):
            raise InputError("label of a material", label, "a whole number")
        if not isinstance(material, Material):
            raise InputError(f"material {label}", material, "a Material")
    names = sorted(int(label) for label in materials)
    chosen = [materials[name] for name in names]
    viscous = any(m.viscosity for m in chosen)
    damped = next((n for n, m in zip(names, chosen, strict=True) if m.damping), None)
    if viscous and damped is not None:
        raise InputError(
            f"damping of material {damped}",
            materials[damped].damping,
            "viscosity in its place, as in another of the materials",
            "The two are compared only once the lever and the tip are known.",
        )
    rows = [(m.modulus, m.adhesion, (m.viscosity or 0.0) if viscous else m.damping, m.poisson_ratio) for m in chosen]
    table = np.array(rows, dtype=np.float64)
    if any(m.thickness is not None for m in chosen):
        endless = [math.inf if m.thickness is None else m.thickness for m in chosen]
        table = np.column_stack([table, endless])
    if any(m.relaxation_time is not None for m in chosen):
        _refuse_films(table.shape[1] > 4)
        relaxing = [(m.relaxed_modulus or m.modulus, m.relaxation_time or math.inf) for m in chosen]
        table = np.column_stack([table, relaxing])
        _refuse_losses(bool(table[:, 2].any()))
    return names, table, viscous


def _positions(labels: NDArray[Any], names: list[int]) -> NDArray[np.intp]:
    """Return where in the sorted `names` each label is."""
    if labels.dtype.kind == "b":
        labels = labels.view(np.uint8)
    limits = np.iinfo(labels.dtype)
    fitting = [name for name in names if limits.min <= name <= limits.max]
    known = np.array(fitting, labels.dtype)
    index = np.minimum(np.searchsorted(known, labels), max(len(known) - 1, 0))
    unknown = known[index] != labels if fitting else np.ones(labels.shape, np.bool_)
    if unknown.any():
        strange = np.unique(labels[unknown]).tolist()
        shown = ", ".join(str(label) for label in strange[:5]) + (" and more" if len(strange) > 5 else "")
        raise InputError("label without a material", shown, "labels " + ", ".join(map(str, names)), _where(unknown))
    return index + names.index(fitting[0])


def _factorise(columns: Sequence[FloatArray]) -> tuple[NDArray[np.intp], IntArray]:
    """Find the distinct rows of equally long columns, by their bits: where each occurs, and which one each entry is."""
    size = columns[0].size
    count, codes = _codes(np.ascontiguousarray(columns[0]).view(np.int64))
    for column in columns[1:]:
        if count == size:
            break
        more, code = _codes(np.ascontiguousarray(column).view(np.int64))
        codes *= more
        codes += code
        count, codes = _codes(codes)
    first = np.empty(count, np.intp)
    first[codes[::-1]] = np.arange(size - 1, -1, -1)  # the last assignment holds
    return first, codes.astype(np.int32)


def _codes(values: NDArray[np.int64]) -> tuple[int, NDArray[np.intp]]:
    """Return how many distinct values there are and the rank of each."""
    ordered = np.sort(values)
    distinct = ordered[np.concatenate(([True], ordered[1:] != ordered[:-1]))]
    if len(distinct) <= 1024:  # searching a small table is faster than sorting indices, a large one slower
        return len(distinct), np.searchsorted(distinct, values)
    del ordered
    return len(distinct), np.unique(values, return_inverse=True)[1]


def _is_uniform(array: NDArray[Any]) -> bool:
    """Whether the array is one number seen everywhere, as `numpy.broadcast_to` makes it."""
    return not any(array.strides)


def _is_frozen(array: object) -> bool:
    """Whether nobody can write to the array any more."""
    while isinstance(array, np.ndarray):
        if array.flags.writeable:
            return False
        array = array.base
    return array is None


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    array.flags.writeable = False
    return array
