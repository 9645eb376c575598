"""Pictures of the force on the tip: with the deflection over one period, and against the depth."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from phasemap._shared.asked import asked_as
from phasemap._shared.checks import numbers
from phasemap._shared.errors import InputError
from phasemap._shared.quantities import Scalar
from phasemap._shared.units import readable, say
from phasemap.plot.figure import own_axes
from phasemap.plot.page import Page
from phasemap.plot.sweep import COLOURS, is_sweep
from phasemap.results.status import Status
from phasemap.results.titles import titles

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

    Examples
    --------
    >>> import numpy as np, phasemap as pm
    >>> scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(16e-9))
    >>> axis = np.linspace(18e-9, 10e-9, 12)
    >>> ds = pm.sweep_distance(pm.Material(modulus=2e9, adhesion=0.1), scope, axis, samples=64)
    >>> [axes.get_ylabel() for axes in trace(ds, at=11e-9).axes]
    ['deflection to surface (nm)', 'force (nN)']
    """
    if not is_sweep(ds) or "trace_force" not in ds:
        raise InputError("the dataset", "without traces", "a sweep with samples=256 (--samples 256)")
    axis = str(ds["status"].dims[1])
    values, units = ds[axis].values, ds[axis].attrs["units"]
    at = float(numbers("at", at, units))
    if not values.min() <= at <= values.max():
        raise InputError("at", say(at, units), f"from {say(values.min(), units)} to {say(values.max(), units)}")
    one = ds.isel({axis: int(np.argmin(np.abs(values - at)))})
    place = f"{ds[axis].attrs['long_name']} {say(one[axis].item(), units, 5)}"
    head = titles(ds)
    head[0] = f"{place}: {head[0]}" if head else place
    words = [str(name) for name in one["direction"].values]
    states = [Status.of(int(code)) for code in one["status"].values]
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
        shown = one[f"trace_{name}"].values
        unit = readable(float(np.nanmax(np.abs(shown), initial=0.0)), one[f"trace_{name}"].attrs["units"])
        axes.axhline(0, color="0.8", linewidth=0.6, zorder=1)
        for direction in range(len(words)):
            period = np.append(shown[direction], shown[direction, :1]) / unit.size
            axes.plot(np.append(one["drive_phase"].values, 360.0), period, **_style(direction))
        axes.set_ylabel(unit.label(label), fontsize=9)
        axes.set(xlim=(0, 360), xticks=range(0, 361, 45))
        axes.tick_params(labelbottom=row == 1)
    axes.set_xlabel("phase of the drive (degrees)", fontsize=9)
    return page.finished(path, overwrite)


def _style(direction: int) -> dict[str, Any]:
    """How the line of a direction is drawn, the first wide and pale below the second."""
    return {"color": COLOURS[direction], "linewidth": WIDTHS[direction], "alpha": 0.5 if direction == 0 else 1.0}


def is_force_curve(ds: xr.Dataset) -> bool:
    """Whether a Dataset is the force against the depth."""
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

    Examples
    --------
    >>> import phasemap as pm
    >>> scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip("10 nm"), pm.Drive("20 nm"))
    >>> force(pm.force_curve(pm.Material.preset("PS"), scope)).axes[0].get_xlabel()
    'depth of the tip in the surface (nm)'
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
