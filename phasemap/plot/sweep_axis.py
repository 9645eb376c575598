"""A sweep as it is drawn: its axis in the unit and the range that is shown, its runs, gaps and jumps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import xarray as xr

from phasemap._shared.units import Unit, readable

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
        """That of what `phasemap.sweep_distance` or another sweep returned."""
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
        """Where the motion is, shape (directions, values)."""
        mark: np.ndarray = self.ds["motion"].values == 1 if "motion" in self.ds else self.ds["status"].values < 0
        return mark

    def spread(self, name: str) -> np.ndarray:
        """That of a quantity, in either direction; 0 where it has none."""
        spread: np.ndarray = self.ds[f"{name}_spread"].fillna(0).values if f"{name}_spread" in self.ds else np.zeros(1)
        return spread

    def shown(self, x: np.ndarray) -> np.ndarray:
        """Whether values of the axis are inside the limits."""
        inside: np.ndarray = (x >= self.limits[0]) & (x <= self.limits[1])
        return inside

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

    def ends(self, word: str, name: str) -> np.ndarray:
        """A quantity where jumps begin or end: as kept, or that of the nearest orbit or of what was seen."""
        ds = self.ds
        if f"jump_{word}_{name}" in ds:
            kept: np.ndarray = ds[f"jump_{word}_{name}"].values
            return kept
        marks = ("amplitude", "phase", "tip_offset")
        known = np.stack([*(ds[f"curve_{mark}"].values for mark in marks), self.points], axis=1)
        saw = *(ds[mark].values for mark in marks), self.x
        seen = np.stack([np.broadcast_to(values, ds["status"].shape).ravel() for values in saw])
        sought = np.stack([*(ds[f"jump_{word}_{mark}"].values for mark in marks), self.jumps[:, int(word == "to")]], 1)
        size = np.ptp(known, axis=0)
        known, seen, sought = (values / np.where(size > 0, size, 1.0) for values in (known, seen.T, sought))
        values, same = ds[f"curve_{name}"].values, np.diff(ds["curve_piece"].values) == 0
        begin, low = np.concatenate([known[:-1][same], seen]), np.append(values[:-1][same], ds[name].values.ravel())
        step, rise = np.zeros_like(begin), np.zeros_like(low)  # what was seen are points, which may be off the curve
        step[: same.sum()], rise[: same.sum()] = np.diff(known, axis=0)[same], np.diff(values)[same]
        length = np.maximum((step**2).sum(axis=1), 1e-300)
        found = np.full(len(sought), np.nan)
        for i in np.flatnonzero(np.isfinite(sought).all(axis=1)):
            share = np.clip(((sought[i] - begin) * step).sum(axis=1) / length, 0, 1)
            k = int(np.nanargmin(((begin + share[:, None] * step - sought[i]) ** 2).sum(axis=1)))
            found[i] = low[k] + share[k] * rise[k]
        return found


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
