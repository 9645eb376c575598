"""Pictures of an image, or of what another function draws: maps, colour bars and histograms side by side."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from phasemap._shared.asked import asked_as
from phasemap._shared.errors import InputError, Word
from phasemap._shared.units import say
from phasemap.io.measured import level_plane
from phasemap.plot.colours import (
    FAILED,
    FAILED_TEXT,
    Given,
    Scale,
    by_name,
    colour_scale,
    given_colours,
    units_of,
    words_of,
)  # fmt: skip
from phasemap.plot.contrasts import contrast, is_contrast
from phasemap.plot.curves import fit, force, is_force_curve, is_measured_curve
from phasemap.plot.materials import inversion, is_inversion
from phasemap.plot.page import Page, beyond, draw_scale_bar, own_axes, side_lengths
from phasemap.plot.series import is_series, series
from phasemap.plot.side_by_side import comparison, is_comparison
from phasemap.plot.sweep import curve, is_sweep
from phasemap.results.channels import as_lag, counted_from
from phasemap.results.descriptions import (
    describe_failures,
    describe_irregular,
    describe_solvers,
    describe_validity,
    microscope_in_words,
)
from phasemap.results.quantities import OF_SECOND_MODE

LEADING = ("setpoint", "direction")  # dims that have a row for each of their values
DOT_PITCH = 6.0  # of the dots that mark pixels [points]
DOT: dict[str, Any] = {
    "marker": "o", "markersize": 2.2, "markerfacecolor": "white", "markeredgecolor": "black", "markeredgewidth": 0.5,
    "linestyle": "",
}  # fmt: skip

# Sizes on the page [inch].
WIDE, STEP, LEFT, TITLE, GAP, HISTOGRAM, AXIS = 3.5, 4.31, 0.3, 0.3, 0.06, 0.5, 0.52
LETTER = 0.075  # of the label of a colour bar [inch]
BETWEEN = "   ·   "  # two parts of a title
ACROSS = 4  # pictures side by side; more go below


@asked_as()
def plot(
    ds: xr.Dataset | xr.DataArray,
    path: str | os.PathLike[str] | None = None,
    overwrite: bool = False,
    *,
    variables: Sequence[str] | None = None,
    mark_irregular: bool = False,
    vmin: Given = None,
    vmax: Given = None,
    cmap: str | Mapping[str, str] | None = None,
    lag: bool = False,
    ax: Axes | Sequence[Axes] | None = None,
) -> Figure:
    """Draw height and phase of an image side by side, or what the function for another Dataset draws.

    Each has its colour bar, a scale bar and a histogram; colours span the 0.5 to 99.5 percentiles. A quantity has the
    same colours in every picture. Heights count from the lowest pixel, and a measured image is drawn without its
    tilt. A line on the colour bar of the phase marks 0, at resonance between attraction and repulsion, or what was
    recorded there. Pixels without a solution are green, and a line below says how many there are, why, and what helps;
    another counts the pixels in which the motion is irregular.

    Parameters
    ----------
    ds : xarray.Dataset or xarray.DataArray
        What `phasemap.simulate` or `phasemap.io.netcdf.load` returned, with ``height`` and ``phase`` over ("y", "x");
        leading dimensions "setpoint" and "direction" give rows, and ``amplitude_error`` a third column. Or a measured
        image, which may lack height or phase. Or what a sweep, `phasemap.contrast`, `phasemap.compare`,
        `phasemap.series` or `phasemap.invert` returned; or one variable of an image; or what `phasemap.force_curve`,
        `phasemap.read_curve` or ``Fit.to_dataset()`` returned.
    path : path-like, optional
        Where to save the picture; the suffix chooses the format (.png, .pdf, .svg and others).
    overwrite : bool
        Whether an existing file may be replaced.
    variables : sequence of str, optional
        Which variables to draw in place of height and phase; those of `phasemap.channels`, for instance, or of a sweep
        any of its quantities.
    mark_irregular : bool
        Whether dots mark the pixels of an image in which the motion is irregular. A sweep shows them always.
    vmin, vmax : float, or mapping of str to float, optional
        Limits of the phase, or of the first variable where there is none, in SI units or with a unit; or of several by
        name: ``{"height": "5 nm", "phase": 60}``. Of a contrast and a comparison likewise.
    cmap : str, or mapping of str to str, optional
        Colour maps of matplotlib, likewise.
    lag : bool
        Whether the phase of an image or a sweep is drawn as the lag behind the drive (`phasemap.phase_lag`): 90 degrees
        for the free lever, below 90 where the tip is repelled.
    ax : matplotlib.axes.Axes or sequence of them, optional
        Axes of your own figure to draw an image or a sweep in, one for each variable (of an image the phase alone on a
        single one), without title, histogram and notes.

    Returns
    -------
    matplotlib.figure.Figure
        A notebook shows it. With `ax`, the figure of these axes.

    Examples
    --------
    >>> import numpy as np, xarray as xr
    >>> x = ("x", 4e-9 * np.arange(8), {"units": "m"})
    >>> y = ("y", 4e-9 * np.arange(6), {"units": "m"})
    >>> hills = np.sin(np.arange(48.0)).reshape(6, 8)
    >>> ds = xr.Dataset({"height": (("y", "x"), 1e-9 * hills), "phase": (("y", "x"), 20 * hills)}, {"y": y, "x": x})
    >>> len(plot(ds, vmin=-30, vmax=30).axes)
    6
    """
    if isinstance(ds, xr.DataArray):
        name = str(ds.name or "variable")
        ds, variables = ds.to_dataset(name=name), (name,)
    colours: dict[str, Any] = {"vmin": vmin, "vmax": vmax, "cmap": cmap}
    of_images = {"variables": variables, "lag": lag or None, "mark_irregular": mark_irregular or None}
    if is_contrast(ds):
        return contrast(ds, path, overwrite, **colours, **_refused({**of_images, "ax": ax}, "a contrast"))
    if is_comparison(ds):
        return comparison(ds, path, overwrite, **colours, **_refused({**of_images, "ax": ax}, "a comparison"))
    if is_measured_curve(ds):
        return fit(ds, path, overwrite, **_refused({**colours, **of_images, "ax": ax}, "a measured curve"))
    if is_sweep(ds):
        return curve(ds, path, overwrite, quantities=variables, ax=ax, lag=lag, **_refused(colours, "a sweep"))
    if is_force_curve(ds):
        return force(ds, path, overwrite, ax=ax, **_refused({**colours, **of_images}, "a force curve"))
    for asks, draw, what in ((is_inversion, inversion, "an inversion"), (is_series, series, "a series")):
        if asks(ds):
            return draw(ds, path, overwrite=overwrite, **_refused({**colours, **of_images, "ax": ax}, what))
    on_axes = ("phase",) if np.size(np.asarray(ax, object)) == 1 else ("height", "phase")
    names = tuple(variables) if variables is not None else _usual(ds) if ax is None else on_axes
    _check(ds, names, mark_irregular)
    ds = _as_shown(ds, lag)
    asked = given_colours(**colours, variables={name: units_of(ds[name]) for name in names})
    scales = {name: colour_scale(ds[name], asked[name]) for name in names}
    if ax is not None:
        return _on_axes(ds, scales, own_axes(ax, names, path))
    return _page(ds, scales, mark_irregular).finished(path, overwrite)


def colours_for_all(
    images: Sequence[xr.Dataset], variables: Sequence[str] | None, lag: bool, given: Mapping[str, Any]
) -> list[dict[str, Any]]:
    """Colours of each image, as arguments of `plot`: those given, and else the same in all for the same values."""
    shown = [_as_shown(one, lag) for one in images]
    drawn = [tuple(variables or _usual(one)) for one in shown]
    shared = [name for name in drawn[0] if all(name in one for one in (*shown, *drawn))]
    scales = {name: [colour_scale(ds[name]) for ds in shown] for name in shared}
    limits = {
        "vmin": {name: min(one.low / one.factor for one in every) for name, every in scales.items()},
        "vmax": {name: max(one.high / one.factor for one in every) for name, every in scales.items()},
    }
    return [
        {**given, **{what: {**limits[what], **by_name(given.get(what), names)} for what in limits}} for names in drawn
    ]


def _as_shown(ds: xr.Dataset, lag: bool) -> xr.Dataset:
    """Image whose height has no tilt where it was measured, and the phase as lag where that is asked for."""
    ds = _levelled(ds)
    if "phase" not in ds:
        return ds
    free = counted_from(ds)
    if math.isfinite(free) or not {"channels", "levelled"} & set(ds.attrs):  # else it may be anywhere
        free = 90.0 if lag else free if math.isfinite(free) else 0.0
    phase = as_lag(ds)["phase"].assign_attrs(units="degree", called="phase lag") if lag else ds["phase"]
    return ds.assign(phase=phase.assign_attrs(free=free))


def _usual(ds: xr.Dataset) -> tuple[str, ...]:
    """What is drawn of an image where nothing else is asked for; a measured one may lack height or phase."""
    both = [name for name in ("height", "phase") if name in ds or "vendor_metadata" not in ds.attrs]
    return (*both, *(name for name in ("amplitude_error", *_of_second_mode(ds)) if name in ds))


def _refused(options: dict[str, Any], what: str) -> dict[str, Any]:
    """Refuse options that this picture has nothing of; returns no arguments."""
    for name, value in options.items():
        if value is not None:
            given = Word("given") if name == "ax" else str(value)
            raise InputError(name, given, f"nothing where {what} is drawn")
    return {}


def _on_axes(ds: xr.Dataset, scales: dict[str, Scale], panels: Sequence[Axes]) -> Figure:
    """Draw one image on axes of the user's, whose figure is left to them."""
    if several := [dim for dim in LEADING if dim in ds.dims]:
        hint = f"Take one: image.isel({several[0]}=0)."
        given = Word(f"several images, along {several[0]}")
        raise InputError("the dataset", given, "one image where ax is given", hint)
    for axes, (name, scale) in zip(panels, scales.items(), strict=True):
        shown = _draw_image(axes, ds, name, scale)
        axes.set(xticks=[], yticks=[], aspect="equal")
        axes.figure.colorbar(shown, ax=axes, label=scale.label, extend=beyond([shown]))
    figure: Figure = panels[0].figure  # type: ignore[assignment]
    return figure


def _page(ds: xr.Dataset, scales: dict[str, Scale], mark_irregular: bool) -> Page:
    """Page with all maps of an image."""
    rows = list(_rows(ds))
    length = side_lengths(ds)
    tall = WIDE * min(max(length[1] / length[0], 0.2), 2.0)
    step = TITLE + tall + GAP + HISTOGRAM + AXIS
    notes = [(f"○ {line}" if mark_irregular else line, "0.25") for line in describe_irregular(ds)]
    notes += [(f"△ {line}", "0.25") for line in describe_validity(ds)]
    notes += [(f"■ {line}", FAILED_TEXT) for line in describe_failures(ds)]
    lines = -(-len(scales) // ACROSS)
    across = -(-len(scales) // lines)
    page = Page(LEFT + STEP * across, len(rows) * lines * step, _titles(ds), notes=notes, left=LEFT)
    for row, (words, image) in enumerate(rows):
        for number, (name, scale) in enumerate(scales.items()):
            line, column = divmod(number, across)
            left, top = LEFT + column * STEP, (row * lines + line) * step + TITLE
            called = words_of(name)
            title = ", ".join([called[0].upper() + called[1:], *words])
            picture = page.picture(left, top, WIDE, tall, title)
            if not np.isfinite(image[name].values).any():
                picture.text(0.5, 0.5, "no value in any pixel", ha="center", transform=picture.transAxes)
                picture.set_facecolor("0.95")
                continue
            label = scale.label if LETTER * len(scale.label) <= tall else ""  # the histogram has it too
            bar = page.bar(_draw_image(picture, image, name, scale), [picture], label)
            free = image[name].attrs.get("free", 0.0)
            if name == "phase" and scale.low < free < scale.high:
                bar.ax.axhline(free, color="white", linewidth=1.2)
            if mark_irregular:
                _mark(picture, image["motion"].values == 1, (WIDE, tall))
            below = page.panel(left, top + tall + GAP, WIDE, HISTOGRAM)
            _draw_histogram(below, scale.shown(image[name].values), scale)
    return page


def _of_second_mode(ds: xr.Dataset) -> tuple[str, ...]:
    """What a driven second mode shows."""
    drive = json.loads(ds.attrs.get("configuration", "{}")).get("microscope", {}).get("drive", {})
    return OF_SECOND_MODE[second["detection"]] if (second := drive.get("second")) else ()


def _rows(ds: xr.Dataset) -> Iterator[tuple[list[str], xr.Dataset]]:
    """The images of a Dataset, with what is said of each."""
    dims = [dim for dim in LEADING if dim in ds.dims]
    for place in np.ndindex(*(ds.sizes[dim] for dim in dims)):
        image = ds.isel(dict(zip(dims, place, strict=True)))
        forms = {"setpoint": "setpoint {:g}", "direction": "{}"}
        yield [forms[dim].format(image[dim].item()) for dim in dims if dim in image.coords], image


def _levelled(ds: xr.Dataset) -> xr.Dataset:
    """Measured image without its tilt; any other image as it is."""
    if "channels" not in ds.attrs or "height" not in ds:
        return ds
    maps = ds["height"].values.reshape(-1, ds.sizes["y"], ds.sizes["x"])
    flat = [level_plane(one, counts) if (counts := np.isfinite(one)).sum() > 2 else one for one in maps]
    height = ds["height"].copy(data=np.reshape(flat, ds["height"].shape)).assign_attrs(levelled="by a plane")
    return ds.assign(height=height)


def _check(ds: xr.Dataset, names: tuple[str, ...], mark_irregular: bool) -> None:
    """Refuse what is not an image, or does not have what is to be drawn or marked."""
    held = sorted(str(key) for key, one in ds.data_vars.items() if one.dtype.kind == "f")
    if not names:
        raise InputError("variables", Word("none"), f"some of {', '.join(held)}")
    for name in names:
        if name not in ds:
            raise InputError("the dataset", held, f"an image with {' and '.join(names)}")
        if name not in held:
            raise InputError("variables", Word(f"{name}, a map of codes"), f"maps of numbers: {', '.join(held)}")
        dims = ds[name].dims
        if "sample" in dims:
            found = Word(f"an ensemble of {ds.sizes['sample']} images")
            raise InputError("the dataset", found, "one of them (--sample N)")
        if dims[-2:] != ("y", "x") or not set(dims[:-2]) <= set(LEADING):
            raise InputError(f"dims of {name}", dims, "('y', 'x'), alone or after 'direction' or 'setpoint'")
    for dim in ("y", "x"):
        if dim not in ds.coords:
            raise InputError("the dataset", Word("without coordinates"), f"an image with a coordinate {dim} [m]")
        if not ds.sizes[dim]:
            raise InputError(f"number of pixels along {dim}", 0, "at least 1")
    if mark_irregular and "motion" not in ds:
        raise InputError("the dataset", Word("without motion"), "an image with it, to mark irregular pixels")


def _draw_image(axes: Axes, ds: xr.Dataset, name: str, scale: Scale) -> Any:
    """Draw one channel with its scale bar and the pixels that failed."""
    from scipy.ndimage import maximum_filter

    width, height = side_lengths(ds)
    extent = (0.0, width, height, 0.0)  # row 0 at the top
    shown = scale.shown(ds[name].values)
    image = axes.imshow(shown, cmap=scale.cmap, norm=scale.norm, extent=extent, aspect="auto")
    failed = ds["status"].values != 0 if "status" in ds else ~np.isfinite(shown)
    if failed.any():
        grown = maximum_filter(failed, max(failed.shape) // 128 or 1)  # one pixel in a thousand must still be seen
        overlay = np.ma.masked_where(~grown, np.ones(failed.shape))
        axes.imshow(overlay, cmap=ListedColormap([FAILED]), extent=extent, aspect="auto", interpolation="nearest")
    draw_scale_bar(axes)
    return image


def _mark(axes: Axes, marked: np.ndarray, size: tuple[float, float]) -> None:
    """Dots on the pixels that are marked, as many as can be told apart on a picture of this width and height [inch]."""
    from scipy.ndimage import maximum_filter

    ny, nx = marked.shape
    across, down = (max(round(72 * side / DOT_PITCH), 1) for side in size)
    middle = [((np.arange(count) + 0.5) * n / count).astype(int) for count, n in ((down, ny), (across, nx))]
    dotted = marked[np.ix_(*middle)]  # a dot in the middle of each cell of the page
    rows, columns = np.nonzero(marked)
    cells = rows * down // ny, columns * across // nx
    lone = np.flatnonzero(~maximum_filter(dotted, 3)[cells])  # and where that leaves pixels far from any dot
    first = lone[np.unique((cells[0] * across + cells[1])[lone], return_index=True)[1]]
    rows, columns = (
        np.append(mid[at], more)
        for mid, at, more in zip(middle, np.nonzero(dotted), (rows[first], columns[first]), strict=True)
    )
    x, y = (columns + 0.5) / nx, 1 - (rows + 0.5) / ny
    axes.plot(x, y, transform=axes.transAxes, scalex=False, scaley=False, gid="irregular", **DOT)


def _draw_histogram(axes: Axes, shown: np.ndarray, scale: Scale) -> None:
    """Draw how often each value occurs, in the colours of the image."""
    counts, edges = np.histogram(shown[np.isfinite(shown)], bins=100, range=(scale.low, scale.high))
    centres = 0.5 * (edges[1:] + edges[:-1])
    edge: dict[str, Any] = {"edgecolor": "0.25", "linewidth": 0.25}
    axes.bar(centres, counts, width=np.diff(edges), color=scale.cmap(scale.norm(centres)), **edge)
    axes.set(xlim=(scale.low, scale.high), yticks=[])
    axes.set_xlabel(scale.label, fontsize=9)
    axes.spines["left"].set_visible(False)


def _as_recorded(attrs: Mapping[Any, Any]) -> dict[str, Any]:
    """What a file recorded of lever, drive and scan, in the form of a ``configuration``."""
    lever = {name: attrs.get(name) for name in ("stiffness", "resonance_frequency", "quality_factor")}
    drive = {"free_amplitude": attrs.get("free_amplitude"), "frequency": attrs.get("drive_frequency")}
    scan = {"control": {name: attrs[name] for name in ("line_rate",) if name in attrs}}
    ratio = {name: attrs[name] for name in ("setpoint",) if name in attrs}
    return {
        **ratio,
        **scan,
        "microscope": {"cantilever": lever, "tip": {"radius": attrs.get("tip_radius")}, "drive": drive},
    }


def _titles(ds: xr.Dataset) -> list[str]:
    """File, setpoint, solvers and size, and the microscope, a line each, as far as the dataset says them."""
    configuration = json.loads(ds.attrs.get("configuration", "{}")) or _as_recorded(ds.attrs)
    scan = [ds.attrs["source"]] if "vendor_metadata" in ds.attrs else []
    if "setpoint" in configuration:
        setpoints = ds.coords.get("setpoint", configuration["setpoint"]) if "setpoint" not in ds.dims else []
        scan += [f"setpoint {one:g}" for one in np.atleast_1d(setpoints)]
    elif volts := ds.attrs.get("setpoint_voltage"):
        scan.append(f"setpoint {say(volts, 'V')}")
    if "solver" in ds:
        scan.append("solved by " + describe_solvers(ds["solver"]))
    if "line_rate" in (control := configuration.get("control", {})):
        scan.append(f"line rate {control['line_rate']:g} Hz")
    scan.append(f"{ds.sizes['x']} × {ds.sizes['y']} pixels")
    scope = microscope_in_words(configuration.get("microscope", {}))
    return [BETWEEN.join(line) for line in (scan, scope) if line]
