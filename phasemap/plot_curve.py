"""Pictures of a sweep: every orbit there is, and what a slow sweep sees of them."""

from __future__ import annotations

import json
import os
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from phasemap.errors import InputError
from phasemap.figures import describe_failures, save
from phasemap.plot_title import titles
from phasemap.units import Unit, readable

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["curve", "holds_amplitude", "is_sweep"]

COLOURS = ("#0072B2", "#D55E00")  # of the two directions: Okabe and Ito's blue and vermilion
WIDTHS = (5.0, 2.2)  # the second direction is drawn over the first, and must not hide it [points]
ORBITS = "0.1"
FALLING = ("approach", "down")  # directions in which the axis falls
FEW = 60  # points of a sweep up to which they are not joined
FLAT = 0.02  # of a quantity's range: where it changes by less towards the far end, the tip is free
FREE_SHARE = 0.15  # of the shown axis that may be free
MARGIN = 0.05

# Sizes on the page [inch].
WIDTH, PANEL, LEFT, RIGHT, GAP, LINE, LEGEND, AXIS = 6.6, 2.3, 0.75, 0.2, 0.14, 0.17, 0.3, 0.55


def curve(
    ds: xr.Dataset,
    path: str | os.PathLike[str] | None = None,
    quantities: Sequence[str] | None = None,
    overwrite: bool = False,
) -> Figure:
    """Draw a sweep: one panel for each quantity, over the axis that is swept.

    Black lines are all the orbits that there are, solid where they are stable and dashed where they are not; circles
    are folds, where the two meet. Coloured lines are what the sweep sees in either direction, arrows are its jumps.
    Crosses at the bottom are values at which the sweep has no orbit, and a line below says why, and what helps.
    The far part of a distance curve, where nothing happens, is cut short.

    Parameters
    ----------
    ds : xarray.Dataset
        What `phasemap.sweep_distance` or another sweep returned.
    path : path-like, optional
        Where to save the picture; the suffix chooses the format (.png, .pdf, .svg and others).
    quantities : sequence of str, optional
        Names of variables, such as "dissipation" or "peak_force". By default amplitude and phase, and where a feedback
        holds the amplitude, tip offset and phase.
    overwrite : bool
        Whether an existing file may be replaced.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        If `ds` is no sweep, has not these quantities, or the format is unknown.
    FileError
        If `path` cannot be written.

    Examples
    --------
    >>> import numpy as np, phasemap as pm
    >>> scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(16e-9))
    >>> ds = pm.sweep_distance(pm.Material(modulus=2e9, adhesion=0.1), scope, np.linspace(18e-9, 10e-9, 12))
    >>> [axes.get_ylabel() for axes in curve(ds, quantities=["phase", "peak_force"]).axes]
    ['phase (degrees)', 'peak force (nN)']
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    names = _check(ds, quantities)
    sweep = _Sweep.of(ds)
    head = titles(ds)
    notes = [part for line in _notes(sweep) for part in textwrap.wrap(line, 105, subsequent_indent="   ")]
    top = 0.12 + LINE * len(head) + LEGEND
    height = top + len(names) * (PANEL + GAP) - GAP + AXIS + LINE * (len(notes) + 0.5 * bool(notes))
    figure = Figure(figsize=(WIDTH, height))
    canvas = FigureCanvasAgg(figure)
    first: Axes | None = None
    for row, name in enumerate(names):
        bottom = height - top - row * (PANEL + GAP) - PANEL
        place = (LEFT / WIDTH, bottom / height, (WIDTH - LEFT - RIGHT) / WIDTH, PANEL / height)
        axes = figure.add_axes(place, sharex=first)
        if first is None:
            first = axes
            _scale_axis(axes, sweep)
        _draw_panel(axes, sweep, name)
        axes.tick_params(labelsize=8, labelbottom=row == len(names) - 1)
    axes.set_xlabel(sweep.unit.label(str(ds[sweep.axis].attrs.get("long_name", sweep.axis))), fontsize=9)
    figure.align_ylabels()
    for i, line in enumerate(head):
        figure.text(
            LEFT / WIDTH, 1 - (0.1 + i * LINE) / height, line, fontsize=9 - bool(i), color="0.1" if i == 0 else "0.35",
            va="top",
        )  # fmt: skip
    _draw_legend(figure, sweep, ((LEFT + 0.05) / WIDTH, 1 - (top - LEGEND + 0.06) / height))
    if notes:
        lines = "\n".join(notes)
        figure.text(0.15 / WIDTH, 0.5 * LINE / height, lines, fontsize=8, color="0.25", va="bottom", linespacing=1.4)
    if path is not None:
        save(canvas, path, overwrite)
    return figure


def is_sweep(ds: xr.Dataset) -> bool:
    """Whether a Dataset is of a sweep.

    Parameters
    ----------
    ds : xarray.Dataset

    Returns
    -------
    bool
    """
    return "curve_stable" in ds and "jump_direction" in ds and "direction" in ds.coords


def holds_amplitude(ds: xr.Dataset) -> bool:
    """Whether a feedback holds the amplitude in a sweep, so that the tip offset shows what happens.

    Parameters
    ----------
    ds : xarray.Dataset

    Returns
    -------
    bool
    """
    return "setpoint" in ds.dims or "setpoint" in json.loads(ds.attrs.get("configuration", "{}"))


def _check(ds: xr.Dataset, quantities: Sequence[str] | None) -> list[str]:
    """The quantities to draw."""
    if not is_sweep(ds):
        raise InputError("the dataset", sorted(map(str, ds.data_vars)), "what a sweep such as sweep_distance returned")
    known = [str(name) for name in ds.data_vars if ds[name].dims == ds["status"].dims and f"curve_{name}" in ds]
    names = ("tip_offset" if holds_amplitude(ds) else "amplitude", "phase") if quantities is None else quantities
    if isinstance(names, str) or not names:
        raise InputError("quantities", names, "a list of " + ", ".join(known))
    for name in names:
        if name not in known or name == "branch":
            raise InputError("quantities", name, "some of " + ", ".join(known))
    return list(names)


@dataclass(frozen=True, eq=False)
class _Sweep:
    """A sweep's Dataset, with its axis in the unit that is shown.

    Parameters
    ----------
    x, points, folds : ndarray
        The axis of what the sweep saw, of all orbits and of the folds, in `unit`.
    jumps : ndarray, shape (n, 2)
        The axis before and after each jump.
    limits : tuple of float
        Of the axis, as shown.
    """

    ds: xr.Dataset
    axis: str
    unit: Unit
    x: np.ndarray
    points: np.ndarray
    folds: np.ndarray
    jumps: np.ndarray
    limits: tuple[float, float]
    logarithmic: bool

    @classmethod
    def of(cls, ds: xr.Dataset) -> _Sweep:
        axis = str(ds["status"].dims[1])
        values = ds[axis].values
        unit = readable(float(np.abs(values).max()), ds[axis].attrs["units"])
        before = ds[f"jump_{axis}"].values
        after = before.copy()
        if axis == "setpoint":  # the tip lands at once, and the feedback brings the amplitude back only then
            after = before * ds["jump_to_amplitude"].values / ds["jump_from_amplitude"].values
        steps = np.abs(np.diff(values))
        logarithmic = bool(values.min() > 0 and steps.max() > 2 * steps.min())
        return cls(
            ds, axis, unit, values / unit.size, ds[f"curve_{axis}"].values / unit.size,
            ds[f"fold_{axis}"].values / unit.size, np.stack([before, after], axis=1) / unit.size,
            _limits(ds, axis, unit.size, logarithmic), logarithmic,
        )  # fmt: skip

    @property
    def directions(self) -> list[str]:
        """Their names."""
        return [str(name) for name in self.ds["direction"].values]

    def shown(self, x: np.ndarray) -> np.ndarray:
        """Whether values of the axis are inside the limits."""
        inside: np.ndarray = (x >= self.limits[0]) & (x <= self.limits[1])
        return inside


def _limits(ds: xr.Dataset, axis: str, size: float, logarithmic: bool) -> tuple[float, float]:
    """The part of the axis to show: all of it, but little of where the tip is free."""
    x = np.sort(ds[axis].values) / size
    low, high = float(x[0]), float(x[-1])
    if axis == "tip_offset":
        order = np.argsort(ds[axis].values)
        acts = np.zeros(len(x), bool)
        for name in ("amplitude", "phase"):
            apart = np.abs(ds[name].values - ds[name].values[:, order[-1:]])[:, order]
            acts |= (apart > FLAT * np.fmax.reduce(apart, axis=None)).any(axis=0)
        if acts.any():
            last = float(x[acts].max())
            high = min(high, last + FREE_SHARE / (1 - FREE_SHARE) * (last - low))
    if logarithmic:
        return low / (high / low) ** 0.02, high * (high / low) ** 0.02
    return low - 0.03 * (high - low), high + 0.03 * (high - low)


def _draw_panel(axes: Axes, sweep: _Sweep, name: str) -> None:
    """One quantity."""
    ds = sweep.ds
    seen, all_values, fold_values = (ds[prefix + name].values for prefix in ("", "curve_", "fold_"))
    shown = np.concatenate(
        [
            seen[:, sweep.shown(sweep.x)].ravel(),
            all_values[sweep.shown(sweep.points) & (sweep.points >= sweep.x.min()) & (sweep.points <= sweep.x.max())],
            fold_values[sweep.shown(sweep.folds)],
        ]
    )
    shown = shown[np.isfinite(shown)]
    unit = readable(float(np.abs(shown).max(initial=0.0)), ds[name].attrs["units"])
    for direction, word in enumerate(sweep.directions):
        x, y = _broken(sweep, seen[direction] / unit.size, direction, word in FALLING)
        style: dict[str, Any] = {"linestyle": "-"} if len(sweep.x) > FEW else {"linestyle": "", "marker": "o"}
        size = WIDTHS[direction]
        axes.plot(
            x, y, color=COLOURS[direction], alpha=0.45 if direction == 0 else 0.9, linewidth=size, gid=f"seen {word}",
            solid_capstyle="butt", markersize=size + 2, markeredgewidth=0, zorder=2 + direction, **style,
        )  # fmt: skip
    for part, stable in _runs(sweep):
        axes.plot(
            sweep.points[part], all_values[part] / unit.size, color=ORBITS, linewidth=0.9,
            linestyle="-" if stable else (0, (4, 2.5)), zorder=4, gid="stable" if stable else "unstable",
        )  # fmt: skip
    axes.plot(sweep.folds, fold_values / unit.size, zorder=5, gid="folds", **FOLD)
    _draw_gaps(axes, sweep)
    axes.set_ylabel(unit.label(name.replace("_", " ")), fontsize=9)
    low, high = (shown.min() / unit.size, shown.max() / unit.size) if len(shown) else (0.0, 1.0)
    margin = MARGIN * (high - low) or 0.5
    axes.set_ylim(low - margin, high + margin)
    axes.ticklabel_format(axis="y", useOffset=False)
    axes.spines[["top", "right"]].set_visible(False)
    if low < 0 < high:
        axes.axhline(0, color="0.8", linewidth=0.6, zorder=1)
    _draw_jumps(axes, sweep, name, unit)


FOLD: dict[str, Any] = {
    "marker": "o", "markersize": 4.2, "markerfacecolor": "white", "markeredgecolor": ORBITS, "markeredgewidth": 0.9,
    "linestyle": "",
}  # fmt: skip


def _broken(sweep: _Sweep, y: np.ndarray, direction: int, falling: bool) -> tuple[np.ndarray, np.ndarray]:
    """What was seen in one direction, by rising axis, with a gap at each jump."""
    order = np.argsort(sweep.x)
    x, y = sweep.x[order], y[order]
    mine = sweep.ds["jump_direction"].values == direction
    at = np.searchsorted(x, sweep.jumps[mine, 0], "left" if falling else "right")
    return np.insert(x, at, np.nan), np.insert(y, at, np.nan)


def _runs(sweep: _Sweep) -> Iterator[tuple[slice, bool]]:
    """Stretches of one piece of the curve that are stable or unstable throughout; folds belong to both sides."""
    piece, stable = sweep.ds["curve_piece"].values, sweep.ds["curve_stable"].values == 1
    joined = piece[1:] == piece[:-1]
    solid = stable[1:] & stable[:-1]
    begin = 0
    for i in range(len(joined)):
        ends = i + 1 == len(joined) or not joined[i + 1] or solid[i + 1] != solid[i]
        if not joined[i]:
            begin = i + 1
        elif ends:
            yield slice(begin, i + 2), bool(solid[i])
            begin = i + 1


def _draw_jumps(axes: Axes, sweep: _Sweep, name: str, unit: Unit) -> None:
    """An arrow for each jump, with a head that is no longer than the jump, or a cross where it leads nowhere."""
    place = axes.transData.transform
    starts, ends = (_ends(sweep, word, name) / unit.size for word in ("from", "to"))
    for (x0, x1), y0, y1, direction in zip(
        sweep.jumps, starts, ends, sweep.ds["jump_direction"].values.astype(int), strict=True
    ):
        if not np.isfinite([x1, y1]).all():
            axes.plot([x0], [y0], marker="x", color=COLOURS[direction], markersize=7, zorder=6, gid="jump")
            continue
        length = 72 / axes.figure.dpi * float(np.hypot(*(place((x1, y1)) - place((x0, y0)))))  # [points]
        arrow = {
            "arrowstyle": "-|>,head_length=0.55,head_width=0.22", "color": COLOURS[direction], "linewidth": 1.3,
            "shrinkA": 0, "shrinkB": 0, "mutation_scale": min(max(1.3 * length, 3.0), 11.0),
        }  # fmt: skip
        axes.annotate("", (x1, y1), (x0, y0), arrowprops=arrow, zorder=6, annotation_clip=True, gid="jump")


def _ends(sweep: _Sweep, word: str, name: str) -> np.ndarray:
    """A quantity where jumps begin or end: as kept, or from the nearest place on the curve of all orbits."""
    ds = sweep.ds
    if f"jump_{word}_{name}" in ds:
        kept: np.ndarray = ds[f"jump_{word}_{name}"].values
        return kept
    marks = ("amplitude", "phase", "tip_offset")
    known = np.stack([*(ds[f"curve_{mark}"].values for mark in marks), sweep.points], axis=1)
    sought = np.stack([*(ds[f"jump_{word}_{mark}"].values for mark in marks), sweep.jumps[:, int(word == "to")]], 1)
    size = np.ptp(known, axis=0)
    known, sought = (values / np.where(size > 0, size, 1.0) for values in (known, sought))
    begin, step = known[:-1], np.diff(known, axis=0)
    length = np.maximum((step**2).sum(axis=1), 1e-300)
    values = ds[f"curve_{name}"].values
    found = np.full(len(sought), np.nan)
    same = ds["curve_piece"].values[1:] == ds["curve_piece"].values[:-1]
    for i in np.flatnonzero(np.isfinite(sought).all(axis=1)):
        share = np.clip(((sought[i] - begin) * step).sum(axis=1) / length, 0, 1)
        apart = ((begin + share[:, None] * step - sought[i]) ** 2).sum(axis=1)
        k = int(np.argmin(np.where(same, apart, np.inf)))
        found[i] = values[k] + share[k] * (values[k + 1] - values[k])
    return found


def _draw_gaps(axes: Axes, sweep: _Sweep) -> None:
    """Crosses at the bottom, where the sweep has no orbit."""
    for direction, status in enumerate(sweep.ds["status"].values):
        bad = sweep.x[status != 0]
        axes.plot(
            bad, np.full(len(bad), 0.03 + 0.04 * direction), transform=axes.get_xaxis_transform(), marker="x",
            linestyle="", color=COLOURS[direction], markersize=3.5, markeredgewidth=0.8, scaley=False, gid="gap",
        )  # fmt: skip


def _notes(sweep: _Sweep) -> list[str]:
    """What is missing, and why."""
    said = [f"× {line}" for line in describe_failures(sweep.ds, "points")]
    lost = int(np.isnan(sweep.ds["jump_to_amplitude"].values).sum())
    if lost:
        said.append(f"× {lost} of {len(sweep.jumps)} jumps reach no stable orbit.")
    return said


def _draw_legend(figure: Figure, sweep: _Sweep, place: tuple[float, float]) -> None:
    """One row between the titles and the first panel."""
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], color=COLOURS[i], linewidth=WIDTHS[i], alpha=0.45 if i == 0 else 0.9, label=f"{word}, jumps →")
        for i, word in enumerate(sweep.directions)
    ]
    handles += [
        Line2D([], [], color=ORBITS, linewidth=0.9, label="stable orbits"),
        Line2D([], [], color=ORBITS, linewidth=0.9, linestyle=(0, (4, 2.5)), label="unstable"),
        Line2D([], [], label="fold", **FOLD),
    ]
    figure.legend(
        handles=handles, loc="upper left", bbox_to_anchor=place, ncols=5, fontsize=8, frameon=False, borderpad=0,
        borderaxespad=0, handlelength=2.2, columnspacing=1.4,
    )  # fmt: skip


def _scale_axis(axes: Axes, sweep: _Sweep) -> None:
    """Limits and ticks of the axis that is swept."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.ticklabel_format(axis="x", useOffset=False)
    if sweep.logarithmic:
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlim(sweep.limits)
