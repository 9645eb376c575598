"""Pictures of a measured curve, and of what was fitted to it: data, fit and residuals."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from phasemap._shared.arrays import within_half_a_turn
from phasemap._shared.asked import asked_as
from phasemap._shared.errors import InputError
from phasemap._shared.units import readable
from phasemap.plot.colours import PALETTE
from phasemap.plot.page import Page

QUANTITIES = ("amplitude", "phase")
DOT: dict[str, Any] = {"marker": "o", "markersize": 2.5, "linestyle": "", "elinewidth": 0.6}

# Sizes on the page [inch].
WIDTH, PANEL, REST, LEFT, APART, GAP, AXIS = 4.0, 2.4, 1.1, 0.75, 0.95, 0.15, 0.6


@asked_as()
def fit(ds: xr.Dataset, path: str | os.PathLike[str] | None = None, overwrite: bool = False) -> Figure:
    """Draw a measured curve, or a fit: data with their errors, what was fitted, and residuals over errors below.

    Parameters
    ----------
    ds : xarray.Dataset
        What `phasemap.read_curve` returned, or ``to_dataset()`` of a `phasemap.Fit`.
    path, overwrite
        As in `phasemap.plot.plot`.

    Examples
    --------
    >>> import numpy as np, xarray as xr
    >>> z = (("direction", "point"), 1e-9 * np.arange(8.0)[None], {"units": "m"})
    >>> len(fit(xr.Dataset({"distance": z, "amplitude": z}, {"direction": ["approach"]})).axes)
    1
    """
    if not is_measured_curve(ds):
        raise InputError("what is to be drawn", ", ".join(map(str, ds.data_vars)), "a measured curve, or a fit to one")
    fitted = is_fit(ds)
    names = [name for name in QUANTITIES if (f"measured_{name}" if fitted else name) in ds]
    high = PANEL + (REST + GAP if fitted else 0.0) + AXIS
    notes = [str(ds.attrs["fit_status"])] if fitted else str(ds.attrs.get("warnings", "")).splitlines()
    head = [_title(ds)] if fitted else [str(ds.attrs.get("source", "measured curve"))]
    page = Page(len(names) * (WIDTH + APART) + 0.2, high, head, (), notes)
    for i, name in enumerate(names):
        left = LEFT + i * (WIDTH + APART)
        axes = page.panel(left, 0.0, WIDTH, PANEL)
        below = page.panel(left, PANEL + GAP, WIDTH, REST, sharex=axes) if fitted else axes
        (_draw_fit if fitted else _draw_curve)(axes, below, ds, name)
        if i == 0:
            axes.legend(fontsize=8, frameon=False)
    return page.finished(path, overwrite)


def is_measured_curve(ds: xr.Dataset) -> bool:
    """Whether a Dataset is a measured curve, or a fit to one."""
    return is_fit(ds) or {"distance", "amplitude"} <= set(ds.data_vars)


def is_fit(ds: xr.Dataset) -> bool:
    """Whether a Dataset is a fit."""
    return "parameter_value" in ds


def _title(ds: xr.Dataset) -> str:
    chi2 = ds.attrs["chi2"] / ds.attrs["degrees_of_freedom"]
    law = ds.attrs.get("law", "")
    return f"Fit{' by ' if law else ''}{law}: chi2 {chi2:.3g} times the degrees of freedom"


def _draw_curve(axes: Axes, _: Axes, ds: xr.Dataset, name: str) -> None:
    """Everything that was recorded."""
    unit = ds[name].attrs.get("units", "1")
    factor, word = (1.0, "°" if unit == "degree" else unit) if unit != "m" else (1e9, "nm")
    for colour, way in zip(PALETTE, ds["direction"].values, strict=False):
        one = ds.sel(direction=way)
        axes.plot(1e9 * one["distance"], factor * one[name], ".", markersize=2, color=colour, label=str(way))
    axes.set(xlabel="distance [nm], from an arbitrary zero", ylabel=f"recorded {name} [{word}]")


def _draw_fit(axes: Axes, below: Axes, ds: xr.Dataset, name: str) -> None:
    """One quantity with its residuals."""
    axis = next(one for one in ("tip_offset", "frequency") if one in ds.dims)
    along, of = readable(float(np.abs(ds[axis]).max()), str(ds[axis].attrs["units"])), 1e9 if name == "amplitude" else 1
    x = ds[axis].values / along.size
    for colour, way in zip(PALETTE, ds["direction"].values, strict=False):
        one = ds.sel(direction=way)
        data, errors, model = (one[f"{word}{name}{more}"].values for word, more in
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
