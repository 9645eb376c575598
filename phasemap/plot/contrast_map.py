"""Drawing of one contrast map between two materials, with its lines, hatches, words and star."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import AsinhNorm, Normalize
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke

from phasemap._shared.units import Unit
from phasemap.plot.colours import CHOSEN, FAILED, MAPS, Colours

BISTABLE = 3
HATCHES = ("//", "\\\\")  # where the first and the second are bistable
REGIMES = {1: ("attractive", "#9ecae1"), 2: ("repulsive", "#fdae6b"), 3: ("bistable", "#bdbdbd"), 0: ("none", "white")}
WIDEST = 4.0  # times the median: contrasts that differ more are shown on a scale that is compressed
LETTER, LINE = 0.034, 0.09  # half of the width of a letter and of the height of a line [inch], for labels of regions
LINES: dict[str, dict[str, Any]] = {
    "inversion": {"color": "black", "linewidth": 1.8},
    "jump": {"color": "black", "linewidth": 1.1, "linestyle": (0, (4, 2.5))},
    "regime": {"color": "0.25", "linewidth": 1.0, "linestyle": (0, (1, 1.6))},
}
BORDERS = ("inversion", "jump")  # that are found between the points of a map
STAR: dict[str, Any] = {
    "marker": "*", "markersize": 14, "markerfacecolor": "#ffe14d", "markeredgecolor": "black", "markeredgewidth": 0.9,
    "linestyle": "",
}  # fmt: skip
SMALL_STAR = {**STAR, "markersize": 10}


def draw_map(
    axes: Axes, ds: xr.Dataset, y_name: str, unit: Unit, size: tuple[float, float], norm: Any, cmap: str | None = None
) -> Any:
    """Draw a map of `phasemap.contrast` on axes of this size [inch]; returns what a colour bar shows."""
    x, y = ds["setpoint"].values, ds[y_name].values / unit.size
    edges = edges_of(x), edges_of(y)
    mesh = axes.pcolormesh(*edges, ds["contrast"].values, cmap=cmap or MAPS["contrast"], norm=norm, rasterized=True)
    axes.set_facecolor(FAILED)
    _draw_turns(axes, ds, x, y)
    for i, hatch in enumerate(HATCHES):
        _hatch(axes, edges, ds["regime"].values[i] == BISTABLE, hatch)
    for kind in BORDERS:
        here = np.ones(ds.sizes[kind], bool)
        if y_name != "frequency":
            here = ds[f"{kind}_frequency"].values == float(ds["frequency"])
        points = np.stack([ds[f"{kind}_setpoint"].values, ds[f"{kind}_{y_name}"].values / unit.size], axis=1)
        materials = ds["jump_material"].values if kind == "jump" else np.zeros(len(points))
        for material in (0, 1):
            _draw_border(axes, points[here & (materials == material)], x, y, {**LINES[kind], "gid": kind})
    star = None
    if y_name == "frequency" or ds.attrs["best_frequency"] == float(ds["frequency"]):
        best = ds.attrs["best_setpoint"], ds.attrs[f"best_{y_name}"] / unit.size
        axes.plot(*best, gid="best", zorder=7, clip_on=False, **STAR)
        star = int(np.abs(y - best[1]).argmin()), int(np.abs(x - best[0]).argmin())
    _label_regions(axes, ds, x, y, size, star)
    axes.set_xlim(edges[0].min(), edges[0].max())
    axes.set_ylim(edges[1].min(), edges[1].max())
    return mesh


def colours_of(values: np.ndarray, asked: Colours = CHOSEN) -> Any:
    """Choose a scale for contrasts [degree], symmetric about 0, compressed at its ends where a few are far larger.

    A limit that was asked for alone stands for both sides of 0.
    """
    if asked.vmin is not None and asked.vmax is not None:
        return Normalize(asked.vmin, asked.vmax)
    if end := abs(asked.vmin or asked.vmax or 0.0):
        return Normalize(-end, end)
    sizes = np.abs(values[np.isfinite(values)])
    largest = float(sizes.max(initial=0.0)) or 1.0
    middle = float(np.median(sizes)) if len(sizes) else largest
    if 0 < WIDEST * middle < largest:
        return AsinhNorm(linear_width=middle, vmin=-largest, vmax=largest)
    return Normalize(-largest, largest)


def ticks_of(norm: Any) -> list[float] | None:
    """Choose round contrasts on a compressed scale, and leave any other to matplotlib. `norm`: of `colours_of`."""
    if not isinstance(norm, AsinhNorm):
        return None
    steps = [digit * 10.0**decade for decade in range(-6, 4) for digit in (1, 3)]
    shown = [step for step in steps if 0.5 * norm.linear_width <= step <= float(norm.vmax or 0.0)]
    return [*(-step for step in reversed(shown)), 0.0, *shown]


def edges_of(centres: np.ndarray) -> np.ndarray:
    """Edges of cells around n values, one more than these."""
    middle = (centres[1:] + centres[:-1]) / 2
    return np.concatenate([[2 * centres[0] - middle[0]], middle, [2 * centres[-1] - middle[-1]]])


def keys_of(ds: xr.Dataset, names: list[str]) -> list[Any]:
    """Make the legend's entries, of what the maps have: lines, star, and one for each material that is bistable."""
    regime = ds["regime"].values
    counts = {"inversion": ds.sizes["inversion"], "jump": ds.sizes["jump"], "regime": _turns(regime).any()}
    words = {"regime": "border of regimes"}
    return [
        *(Line2D([], [], label=words.get(kind, kind), **LINES[kind]) for kind, count in counts.items() if count),
        Line2D([], [], label="recommended", **SMALL_STAR),
        *(
            Patch(facecolor="none", edgecolor="0.25", linewidth=0, hatch=hatch, label=f"{name} bistable")
            for name, hatch, mine in zip(names, HATCHES, regime, strict=True)
            if (mine == BISTABLE).any()
        ),
    ]


def _turns(regime: np.ndarray) -> np.ndarray:
    """True where a material is repulsive and a neighbouring point of the map is attractive."""
    turns = np.zeros(regime.shape, bool)
    for axis in range(1, regime.ndim):
        beside = np.sort(np.stack([regime, np.roll(regime, 1, axis)]), axis=0)
        mine = (beside[0] == 1) & (beside[1] == 2)
        turns |= mine & (np.arange(regime.shape[axis]) > 0).reshape(
            [-1 if k == axis else 1 for k in range(regime.ndim)]
        )
    return turns


def _draw_turns(axes: Axes, ds: xr.Dataset, x: np.ndarray, y: np.ndarray) -> None:
    """Draw the line on which a material changes from repulsive to attractive: at resonance its phase passes 0 there."""
    for phase, regime in zip(ds["phase"].values, ds["regime"].values, strict=True):
        one = np.isin(regime, (1, 2))
        by_phase = np.array_equal(phase[one] > 0, regime[one] == 2)  # else the line between points of the map
        known = np.where(one, phase if by_phase else regime - 1.5, np.nan)
        if min(known.shape) > 1 and _turns(regime[None]).any():
            style: dict[str, Any] = {f"{name}s": [value] for name, value in LINES["regime"].items()}
            axes.contour(x, y, known, [0.0], **style).set_gid("border")


def _hatch(axes: Axes, edges: tuple[np.ndarray, np.ndarray], where: np.ndarray, hatch: str) -> None:
    """Hatch the cells of a map that are marked."""
    x, y = edges
    cells = [[(x[i + a], y[k + b]) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))] for k, i in np.argwhere(where)]
    if cells:
        faces = PolyCollection(cells, facecolor="none", edgecolor="0.25", linewidth=0, hatch=hatch, gid="bistable")
        axes.add_collection(faces)


def _draw_border(axes: Axes, points: np.ndarray, x: np.ndarray, y: np.ndarray, style: dict[str, Any]) -> None:
    """Join points that are on the lines between neighbours of a map: each to the nearest within a cell."""
    cells: dict[tuple[int, int], list[int]] = defaultdict(list)
    scale = np.array([np.ptp(x), np.ptp(y)])
    columns, rows = np.sort(x), np.sort(y)
    for n, (a, b) in enumerate(points):
        for i in {int(np.searchsorted(columns, a, side)) - 1 for side in ("left", "right")}:
            for k in {int(np.searchsorted(rows, b, side)) - 1 for side in ("left", "right")}:
                cells[k, i].append(n)
    joined = defaultdict(set)
    for members in cells.values():
        left = list(members)
        while len(left) > 1:
            pairs = [(m, n) for m in left for n in left if m < n]
            m, n = min(pairs, key=lambda pair: float(np.linalg.norm((points[pair[0]] - points[pair[1]]) / scale)))
            joined[m].add(n)
            joined[n].add(m)
            left = [other for other in left if other not in (m, n)]
    axes.add_collection(LineCollection([points[chain] for chain in _chains(joined)], zorder=5, **style))


def _chains(joined: dict[int, set[int]]) -> list[list[int]]:
    """Walk along joined points, from ends first and then round closed lines; dashes then run on from cell to cell."""
    left = {n: set(others) for n, others in joined.items()}
    chains = []
    for begin in sorted(left, key=lambda n: (len(joined[n]) != 1, n)):
        while left[begin]:
            chain = [begin]
            while left[chain[-1]]:
                here = chain[-1]
                chain.append(left[here].pop())
                left[chain[-1]].discard(here)
            chains.append(chain)
    return chains


def _label_regions(
    axes: Axes, ds: xr.Dataset, x: np.ndarray, y: np.ndarray, size: tuple[float, float], star: tuple[int, int] | None
) -> None:
    """Say in which regimes the tip engages both materials, in the widest part of each region, clear of the star."""
    from scipy.ndimage import distance_transform_edt, label

    names = [str(name) for name in ds["material"].values]
    regime = np.where(ds["regime"].values == BISTABLE, ds["branch"].values + 1, ds["regime"].values)
    for first, second in ((1, 1), (1, 2), (2, 1), (2, 2)):
        regions, count = label((regime[0] == first) & (regime[1] == second))
        if star is not None:
            regions[star] = 0
        words = REGIMES[first][0], REGIMES[second][0]
        lines = [f"both {words[0]}"] if first == second else list(map(" ".join, zip(names, words, strict=True)))
        half = LINE * len(lines), LETTER * max(map(len, lines))
        pitch = size[1] / len(y) / half[0], size[0] / len(x) / half[1]  # of the cells on the page, in half labels
        for number in range(1, count + 1):
            room = distance_transform_edt(np.pad(regions == number, 1), sampling=pitch)[1:-1, 1:-1]
            k, i = np.unravel_index(np.argmax(room), room.shape)
            if room[k, i] > 1 + min(pitch) / 2:  # it is counted from centre to centre
                axes.text(
                    x[i], y[k], "\n".join(lines), fontsize=8, color="0.1", ha="center", va="center", zorder=6,
                    path_effects=[withStroke(linewidth=2.5, foreground="white", alpha=0.7)], gid="regime", clip_on=True,
                )  # fmt: skip
