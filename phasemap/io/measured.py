"""Measured height and phase images, and the materials that their phase tells apart.

Reading is left to Gwyddion's file modules (the packages ``gwyddionpy`` and ``gwyddionpy-converter``) and thresholding
to scikit-image; both come with ``pip install "afm-phasemap[read]"``.
"""

from __future__ import annotations

import hashlib
import os
import re
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from phasemap.errors import FileError, InputError, PhasemapError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    import numpy as np
    import xarray as xr

__all__ = ["align_rows", "level_height", "read_height_phase", "segment_phase"]

HEIGHT_NAMES = ("height", "z-axis", "zsensor", "topography")  # as vendors begin them
PHASE_NAMES = ("phase", "lock-in phase")
MODE_KEYS = ("Op. mode", "ImagingMode", "MicroscopeList")  # Nanosurf, Asylum Research, Bruker
TAPPING_MODES = ("phase contrast", "dynamic force", "dynamic afm", "ac mode", "tapping", "tapping mode")
DEGREES = {"deg": 1.0, "rad": 57.29577951308232}


def read_height_phase(path: str | os.PathLike[str], height: str | None = None, phase: str | None = None) -> xr.Dataset:
    """Read the height and the phase image of a tapping-mode file.

    Parameters
    ----------
    path : path-like
        A file of any format that Gwyddion reads (.nid, .ibw, NanoScope, .gwy and some 170 more).
    height, phase : str, optional
        Names of the channels; None takes the first phase channel of the forward (trace) scan, and the height channel
        that was recorded in the same direction.

    Returns
    -------
    xarray.Dataset
        ``height`` [m] and ``phase`` [degree, zero and sign as recorded] over ("y", "x"), row 0 at the top, with
        cell-centre coordinates [m]; pixels need not be square.

    Raises
    ------
    FileError
        If the file cannot be read, holds no such channel, or was not recorded in tapping mode.
    PhasemapError
        If the ``read`` extra is not installed.

    Examples
    --------
    >>> read_height_phase("scan.nid")
    Traceback (most recent call last):
    ...
    phasemap.errors.FileError: cannot read scan.nid: there is no such file.
    """
    path = Path(path)
    data = _load(path)
    mode = _mode(path, data.metadata)
    of_phase = _pick(path, data.channels.values(), phase, "phase", PHASE_NAMES, "trace")
    of_height = _pick(path, data.channels.values(), height, "height", HEIGHT_NAMES, _direction(of_phase))
    if of_phase.si_unit_z not in DEGREES:
        raise FileError(f"cannot use {path}: channel {of_phase.name!r} is in {of_phase.si_unit_z!r}, not an angle.")
    if of_height.si_unit_z != "m" or of_height.si_unit_xy != "m":
        units = f"{of_height.si_unit_z!r} over {of_height.si_unit_xy!r}"
        raise FileError(f"cannot use {path}: channel {of_height.name!r} is in {units}, not calibrated in metres.")
    if of_height.data.shape != of_phase.data.shape:
        raise FileError(
            f"cannot use {path}: {of_height.name!r} has {of_height.data.shape} pixels "
            f"but {of_phase.name!r} has {of_phase.data.shape}."
        )
    import numpy as np
    import xarray as xr

    rows, columns = of_height.data.shape
    return xr.Dataset(
        {
            "height": (("y", "x"), of_height.data, {"long_name": "recorded height", "units": "m"}),
            "phase": (
                ("y", "x"),
                of_phase.data * DEGREES[of_phase.si_unit_z],
                {"long_name": "recorded phase, zero and sign as the instrument has them", "units": "degree"},
            ),
        },
        coords={
            "y": ("y", (np.arange(rows) + 0.5) * (of_height.yreal / rows), {"units": "m"}),
            "x": ("x", (np.arange(columns) + 0.5) * (of_height.xreal / columns), {"units": "m"}),
        },
        attrs={
            "source": path.name,
            "source_sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
            "operating_mode": mode,
            "height_channel": of_height.name,
            "phase_channel": of_phase.name,
        },
    )


def segment_phase(phase: np.ndarray, n: int) -> np.ndarray:
    """Tell `n` materials apart by their phase.

    Rows are aligned first, so that drift and a tip change between two rows do not count as material; then a 3 x 3
    median filter and multi-level Otsu thresholds.

    Parameters
    ----------
    phase : array_like, shape (rows, columns)
        [degree]
    n : int
        How many materials, 2 to 4.

    Returns
    -------
    ndarray of int, shape (rows, columns)
        0 where the phase is lowest, up to n - 1.

    Raises
    ------
    InputError
        If `phase` is not a finite 2-D map, or does not hold `n` populations.

    Examples
    --------
    >>> import numpy as np
    >>> segment_phase(np.repeat([[-27.0, -7.0]], 8, axis=0).repeat(4, axis=1), 2)[0]
    array([0, 0, 0, 0, 1, 1, 1, 1])
    """
    return _align_and_segment(phase, n)[1]


def align_rows(phase: np.ndarray, n: int = 2) -> np.ndarray:
    """Remove what changes from row to row and is not material.

    A row's own median is not its offset where the share of the materials changes from row to row. So a row's offset is
    the median distance of its pixels from the level of their own population, and populations and offsets are found in
    turn.

    Parameters
    ----------
    phase : array_like, shape (rows, columns)
        [degree]
    n : int
        How many materials there are, 2 to 4.

    Returns
    -------
    ndarray, shape (rows, columns)
        [degree]; the median of the whole image is kept.

    Examples
    --------
    >>> import numpy as np
    >>> steps = np.array([0.0, 0.0, 30.0, 30.0])[:, None]
    >>> aligned = align_rows(np.array([-20.0, -20.0, 0.0, 0.0]) + steps)
    >>> bool(np.all(aligned == aligned[0]))
    True
    """
    return _align_and_segment(phase, n)[0]


def level_height(height: np.ndarray, reference: np.ndarray | None = None) -> np.ndarray:
    """Take the tilt and the row offsets out of a height image.

    Parameters
    ----------
    height : array_like, shape (rows, columns)
        [m]
    reference : array_like of bool, optional
        Pixels that are meant to be level (one material, no particles); None takes all. Rows that have none take their
        offset from their neighbours.

    Returns
    -------
    ndarray, shape (rows, columns)
        [m]; the median of the reference pixels is 0.

    Examples
    --------
    >>> import numpy as np
    >>> y, x = np.mgrid[:4, :5]
    >>> bool(np.allclose(level_height(3e-9 * x - 2e-9 * y), 0, atol=1e-20))
    True
    """
    import numpy as np

    height = _finite_map("height", height)
    if reference is None:
        reference = np.ones(height.shape, bool)
    elif reference.shape != height.shape or reference.sum() < 3:
        raise InputError(
            "shape and number of pixels in reference",
            (reference.shape, int(reference.sum())),
            f"{height.shape}, at least 3",
        )
    y, x = np.indices(height.shape)
    plane = np.stack([np.ones(height.shape), x, y], axis=-1)
    coefficients = np.linalg.lstsq(plane[reference], height[reference], rcond=None)[0]
    levelled: np.ndarray = height - plane @ coefficients
    rows = np.flatnonzero(reference.any(axis=1))
    offsets = [np.median(levelled[row, reference[row]]) for row in rows]
    levelled -= np.interp(np.arange(len(height)), rows, offsets)[:, None]
    return levelled


def _align_and_segment(phase: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Align rows and label populations, from the start that leaves the least spread within the populations."""
    import numpy as np

    phase = _finite_map("phase", phase)
    if isinstance(n, bool) or not isinstance(n, int) or not 2 <= n <= 4:
        raise InputError("number of materials", n, "2 to 4")
    otsu = _extra("skimage.filters", "telling materials apart by their phase").threshold_multiotsu
    # No start serves every image: the first fails where the scan drifts, the second where the share of the materials
    # changes from row to row, the third on slanted asymmetric stripes, whose differences have a median of their own.
    steps = np.median(np.diff(phase, axis=0), axis=1)
    starts = (np.zeros(len(phase)), np.median(phase, axis=1), np.concatenate([[0.0], np.cumsum(steps)]))
    tried = [_settle(phase - offsets[:, None], n, otsu) for offsets in starts]
    aligned, labels, _ = min(tried, key=lambda settled: settled[2])
    return aligned + (np.median(phase) - np.median(aligned)), labels


def _settle(aligned: np.ndarray, n: int, otsu: Callable[..., np.ndarray]) -> tuple[np.ndarray, np.ndarray, float]:
    """Label populations and align rows to their levels, each from the other, until the labels stay."""
    import numpy as np
    from scipy.ndimage import median_filter

    labels = np.full(aligned.shape, -1)
    for _ in range(20):  # measured images settle in 3 to 6 passes
        smooth = median_filter(aligned, 3)
        found = np.digitize(smooth, _thresholds(otsu, smooth, n))
        if np.array_equal(found, labels):
            break
        labels = found
        levels = np.array([np.median(aligned[labels == k]) if np.any(labels == k) else 0.0 for k in range(n)])
        aligned = aligned - np.median(aligned - levels[labels], axis=1, keepdims=True)
    return aligned, labels, float(np.mean(np.abs(aligned - levels[labels])))


def _thresholds(otsu: Callable[..., np.ndarray], phase: np.ndarray, n: int) -> np.ndarray:
    """Otsu's thresholds between `n` populations, from all but the most extreme pixels."""
    import numpy as np

    low, high = np.percentile(phase, [0.2, 99.8])  # else a few spikes take most of the histogram's bins
    try:
        return otsu(np.clip(phase, low, high), classes=n)
    except ValueError as error:
        values = len(np.unique(phase))
        raise InputError("number of different phases", values, f"enough to tell {n} materials apart") from error


def _finite_map(name: str, values: np.ndarray) -> np.ndarray:
    """Return `values` as a finite 2-D float array."""
    import numpy as np

    array = np.asarray(values, float)
    if array.ndim != 2 or array.size == 0:
        raise InputError(f"shape of {name}", array.shape, "(rows, columns) of a 2-D map")
    if not np.isfinite(array).all():
        row, column = np.argwhere(~np.isfinite(array))[0]
        raise InputError(name, array[row, column], "finite values", f"It is at row {row}, column {column}.")
    return array


def _extra(module: str, purpose: str) -> Any:
    """Import an optional package, or say how to install it."""
    try:
        return import_module(module)
    except ImportError as error:
        raise PhasemapError(
            f'{purpose} needs the package {module.split(".")[0]!r}: run pip install "afm-phasemap[read]".'
        ) from error


def _load(path: Path) -> Any:
    """All channels of a file, through Gwyddion's file modules."""
    if not path.is_file():
        raise FileError(f"cannot read {path}: there is no such file.")
    reader = _extra("gwyddionpy", "reading measured files")
    try:
        data = reader.load(path)
    except reader.ConverterNotFoundError as error:
        raise PhasemapError(
            'reading measured files needs the package "gwyddionpy-converter": run pip install "afm-phasemap[read]".'
        ) from error
    except (reader.GwyddionPyError, OSError, ValueError) as error:
        said = re.search(r"cannot load '.*': (.+)", str(error))
        raise FileError(f"cannot read {path}: {said[1].rstrip('.') if said else error}.") from error
    if not data.channels:
        raise FileError(f"cannot use {path}: it holds no image.")
    return data


def _mode(path: Path, metadata: dict[str, str]) -> str:
    """The operating mode as the instrument wrote it; refused if it is not tapping."""
    mode = next((metadata[key].strip() for key in MODE_KEYS if metadata.get(key, "").strip()), "not recorded")
    if mode != "not recorded" and mode.lower() not in TAPPING_MODES:
        raise FileError(f"cannot use {path}: it was recorded in the mode {mode!r}, whose phase is not a tapping phase.")
    return mode


def _pick(
    path: Path, channels: Iterable[Any], wanted: str | None, kind: str, names: tuple[str, ...], direction: str
) -> Any:
    """The channel asked for, or the first of its kind, recorded in `direction` if there is one."""
    channels = list(channels)
    listed = ", ".join(repr(channel.name) for channel in channels)
    if wanted is not None:
        for channel in channels:
            if channel.name == wanted:
                return channel
        raise FileError(f"cannot use {path}: there is no channel {wanted!r}; it holds {listed}.")
    found = [channel for channel in channels if channel.name.lower().startswith(names)]
    if not found:
        raise FileError(f"cannot use {path}: there is no {kind} channel; it holds {listed}.")
    return next((channel for channel in found if _direction(channel) == direction), found[0])


def _direction(channel: Any) -> str:
    """Return "trace" or "retrace", or "" where the file does not say."""
    said = (channel.meta.get("Line Direction") or channel.name).lower()
    if "retrace" in said or "backward" in said:
        return "retrace"
    return "trace" if "trace" in said or "forward" in said else ""
