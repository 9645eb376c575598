"""What a real microscope adds to the image: noise, drift, offsets of lines, a change of the tip, and quantisation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from phasemap._shared.checks import number, whole
from phasemap._shared.errors import InputError
from phasemap.experiment.control import Control
from phasemap.experiment.dilation import seen_at
from phasemap.experiment.microscope import Microscope

if TYPE_CHECKING:
    import xarray as xr

    from phasemap.experiment.surface import Surface

__all__ = [
    "Realism", "TipChange", "check_realism", "drifted", "finish", "generator", "scopes_by_row",
]  # fmt: skip

FloatArray = NDArray[np.float64]

FAR = 2.0**40  # pixels: drift beyond every image
DIGITISED = ("height", "phase", "amplitude", "amplitude_error")  # channels that an instrument records


@dataclass(frozen=True)
class TipChange:
    """A tip that breaks, or wears off, in the middle of the image.

    Parameters
    ----------
    line : int
        The first row that the changed tip scans, at least 1.
    radius : float
        Its radius [m], > 0; all else about the tip stays.

    Raises
    ------
    InputError
        If a value is out of range.

    Notes
    -----
    A surface's `damping` (alpha1) holds for both tips as it is; give `viscosity` where the same material is meant. The
    relief is not dilated anew: `Surface.dilated` knows one tip.

    Examples
    --------
    >>> TipChange(line=100, radius=30e-9)
    TipChange(line=100, radius=3e-08)
    """

    line: int
    radius: float

    def __post_init__(self) -> None:
        whole("tip_change line", self.line, 1)
        number("tip_change radius", self.radius, "m", above=0)


@dataclass(frozen=True)
class Realism:
    """What a real microscope adds to an image; all of it is off unless asked for.

    Parameters
    ----------
    temperature : float, optional
        Of the lever [K], > 0, whose thermal motion then adds noise; with `Feedback` only.
    detector_noise : float, optional
        Of the deflection, one-sided amplitude spectral density, white [m/sqrt(Hz)], > 0; with `Feedback` only.
    line_offset : float
        Standard deviation [m] of a normally distributed offset of the height, one for each line and direction.
    phase_offset : float
        The same for the phase [degree].
    drift : (float, float, float)
        Of the sample under the tip during the whole image, along x, y and z [m]: row r of ny shows what lies
        (x, y) r / ny further right and down than its coordinates say, and z r / ny higher.
    tip_change : TipChange, optional
        Another radius of the tip from one line on.
    bits : int, optional
        Height, phase, amplitude and amplitude_error take ``2**bits`` values at equal steps over the range of each in
        this image, 1 to 32 bits.
    seed : int
        Of everything random, >= 0.

    Raises
    ------
    InputError
        If a value is out of range.

    Notes
    -----
    Drift comes first, for it changes what lies under the tip; topography is interpolated linearly, materials are those
    of the nearest pixel, and the outermost pixels go on beyond the edge. Trace and retrace share the drift of their
    line. Then the image is taken; `Engage` and `Raster` take the lines before and after a change of the tip as images
    of their own, so that ``Raster(engage="image")`` engages anew there. Offsets of lines come after, quantisation last.

    Examples
    --------
    >>> Realism(line_offset=0.2e-9, drift=(20e-9, 0.0, 0.0), tip_change=TipChange(100, 30e-9), bits=16).seed
    0
    """

    temperature: float | None = None
    detector_noise: float | None = None
    line_offset: float = 0.0
    phase_offset: float = 0.0
    drift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tip_change: TipChange | None = None
    bits: int | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        if self.temperature is not None:
            number("temperature", self.temperature, "K", above=0)
        if self.detector_noise is not None:
            number("detector_noise", self.detector_noise, "m/sqrt(Hz)", above=0)
        number("line_offset", self.line_offset, "m", minimum=0)
        number("phase_offset", self.phase_offset, "degree", minimum=0)
        object.__setattr__(self, "drift", _drift(self.drift))
        if self.tip_change is not None and not isinstance(self.tip_change, TipChange):
            raise InputError("tip_change", self.tip_change, "a TipChange, with line and radius")
        if self.bits is not None:
            whole("bits", self.bits, 1, 32)
        whole("seed", self.seed, 0)

    def __str__(self) -> str:
        """What is on, in the words of the arguments; empty where nothing is."""
        given = [(field, getattr(self, field.name)) for field in fields(self) if field.name != "seed"]
        on = [f"{field.name} {value}" for field, value in given if value != field.default]
        return "; ".join([*on, f"seed {self.seed}"] if on else [])


def _drift(value: object) -> tuple[float, float, float]:
    """Three lengths."""
    if isinstance(value, (str, bytes)) or not isinstance(value, Sequence) or len(value) != 3:
        raise InputError("drift", value, "three lengths in m, (x, y, z)")
    x, y, z = (number(f"drift {axis}", one, "m") for axis, one in zip("xyz", value, strict=True))
    return x, y, z


def check_realism(realism: object, control: Control, lines: int) -> Realism:
    """Return `realism` if it goes with the control and the number of lines.

    Raises
    ------
    InputError
        If noise is asked of a control that knows no time, or the tip changes after the last line.

    Examples
    --------
    >>> from phasemap.experiment.control import Engage
    >>> check_realism(Realism(temperature=300.0), Engage(), 64)
    Traceback (most recent call last):
    ...
    phasemap.InputError: temperature is 300.0; allowed: None. Noise acts in time: use control=pm.Feedback().
    """
    if not isinstance(realism, Realism):
        raise InputError("realism", realism, "a Realism")
    if not control.in_time:
        for name in ("temperature", "detector_noise"):
            value = getattr(realism, name)
            if value is not None:
                hint = "Noise acts in time: use control=pm.Feedback()."
                raise InputError(name, value, "None", hint)
    if realism.tip_change is not None and realism.tip_change.line >= lines:
        raise InputError("tip_change line", realism.tip_change.line, f"a row from 1 to {lines - 1} of this image")
    return realism


def generator(seed: int, purpose: str) -> np.random.Generator:
    """Random numbers of their own for each purpose: to turn one kind of noise on does not change another.

    Parameters
    ----------
    seed : int
        That of `Realism`.
    purpose : str
        What they are for, such as ``"height"``.

    Examples
    --------
    >>> generator(0, "height").integers(100, size=3).tolist() == generator(0, "phase").integers(100, size=3).tolist()
    False
    """
    return np.random.default_rng([seed, *purpose.encode()])


def scopes_by_row(realism: Realism, scope: Microscope, lines: int) -> list[tuple[slice, Microscope]]:
    """Rows of the image and the microscope that scans them, in order.

    Parameters
    ----------
    realism : Realism
    scope : Microscope
        As it is at the first line.
    lines : int
        Rows of the image.

    Examples
    --------
    >>> from phasemap.experiment.microscope import Cantilever, Drive, Tip
    >>> scope = Microscope(Cantilever(40.0, 300e3, 400.0), Tip(10e-9), Drive(20e-9))
    >>> blunt = Realism(tip_change=TipChange(line=3, radius=30e-9))
    >>> [(rows.start, rows.stop, one.tip.radius) for rows, one in scopes_by_row(blunt, scope, 8)]
    [(0, 3, 1e-08), (3, 8, 3e-08)]
    """
    change = realism.tip_change
    if change is None:
        return [(slice(0, lines), scope)]
    changed = replace(scope, tip=replace(scope.tip, radius=change.radius))
    return [(slice(0, change.line), scope), (slice(change.line, lines), changed)]


def drifted(surface: Surface, drift: tuple[float, float, float]) -> Surface:
    """Return the surface as it passes under the tip while it drifts.

    Parameters
    ----------
    surface : Surface
    drift : (float, float, float)
        Along x, y and z during the whole image [m], as in `Realism`.

    Returns
    -------
    Surface
        The same one without drift.

    Examples
    --------
    >>> from phasemap.experiment.surface import Surface
    >>> edge = Surface(modulus=[[1e9, 1e9, 1e9, 5e9]] * 4, pixel_size=1e-9)
    >>> (drifted(edge, (4e-9, 0.0, 0.0)).modulus / 1e9).tolist()
    [[1.0, 1.0, 1.0, 5.0], [1.0, 1.0, 5.0, 5.0], [1.0, 5.0, 5.0, 5.0], [5.0, 5.0, 5.0, 5.0]]
    """
    if not any(drift):
        return surface
    (ny, nx), (dy, dx) = surface.shape, surface.pixel_size
    part = np.arange(ny) / ny
    right, down = (min(max(way / side, -FAR), FAR) * part for way, side in zip(drift, (dx, dy), strict=False))
    relief = None if surface.topography is None else _carried(surface.topography, right, down)
    if drift[2]:
        relief = (0.0 if relief is None else relief) + np.broadcast_to(drift[2] * part[:, np.newaxis], surface.shape)
    rows = np.clip(np.arange(ny) + _nearest(down), 0, ny - 1)
    columns = np.clip(np.arange(nx) + _nearest(right)[:, np.newaxis], 0, nx - 1)
    return seen_at(surface, rows[:, np.newaxis] * nx + columns, relief)


def _nearest(pixels: FloatArray) -> NDArray[np.int64]:
    """Whole pixels, halves upwards, so that all pixels of a line move by the same."""
    return np.floor(pixels + 0.5).astype(np.int64)


def _carried(relief: FloatArray, right: FloatArray, down: FloatArray) -> FloatArray:
    """Relief at each pixel moved by its line's shift [pixels], linear between pixels, the outermost repeated."""
    ny, nx = relief.shape
    columns = np.arange(nx)
    carried = np.empty(relief.shape)
    for row in range(ny):
        place = min(max(row + down[row], 0.0), ny - 1.0)
        upper = math.floor(place)
        lower = min(upper + 1, ny - 1)
        line = relief[upper] + (place - upper) * (relief[lower] - relief[upper])
        carried[row] = np.interp(columns + right[row], columns, line)
    return carried


def finish(image: xr.Dataset, realism: Realism) -> xr.Dataset:
    """Add what comes after the scan: offsets of lines, then quantisation.

    Parameters
    ----------
    image : xarray.Dataset
        Dims ("y", "x"), or ("direction", "y", "x").
    realism : Realism

    Returns
    -------
    xarray.Dataset
        The same one if nothing is to be added. Each variable that changed says so in its attribute ``comment``, and
        has the step of its quantisation in ``quantisation_step``, in its own unit.

    Examples
    --------
    >>> import xarray as xr
    >>> image = xr.Dataset({"phase": (("y", "x"), np.zeros((2, 3)))})
    >>> noisy = finish(image, Realism(phase_offset=0.5))
    >>> np.ptp(noisy.phase.values, axis=1).tolist(), noisy.phase.attrs["comment"]
    ([0.0, 0.0], 'random offsets of lines, standard deviation 0.5, seed 0')
    """
    changed = {}
    for name in DIGITISED:
        if name not in image:
            continue
        one, comments = image[name], []
        deviation = {"height": realism.line_offset, "phase": realism.phase_offset}.get(name, 0.0)
        if deviation:
            one = one + _offsets(one, deviation, generator(realism.seed, name))
            comments.append(f"random offsets of lines, standard deviation {deviation:g}, seed {realism.seed}")
        step = None
        if realism.bits is not None:
            one, step = _quantised(one, realism.bits)
            comments.append(f"quantised to {realism.bits} bits")
        if comments:
            more = {} if step is None else {"quantisation_step": step}
            changed[name] = one.assign_attrs(image[name].attrs, comment="; ".join(comments), **more)
    return image.assign(changed) if changed else image


def _offsets(values: xr.DataArray, deviation: float, random: np.random.Generator) -> xr.DataArray:
    """One random number for each line and direction."""
    lines = values.isel(x=0, drop=True)
    return lines.copy(data=random.normal(0.0, deviation, lines.shape))


def _quantised(values: xr.DataArray, bits: int) -> tuple[xr.DataArray, float]:
    """Values rounded to 2**bits equal steps from the lowest to the highest of them, and the step; NaN stays."""
    low, high = float(values.min()), float(values.max())
    step = (high - low) / (2**bits - 1)
    if not step > 0:  # one value only, or none
        return values, 0.0
    return low + ((values - low) / step).round() * step, step
