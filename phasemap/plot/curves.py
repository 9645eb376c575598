"""Pictures of the force on the tip, over one period and against the depth; and of a measured curve, and a fit to it."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from phasemap._shared.arrays import within_half_a_turn
from phasemap._shared.asked import asked_as
from phasemap._shared.checks import numbers
from phasemap._shared.errors import InputError, Word
from phasemap._shared.quantities import Scalar
from phasemap._shared.units import readable, say
from phasemap.plot.colours import PALETTE
from phasemap.plot.page import Page, own_axes
from phasemap.plot.sweep import COLOURS, is_sweep
from phasemap.results.descriptions import titles
from phasemap.results.status import Status

WIDTHS = (3.6, 1.3)  # of the lines of the two directions [points]
WIDTH, PANEL, LEFT, RIGHT, GAP, AXIS = 6.6, 1.7, 0.75, 0.2, 0.14, 0.55  # [inch]


@asked_as()
def trace(ds: xr.Dataset, at: Scalar, path: str | os.PathLike[str] | None = None, overwrite: bool = False) -> Figure:
    """Draw deflection and force over one period of the drive, for both directions of a sweep.

    Parameters
    ----------
    ds : xarray.Dataset
        What a sweep with ``samples=`` returned.
    at : float
        Value of the axis that is swept, in its SI unit or with a unit; the nearest one is taken.
    path, overwrite
        As in `phasemap.plot.plot`.
    """
    if not is_sweep(ds) or "trace_force" not in ds:
        raise InputError("the dataset", Word("without traces"), "a sweep with samples=256 (--samples 256)")
    axis = str(ds["status"].dims[1])
    values, units = ds[axis].values, ds[axis].attrs["units"]
    at = float(numbers("at", at, units))
    if not values.min() <= at <= values.max():
        raise InputError("at", say(at, units), f"from {say(values.min(), units)} to {say(values.max(), units)}")
    nearest = ds.isel({axis: int(np.argmin(np.abs(values - at)))})
    place = f"{ds[axis].attrs['long_name']} {say(nearest[axis].item(), units, 5)}"
    head = titles(ds)
    head[0] = f"{place}: {head[0]}" if head else place
    words = [str(name) for name in nearest["direction"].values]
    states = [Status.of(int(code)) for code in nearest["status"].values]
    keys = [
        Line2D(
            [], [], **_style(direction),
            label=word if state is Status.good else f"{word}: {state.name.replace('_', ' ')}",
        )
        for direction, (word, state) in enumerate(zip(words, states, strict=True))
    ]  # fmt: skip
    page = Page(WIDTH, 2 * PANEL + GAP + AXIS, head, [keys], left=LEFT)
    for row, (name, label) in enumerate((("deflection", "deflection to surface"), ("force", "force"))):
        axes = page.panel(LEFT, row * (PANEL + GAP), WIDTH - LEFT - RIGHT, PANEL)
        shown = nearest[f"trace_{name}"].values
        unit = readable(float(np.nanmax(np.abs(shown), initial=0.0)), nearest[f"trace_{name}"].attrs["units"])
        axes.axhline(0, color="0.8", linewidth=0.6, zorder=1)
        for direction in range(len(words)):
            period = np.append(shown[direction], shown[direction, :1]) / unit.size
            axes.plot(np.append(nearest["drive_phase"].values, 360.0), period, **_style(direction))
        axes.set_ylabel(unit.label(label), fontsize=9)
        axes.set(xlim=(0, 360), xticks=range(0, 361, 45))
        axes.tick_params(labelbottom=row == 1)
    axes.set_xlabel("phase of the drive (degrees)", fontsize=9)
    return page.finished(path, overwrite)


def _style(direction: int) -> dict[str, Any]:
    """Style of the line of a direction, the first wide and pale below the second."""
    return {"color": COLOURS[direction], "linewidth": WIDTHS[direction], "alpha": 0.5 if direction == 0 else 1.0}


def is_force_curve(ds: xr.Dataset) -> bool:
    """True if a Dataset is a force curve, force against depth."""
    return "force" in ds and ds["force"].dims == ("direction", "depth")


@asked_as()
def force(
    ds: xr.Dataset, path: str | os.PathLike[str] | None = None, overwrite: bool = False, *, ax: Any = None
) -> Figure:
    """Draw a force curve: the force on the tip against its depth in the surface, for both directions.

    Parameters
    ----------
    ds : xarray.Dataset
        What `phasemap.force_curve` returned.
    path, overwrite
        As in `phasemap.plot.plot`.
    ax : matplotlib.axes.Axes, optional
        Axes of your own figure to draw in.
    """
    if not is_force_curve(ds):
        raise InputError("the dataset", sorted(map(str, ds.data_vars)), "what phasemap.force_curve returned")
    page = None
    if ax is None:
        page = Page(WIDTH, 2 * PANEL + AXIS, titles(ds), left=LEFT)
        axes = page.panel(LEFT, 0, WIDTH - LEFT - RIGHT, 2 * PANEL)
    else:
        (axes,) = own_axes(ax, ["force"], path)
    depth, unit = (readable(float(np.abs(ds[name]).max()), ds[name].attrs["units"]) for name in ("depth", "force"))
    for direction, word in enumerate(ds["direction"].values):
        values = ds["force"].values[direction] / unit.size
        axes.plot(ds["depth"] / depth.size, values, label=str(word), **_style(direction))
    axes.axhline(0, color="0.8", linewidth=0.6, zorder=1)
    axes.axvline(0, color="0.8", linewidth=0.6, zorder=1)
    axes.set_xlabel(depth.label("depth of the tip in the surface"), fontsize=9)
    axes.set_ylabel(unit.label("force, positive where repulsive"), fontsize=9)
    axes.legend(fontsize=8, frameon=False)
    return axes.get_figure(root=True) if page is None else page.finished(path, overwrite)  # type: ignore[return-value]


QUANTITIES = ("amplitude", "phase")
DOT: dict[str, Any] = {"marker": "o", "markersize": 2.5, "linestyle": "", "elinewidth": 0.6}

# Sizes on the page [inch].
ACROSS, TALL, REST, BEFORE, APART, BETWEEN, BELOW = 4.0, 2.4, 1.1, 0.75, 0.95, 0.15, 0.6


@asked_as()
def fit(ds: xr.Dataset, path: str | os.PathLike[str] | None = None, overwrite: bool = False) -> Figure:
    """Draw a measured curve, or a fit: data with their errors, what was fitted, and residuals over errors below.

    Parameters
    ----------
    ds : xarray.Dataset
        What `phasemap.read_curve` returned, or ``to_dataset()`` of a `phasemap.Fit`.
    path, overwrite
        As in `phasemap.plot.plot`.
    """
    if not is_measured_curve(ds):
        raise InputError("what is to be drawn", ", ".join(map(str, ds.data_vars)), "a measured curve, or a fit to one")
    fitted = is_fit(ds)
    names = [name for name in QUANTITIES if (f"measured_{name}" if fitted else name) in ds]
    high = TALL + (REST + BETWEEN if fitted else 0.0) + BELOW
    notes = [str(ds.attrs["fit_status"])] if fitted else str(ds.attrs.get("warnings", "")).splitlines()
    head = str(ds.attrs.get("source", "measured curve"))
    if fitted:
        chi2, law = ds.attrs["chi2"] / ds.attrs["degrees_of_freedom"], ds.attrs.get("law", "")
        head = f"Fit{' by ' if law else ''}{law}: chi2 {chi2:.3g} times the degrees of freedom"
    page = Page(len(names) * (ACROSS + APART) + 0.2, high, [head], (), notes)
    for i, name in enumerate(names):
        left = BEFORE + i * (ACROSS + APART)
        axes = page.panel(left, 0.0, ACROSS, TALL)
        below = page.panel(left, TALL + BETWEEN, ACROSS, REST, sharex=axes) if fitted else axes
        (_draw_fit if fitted else _draw_curve)(axes, below, ds, name)
        if i == 0:
            axes.legend(fontsize=8, frameon=False)
    return page.finished(path, overwrite)


def is_measured_curve(ds: xr.Dataset) -> bool:
    """True if a Dataset is a measured curve, or a fit to one."""
    return is_fit(ds) or {"distance", "amplitude"} <= set(ds.data_vars)


def is_fit(ds: xr.Dataset) -> bool:
    """True if a Dataset is a fit of a curve."""
    return "parameter_value" in ds


def _draw_curve(axes: Axes, _: Axes, ds: xr.Dataset, name: str) -> None:
    """Draw every recorded quantity of a measured curve."""
    unit = ds[name].attrs.get("units", "1")
    factor, word = (1.0, "°" if unit == "degree" else unit) if unit != "m" else (1e9, "nm")
    for colour, way in zip(PALETTE, ds["direction"].values, strict=False):
        part = ds.sel(direction=way)
        axes.plot(1e9 * part["distance"], factor * part[name], ".", markersize=2, color=colour, label=str(way))
    axes.set(xlabel="distance [nm], from an arbitrary zero", ylabel=f"recorded {name} [{word}]")


def _draw_fit(axes: Axes, below: Axes, ds: xr.Dataset, name: str) -> None:
    """Draw amplitude or phase of a fit, and its residuals below."""
    axis = next(one for one in ("tip_offset", "frequency") if one in ds.dims)
    along, of = readable(float(np.abs(ds[axis]).max()), str(ds[axis].attrs["units"])), 1e9 if name == "amplitude" else 1
    x = ds[axis].values / along.size
    for colour, way in zip(PALETTE, ds["direction"].values, strict=False):
        curve = ds.sel(direction=way)
        data, errors, model = (curve[f"{word}{name}{more}"].values for word, more in
                               (("measured_", ""), ("measured_", "_error"), ("fitted_", "")))  # fmt: skip
        if np.isnan(data).all():
            continue
        axes.errorbar(x, of * data, of * errors, color=colour, label=f"{way}, measured", **DOT)
        axes.plot(x, of * model, color=colour, linewidth=1.2, label=f"{way}, fitted")
        apart = data - model if name == "amplitude" else within_half_a_turn(data - model)
        below.plot(x, apart / errors, "o", markersize=2.5, color=colour)
    below.axhspan(-2.0, 2.0, color="0.92", zorder=0)
    below.set(xlabel=f"{axis.replace('_', ' ')} [{along.text}]", ylabel="residual\n[errors]")
    axes.set(ylabel=f"{name} [{'nm' if name == 'amplitude' else '°'}]")
    axes.tick_params(labelbottom=False)
