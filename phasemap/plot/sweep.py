"""Pictures of a sweep: every orbit there is, and the orbits of a slow sweep among them."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from phasemap._shared.asked import asked_as
from phasemap._shared.errors import InputError
from phasemap._shared.units import Unit, readable
from phasemap.plot.colours import PALETTE, words_of
from phasemap.plot.page import Page, own_axes, round_numbers
from phasemap.results.descriptions import describe_failures, describe_irregular, titles
from phasemap.results.variables import phase_lag

FLAT = 0.02  # of a quantity's range: where it changes by less towards the far end, the tip is free
FREE_SHARE = 0.15  # of the shown axis that may be free


@dataclass(frozen=True, eq=False)
class Sweep:
    """A sweep's Dataset, with its axis in the unit that is shown."""

    ds: xr.Dataset
    axis: str
    unit: Unit
    # x, points, folds: the axis of what the sweep saw, of all orbits and of the folds, in `unit`
    x: np.ndarray
    points: np.ndarray
    folds: np.ndarray
    jumps: np.ndarray  # shape (n, 2); the axis before and after each jump
    limits: tuple[float, float]  # of the axis, as shown
    logarithmic: bool

    @classmethod
    def of(cls, ds: xr.Dataset) -> Sweep:
        """Make it of what `phasemap.sweep_distance` or another sweep returned."""
        axis = str(ds["status"].dims[1])
        values = ds[axis].values
        unit = readable(float(np.abs(values).max()), ds[axis].attrs["units"])
        before = ds[f"jump_{axis}"].values
        after = ds["jump_to_tip_offset"].values if axis == "tip_offset" else before
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

    @property
    def irregular(self) -> np.ndarray:
        """True where the motion is irregular, shape (directions, values)."""
        return self.ds["motion"].values == 1 if "motion" in self.ds else self.ds["status"].values < 0

    def spread(self, name: str) -> np.ndarray:
        """Standard deviation of a quantity behind the lock-in, at each point; 0 where it has none."""
        return self.ds[f"{name}_spread"].fillna(0).values if f"{name}_spread" in self.ds else np.zeros(1)

    def shown(self, x: np.ndarray) -> np.ndarray:
        """True where values of the axis are inside the limits."""
        return (x >= self.limits[0]) & (x <= self.limits[1])

    def broken(self, direction: int, falling: bool) -> np.ndarray:
        """Indices of what was seen in one direction, by rising axis, with -1 for a gap at each jump."""
        order = np.argsort(self.x)
        mine = self.ds["jump_direction"].values == direction
        return np.insert(order, np.searchsorted(self.x[order], self.jumps[mine, 0], "left" if falling else "right"), -1)

    def runs(self) -> Iterator[tuple[slice, bool]]:
        """Stretches of one piece of the curve that are stable or unstable throughout; folds belong to both sides."""
        piece, stable = self.ds["curve_piece"].values, self.ds["curve_stable"].values == 1
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

    def ends(self, name: str) -> np.ndarray:
        """A quantity where jumps begin and end, shape (n, 2); NaN in files that do not keep it."""
        unknown, ds = np.full(len(self.jumps), np.nan), self.ds
        kept = [ds[at].values if (at := f"jump_{word}_{name}") in ds else unknown for word in ("from", "to")]
        return np.stack(kept, axis=1)


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
            if last > low:
                high = min(high, last + FREE_SHARE / (1 - FREE_SHARE) * (last - low))
    if logarithmic:
        return low / (high / low) ** 0.02, high * (high / low) ** 0.02
    return low - 0.03 * (high - low), high + 0.03 * (high - low)


COLOURS = PALETTE[:2]  # of the two directions
WIDTHS = (5.0, 2.2)  # the second direction is drawn over the first, and must not hide it [points]
ORBITS = "0.1"
FALLING = ("approach", "down")  # directions in which the axis falls
THIN = (1.4, 0.8)  # likewise, where the motion is irregular
FEW = 60  # points of a sweep up to which they are not joined
RINGS = 40  # at most, along a line of more points
PHASES = ("phase", "curve_phase", "fold_phase", "jump_from_phase", "jump_to_phase")
MARGIN = 0.05

# Sizes on the page [inch].
WIDTH, PANEL, LEFT, RIGHT, GAP, AXIS = 6.6, 2.3, 0.75, 0.2, 0.14, 0.6


@asked_as()
def curve(
    ds: xr.Dataset,
    path: str | os.PathLike[str] | None = None,
    overwrite: bool = False,
    *,
    quantities: Sequence[str] | str | None = None,
    ax: Axes | Sequence[Axes] | None = None,
    lag: bool = False,
) -> Figure:
    """Draw a sweep: one panel for each quantity, over the axis that is swept.

    Black lines are all the orbits that there are, solid where they are stable and dashed where they are not; diamonds
    are folds, where the two meet. Coloured lines are what the sweep sees in either direction, arrows are its jumps.
    Rings mark irregular motion, where amplitude and phase are means; a band shows how far they are spread.
    Crosses at the bottom are values at which the sweep has no orbit, and a line below says why, and what helps.
    The far part of a distance curve, where nothing happens, is cut short.

    Parameters
    ----------
    ds : xarray.Dataset
        What `phasemap.sweep_distance` or another sweep returned.
    path, overwrite
        As in `phasemap.plot.plot`.
    quantities : str or sequence of str, optional
        Names of variables, such as "dissipation" or "peak_force". By default amplitude and phase, and where a feedback
        holds the amplitude, tip offset and phase. As third argument, where they stood, they go on for a release.
    ax : matplotlib.axes.Axes or sequence of them, optional
        Axes of your own figure to draw in, one for each quantity, without title and notes.
    lag : bool
        Whether the phase is drawn as the lag behind the drive (`phasemap.phase_lag`), 90 degrees for the free lever.
    """
    names = _check(ds, quantities)
    phases = [name for name in PHASES if lag and name in ds]
    ds = ds.assign({name: phase_lag(ds[name]).assign_attrs(units="degree", called="phase lag") for name in phases})
    sweep = Sweep.of(ds)
    keys = _keys(sweep)
    if ax is not None:
        drawn = own_axes(ax, names, path)
        for axes, name in zip(drawn, names, strict=True):
            _scale_axis(axes, sweep)
            _draw_panel(axes, sweep, name)
            _label_axis(axes, sweep)
        drawn[0].legend(handles=keys, fontsize=8, frameon=False)
        return drawn[0].get_figure(root=True)  # type: ignore[return-value]
    page = Page(WIDTH, len(names) * (PANEL + GAP) - GAP + AXIS, titles(ds), [keys], _notes(sweep), left=LEFT)
    first: Axes | None = None
    for row, name in enumerate(names):
        axes = page.place(LEFT, row * (PANEL + GAP), WIDTH - LEFT - RIGHT, PANEL, sharex=first)
        if first is None:
            first = axes
            _scale_axis(axes, sweep)
        _draw_panel(axes, sweep, name)
        axes.tick_params(labelbottom=row == len(names) - 1)
    _label_axis(axes, sweep)
    return page.finished(path, overwrite)


def _label_axis(axes: Axes, sweep: Sweep) -> None:
    """Label the axis with the swept quantity."""
    axes.set_xlabel(sweep.unit.label(str(sweep.ds[sweep.axis].attrs.get("long_name", sweep.axis))), fontsize=9)


def is_sweep(ds: xr.Dataset) -> bool:
    """True if a Dataset is of a sweep."""
    return "curve_stable" in ds and "jump_direction" in ds and "direction" in ds.coords


def _check(ds: xr.Dataset, quantities: Sequence[str] | str | None) -> list[str]:
    """Quantities to draw, of a Dataset that is a sweep."""
    if not is_sweep(ds):
        raise InputError("the dataset", sorted(map(str, ds.data_vars)), "what a sweep such as sweep_distance returned")
    dims = ds["status"].dims
    known = [str(n) for n in ds.data_vars if ds[n].dims == dims and f"curve_{n}" in ds and "units" in ds[n].attrs]
    # Where a feedback holds the amplitude, the tip offset shows what happens.
    held = "setpoint" in ds.dims or "setpoint" in json.loads(ds.attrs.get("configuration", "{}"))
    names = ("tip_offset" if held else "amplitude", "phase") if quantities is None else quantities
    if isinstance(names, str):
        names = (names,)
    if not names:
        raise InputError("quantities", names, "a list of " + ", ".join(known))
    for name in names:
        if name not in known:
            raise InputError("quantities", name, "some of " + ", ".join(known))
    return list(names)


def _draw_panel(axes: Axes, sweep: Sweep, name: str) -> None:
    """Draw one quantity."""
    ds = sweep.ds
    seen, all_values, fold_values = (ds[prefix + name].values for prefix in ("", "curve_", "fold_"))
    ends = sweep.ends(name)
    shown = np.concatenate(
        [
            (seen + sweep.spread(name))[:, sweep.shown(sweep.x)].ravel(),
            (seen - sweep.spread(name))[:, sweep.shown(sweep.x)].ravel(),
            all_values[sweep.shown(sweep.points) & (sweep.points >= sweep.x.min()) & (sweep.points <= sweep.x.max())],
            fold_values[sweep.shown(sweep.folds)],
            ends[sweep.shown(sweep.jumps) & sweep.shown(sweep.jumps[:, :1])],
        ]
    )
    shown = shown[np.isfinite(shown)]
    unit = readable(float(np.abs(shown).max(initial=0.0)), ds[name].attrs["units"])
    _draw_seen(axes, sweep, name, unit)
    for part, stable in sweep.runs():
        axes.plot(
            sweep.points[part], all_values[part] / unit.size, color=ORBITS, linewidth=0.9,
            linestyle="-" if stable else (0, (4, 2.5)), zorder=4, gid="stable" if stable else "unstable",
        )  # fmt: skip
    axes.plot(sweep.folds, fold_values / unit.size, zorder=5, gid="folds", **FOLD)
    _draw_gaps(axes, sweep)
    axes.set_ylabel(unit.label(ds[name].attrs.get("called", words_of(name))), fontsize=9)
    low, high = (shown.min() / unit.size, shown.max() / unit.size) if len(shown) else (0.0, 1.0)
    margin = MARGIN * (high - low) or 0.5
    axes.set_ylim(low - margin, high + margin)
    axes.ticklabel_format(axis="y", useOffset=False)
    axes.spines[["top", "right"]].set_visible(False)
    if low < 0 < high:
        axes.axhline(0, color="0.8", linewidth=0.6, zorder=1)
    _draw_jumps(axes, sweep, ends / unit.size)


FOLD: dict[str, Any] = {
    "marker": "D", "markersize": 4.2, "markerfacecolor": "white", "markeredgecolor": ORBITS, "markeredgewidth": 0.9,
    "linestyle": "",
}  # fmt: skip


def _draw_seen(axes: Axes, sweep: Sweep, name: str, unit: Unit) -> None:
    """Draw the orbits of the sweep in either direction, with rings and a band where the motion is irregular."""
    values = sweep.ds[name].values / unit.size
    spread = np.broadcast_to(sweep.spread(name) / unit.size, values.shape)
    step = -(-len(sweep.x) // RINGS) if len(sweep.x) > FEW else 1
    for direction, word in enumerate(sweep.directions):
        order = sweep.broken(direction, word in FALLING)
        x, y, s = (np.append(whole, np.nan)[order] for whole in (sweep.x, values[direction], spread[direction]))
        irregular = np.append(sweep.irregular[direction], False)[order]
        seen, ring = (_style(sweep, direction, hollow) for hollow in (False, True))
        axes.plot(x, np.where(irregular, np.nan, y), gid=f"seen {word}", **seen)
        rings = np.flatnonzero(irregular)[::step].tolist()
        axes.plot(x, np.where(irregular, y, np.nan), gid=f"irregular {word}", markevery=rings, **ring)
        about: dict[str, Any] = {"color": COLOURS[direction], "alpha": 0.25, "gid": f"spread {word}"}
        if len(sweep.x) > FEW:
            axes.fill_between(x, y - s, y + s, where=irregular, linewidth=0, **about)
        else:
            axes.vlines(x[irregular], (y - s)[irregular], (y + s)[irregular], linewidth=WIDTHS[direction], **about)


def _style(sweep: Sweep, direction: int, hollow: bool) -> dict[str, Any]:
    """Style of values that were seen in one direction: few as markers, many as a line."""
    size, few = WIDTHS[direction], len(sweep.x) <= FEW
    colour, alpha = COLOURS[direction], 0.45 if direction == 0 else 0.9
    style = {"color": colour, "alpha": alpha, "zorder": 2 + direction, "solid_capstyle": "butt"}
    marker = {"marker": "o", "markersize": size + 2, "markeredgewidth": THIN[direction] if hollow else 0}
    line = {"linestyle": "" if few else "-", "linewidth": THIN[direction] if hollow else size}
    return {**style, **line, **(marker if few or hollow else {}), **({"markerfacecolor": "none"} if hollow else {})}


def _draw_jumps(axes: Axes, sweep: Sweep, ends: np.ndarray) -> None:
    """An arrow for each jump, with a head that is no longer than the jump, or a cross where it leads nowhere."""
    place = axes.transData.transform
    directions = sweep.ds["jump_direction"].values.astype(int)
    for (x0, x1), (y0, y1), direction in zip(sweep.jumps, ends, directions, strict=True):
        if not sweep.shown(x0) or np.isnan(y0):
            continue
        if not np.isfinite([x1, y1]).all():
            axes.plot([x0], [y0], marker="x", color=COLOURS[direction], markersize=7, zorder=6, gid="jump")
            continue
        length = 72 / axes.figure.dpi * float(np.hypot(*(place((x1, y1)) - place((x0, y0)))))  # [points]
        arrow = {
            "arrowstyle": "-|>,head_length=0.55,head_width=0.22", "color": COLOURS[direction], "linewidth": 1.3,
            "shrinkA": 0, "shrinkB": 0, "mutation_scale": min(max(1.3 * length, 3.0), 11.0),
        }  # fmt: skip
        drawn = axes.annotate("", (x1, y1), (x0, y0), arrowprops=arrow, zorder=6, annotation_clip=False, gid="jump")
        if drawn.arrow_patch is not None:
            drawn.arrow_patch.set_clip_box(axes.bbox)  # it may end outside the range of the sweep


def _draw_gaps(axes: Axes, sweep: Sweep) -> None:
    """Crosses at the bottom, where the sweep has no orbit."""
    for direction, status in enumerate(sweep.ds["status"].values):
        bad = sweep.x[status != 0]
        axes.plot(
            bad, np.full(len(bad), 0.03 + 0.04 * direction), transform=axes.get_xaxis_transform(), marker="x",
            linestyle="", color=COLOURS[direction], markersize=3.5, markeredgewidth=0.8, scaley=False, gid="gap",
        )  # fmt: skip


def _notes(sweep: Sweep) -> list[str]:
    """Notes on missing orbits, with the reason."""
    lines = [f"○ {line}" for line in describe_irregular(sweep.ds, "points")]
    lines += [f"× {line}" for line in describe_failures(sweep.ds, "points")]
    lost = int(np.isnan(sweep.ds["jump_to_amplitude"].values).sum())
    if lost:
        lines.append(f"× {lost} of {len(sweep.jumps)} jumps reach no stable orbit.")
    return lines


def _keys(sweep: Sweep) -> list[Line2D]:
    """Keys of the legend, of what the picture has."""
    jumping = sweep.ds["jump_direction"].values[sweep.shown(sweep.jumps[:, 0])]
    stable = [stable for part, stable in sweep.runs() if sweep.shown(sweep.points[part]).any()]
    keys = [
        Line2D([], [], label=f"{word}, jumps →" if i in jumping else word, **_style(sweep, i, False))
        for i, word in enumerate(sweep.directions)
    ]
    if sweep.irregular[:, sweep.shown(sweep.x)].any():
        keys.append(Line2D([], [], label="irregular: mean", **{**_style(sweep, 1, True), "color": "0.3"}))
    if any(stable):
        keys.append(Line2D([], [], color=ORBITS, linewidth=0.9, label="stable orbits"))
    if not all(stable):
        keys.append(Line2D([], [], color=ORBITS, linewidth=0.9, linestyle=(0, (4, 2.5)), label="unstable"))
    if sweep.shown(sweep.folds).any():
        keys.append(Line2D([], [], label="fold", **FOLD))
    return keys


def _scale_axis(axes: Axes, sweep: Sweep) -> None:
    """Limits and ticks of the axis that is swept."""
    axes.ticklabel_format(axis="x", useOffset=False)
    if sweep.logarithmic:
        axes.set_xscale("log")
        round_numbers(axes.xaxis)
    axes.set_xlim(sweep.limits)
