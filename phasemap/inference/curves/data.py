"""Measured curves: amplitude and phase against frequency or distance, with their errors, checked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from phasemap._shared.arrays import real_numbers
from phasemap._shared.errors import InputError
from phasemap.sweeps.sweep import check_axis

QUANTITIES = {"amplitude": "m", "phase": "degree"}
DIRECTIONS = {"frequency": ("up", "down"), "tip_offset": ("approach", "retract")}


@dataclass(frozen=True, eq=False)
class Data:
    """Amplitudes and phases along an axis, in one direction or both."""

    axis: str  # "frequency" or "tip_offset"
    values: np.ndarray  # shape (n,) [Hz or m]
    directions: tuple[str, ...]
    # measured, errors: "amplitude" [m] and "phase" [degree], or one of them, and their standard errors
    measured: dict[str, np.ndarray]
    errors: dict[str, np.ndarray]

    @property
    def size(self) -> int:
        """How many numbers were measured."""
        return sum(part.size for part in self.measured.values())

    @property
    def spacing(self) -> float:
        """Mean step along the axis [Hz or m]."""
        return float(np.ptp(self.values)) / (len(self.values) - 1)


def check_data(axis: str, name: str, values: Any, direction: Any, given: dict[str, tuple[Any, Any]]) -> Data:
    """What was measured, as arrays.

    `name`: what the user calls its values.
    `given`: measured values and their errors of each of `QUANTITIES`, as given.
    """
    unit = "Hz" if axis == "frequency" else "m"
    along = check_axis(name, values, unit, above=0 if axis == "frequency" else -np.inf)
    allowed = DIRECTIONS[axis]
    directions = (direction,) if isinstance(direction, str) else direction
    if not isinstance(directions, (list, tuple)) or tuple(directions) not in ((allowed[0],), (allowed[1],), allowed):
        raise InputError("direction", direction, f'"{allowed[0]}", "{allowed[1]}" or {allowed}')
    one = isinstance(direction, str)
    shape = (len(along),) if one else (len(directions), len(along))
    measured, errors = {}, {}
    for quantity, (numbers, error) in given.items():
        if numbers is None:
            continue
        found = _finite(quantity, numbers, QUANTITIES[quantity])
        if found.shape != shape:
            raise InputError(quantity, f"an array of shape {found.shape}", f"one of shape {shape}, as of {name}")
        spread = _finite(f"{quantity}_error", error, QUANTITIES[quantity])
        if spread.shape not in ((), shape):
            raise InputError(f"{quantity}_error", f"an array of shape {spread.shape}", f"a number or shape {shape}")
        if not (spread > 0).all():
            raise InputError(f"{quantity}_error", float(spread.min()), f"numbers above 0 {QUANTITIES[quantity]}")
        full = (len(directions), len(along))
        measured[quantity] = found.reshape(full)
        errors[quantity] = np.broadcast_to(spread.reshape(full) if spread.shape else spread, full)
    if not measured:
        raise InputError("amplitude, phase", (None, None), "at least one of the two")
    return Data(axis, along, tuple(directions), measured, errors)


def _finite(name: str, values: Any, unit: str) -> np.ndarray:
    found = real_numbers(name, values, unit)
    bad = found[~np.isfinite(found)]
    if bad.size:
        where = f" ({bad.size} of {found.size} values)" if found.ndim else ""
        raise InputError(name, f"{values if not found.ndim else bad[0]}{where}", f"finite numbers [{unit}]")
    return found
