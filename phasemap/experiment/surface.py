"""The surface under the tip: maps of material properties and topography on a grid of pixels.

Row 0 is the top of the image and y decreases with the row index; everything is SI.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from phasemap._shared.arrays import is_lazy
from phasemap._shared.asked import asked_as
from phasemap._shared.checks import number
from phasemap._shared.errors import InputError, Word
from phasemap._shared.fields import known_as
from phasemap._shared.notices import unquestioned
from phasemap._shared.quantities import Scalar
from phasemap.experiment.labels import Variation, lazily_looked_up, looked_up
from phasemap.experiment.maps import Maps
from phasemap.experiment.material import Material
from phasemap.experiment.prony import Prony, keys_of
from phasemap.experiment.surface_maps import (
    QUANTITIES,
    as_variables,
    check_relaxing,
    check_spacing,
    common_shape,
    maps_of,
    pixel_sides,
    property_map,
)

if TYPE_CHECKING:
    import xarray as xr

    from phasemap.experiment.microscope import Microscope, Tip


@known_as(E="modulus", w="adhesion", nu="poisson_ratio", h="thickness")
@dataclass(frozen=True, init=False, repr=False, eq=False)
class Surface(Maps):
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
    liquid_film, contact_angle : float or array_like, shape (ny, nx), optional
        [m, degree] of the film of liquid, for the contact "capillary"; infinite where it is that of the law.
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

    def __init__(
        self,
        modulus: ArrayLike,
        adhesion: ArrayLike = 0.0,
        damping: ArrayLike | None = None,
        viscosity: ArrayLike | None = None,
        poisson_ratio: ArrayLike = 0.35,
        topography: ArrayLike | None = None,
        thickness: ArrayLike | None = None,
        *,
        relaxed_modulus: ArrayLike | None = None,
        relaxation_time: ArrayLike | None = None,
        liquid_film: ArrayLike | None = None,
        contact_angle: ArrayLike | None = None,
        relaxation: Prony | ArrayLike | None = None,
        pixel_size: float | Sequence[float],
        shape: Sequence[int] | None = None,
        allow_nan: bool = False,
    ) -> None:
        if damping is None and viscosity is None:
            damping = 0.0
        elif damping is not None and viscosity is not None:
            raise InputError("viscosity", Word("given beside damping"), "one of the two")
        given = {
            "modulus": modulus, "adhesion": adhesion, "damping": damping, "viscosity": viscosity,
            "poisson_ratio": poisson_ratio, "topography": topography, "thickness": thickness,
            "relaxed_modulus": relaxed_modulus, "relaxation_time": relaxation_time, "liquid_film": liquid_film,
            "contact_angle": contact_angle, "relaxation": keys_of(relaxation),
        }  # fmt: skip
        maps = {
            name: found
            for name, value in given.items()
            if (found := property_map(name, value, allow_nan and name != "topography")) is not None
        }
        for name in ("modulus", "adhesion", "poisson_ratio"):
            if name not in maps:
                raise InputError(name, None, "one number or a 2-D map")
        ny_nx = common_shape(maps, shape)
        check_relaxing(maps)
        for name in given:
            values = maps.get(name)
            whole = values if values is None or is_lazy(values) else np.broadcast_to(values, ny_nx)
            object.__setattr__(self, name, whole)
        sides = pixel_sides(pixel_size)
        check_spacing(given, sides)
        object.__setattr__(self, "pixel_size", sides)
        object.__setattr__(self, "shape", ny_nx)
        object.__setattr__(self, "allow_nan", bool(allow_nan))
        object.__setattr__(self, "_unique", None)

    @classmethod
    @asked_as()
    def from_labels(
        cls,
        labels: ArrayLike,
        materials: Mapping[int, Material] | Sequence[Material],
        *,
        pixel_size: float | Sequence[float],
        topography: ArrayLike | None = None,
        variation: Variation | None = None,
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
        variation : Variation, optional
            How much the properties of each material vary within its domains; by default they do not.

        Returns
        -------
        Surface
            It remembers the labels, so that `unique` costs nothing; where it varies each pixel has its own material.

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
        distinct = None
        if is_lazy(labels):
            if variation is not None:
                raise InputError("variation", variation, "None for labels in Dask arrays", "Take labels.compute().")
            maps = lazily_looked_up(labels, materials)
        else:
            maps, distinct = looked_up(labels, materials)
        sides, relief = pixel_sides(pixel_size), property_map("topography", topography, False)
        check_spacing({"labels": labels, "topography": topography}, sides)
        shape = np.shape(labels) if distinct is None else distinct[1].shape
        if variation is not None:
            maps, distinct = variation.of(maps, (shape[0], shape[1]), sides), None
        with unquestioned():  # each Material was looked at when it was made
            surface = cls(**maps, topography=relief, pixel_size=sides, shape=shape)
        object.__setattr__(surface, "_unique", distinct)
        return surface

    @classmethod
    @asked_as()
    def from_dataset(cls, dataset: xr.Dataset, *, allow_nan: bool = False) -> Surface:
        """Read a surface from a Dataset, as `to_dataset` writes it or with the same names.

        Parameters
        ----------
        dataset : xarray.Dataset
            Variables modulus and adhesion, and if there are any damping or viscosity, poisson_ratio, topography,
            thickness, relaxed_modulus and relaxation_time, liquid_film and contact_angle; each with dims ("y", "x") or
            none. Coordinates y and x,
            evenly spaced, x increasing; row 0 is the top, whichever way y counts. A units attribute with a
            metric prefix (GPa, mJ/m2, nm) is converted, a missing one is SI.
        allow_nan : bool
            As in `Surface`.

        Returns
        -------
        Surface
            Its coordinates start anew at the bottom left corner. The size of a single row or column is read as twice
            its coordinate.

        Examples
        --------
        >>> surface = Surface(modulus=[[1e9, 3e9]], adhesion=0.05, pixel_size=4e-9)
        >>> Surface.from_dataset(surface.to_dataset()) == surface
        True
        """
        return cls(**maps_of(dataset), allow_nan=allow_nan)

    def to_dataset(self) -> xr.Dataset:
        """Describe the surface as a Dataset that survives netCDF.

        Returns
        -------
        xarray.Dataset
            The fields as variables with dims ("y", "x"), long_name and units, on coordinates of the pixel centres [m].
            It shares the surface's memory and so cannot be written to; ``copy(deep=True)`` can.
        """
        y, x = self.coords()
        return as_variables({name: getattr(self, name) for name in QUANTITIES}, y, x)

    def compute(self) -> Surface:
        """Return the surface with all maps in memory; the same one if they are there already."""
        if not self.lazy:
            return self
        maps = {name: np.asarray(value) if is_lazy(value := getattr(self, name)) else value for name in QUANTITIES}
        with unquestioned():
            return Surface(**maps, pixel_size=self.pixel_size, shape=self.shape, allow_nan=self.allow_nan)

    @asked_as()
    def dilated(self, tip: Tip, half_angle: float | None = None) -> Surface:
        """Return the surface as a tip of finite size meets it: steps and particles look wider, pits narrower.

        Parameters
        ----------
        tip : Tip
            A sphere of its radius that continues as a cone.
        half_angle : float, optional
            Of that cone [degree]; 20 by default.

        Returns
        -------
        Surface
            Its topography is the height of the apex, its materials are those of the points touched: theory,
            Eq. (model-28).
        """
        from phasemap.experiment.seen_by_tip import HALF_ANGLE, dilated

        self._refuse_lazy()
        return dilated(self, tip, HALF_ANGLE if half_angle is None else half_angle)

    @asked_as()
    def seen_by(self, scope: Microscope, setpoint: Scalar, *, depth: ArrayLike | None = None) -> Surface:
        """Return the surface as a tip sees it that touches and attracts an area: edges between materials are blurred.

        Parameters
        ----------
        scope : Microscope
        setpoint : float
            Amplitude over the free amplitude at the drive frequency, between 0 and 1.
        depth : float or array_like, shape (ny, nx), optional
            Largest indentation at each pixel [m], finite where there is a material: ``indentation`` of an image.
            By default that of the
            repulsive orbit on DMT contact, to first order in depth over amplitude: near resonance good to some 5 %;
            what a neck of liquid pulls is not in it, and films on a rigid base need it given.

        Returns
        -------
        Surface
            Its plane-strain modulus and Poisson's ratio are means over the contact's disc of radius sqrt(R d) under the
            pressure of Hertz, its damping that over the disc, its adhesion that over the disc and the reach of the
            long-range force beyond: theory, Eq. (model-29). The topography stays.

        Examples
        --------
        >>> from phasemap.experiment.microscope import Cantilever, Drive, Microscope, Tip
        >>> edge = Surface(modulus=[[1e9] * 8 + [3e9] * 8], pixel_size=2e-9, poisson_ratio=0.3)
        >>> scope = Microscope(Cantilever(40.0, 300e3, 400.0), Tip(10e-9), Drive(40e-9))
        >>> [round(float(E) / 1e9, 2) for E in edge.seen_by(scope, 0.7).modulus[0, 5:11]]
        [1.0, 1.21, 1.7, 2.39, 2.94, 3.0]
        """
        from phasemap.experiment.seen_by_tip import seen_by

        self._refuse_lazy()
        ratio = number("setpoint", setpoint, "1", above=0, below=1)
        return seen_by(self, scope, ratio, depth)
