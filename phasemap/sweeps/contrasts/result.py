"""Result of a contrast map: its Dataset, and the recommended working point.

Wang (1999) finds the phase most sensitive where it passes 0, between the regimes, and insensitive in the attractive
one. The contrast is largest where that transition lies for one of the materials and not for the other; but right at a
transition that jumps, a small error of the amplitude changes the image. The Notes of `phasemap.contrast` say the rule.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from phasemap._kernels import columns as col
from phasemap._kernels.rows.answers import Answers
from phasemap._shared.units import say
from phasemap.results.explanation import PointMotion, lines_of
from phasemap.results.variables import FLOATS, branch_of, coded, flag_attributes, float_attributes, word_of
from phasemap.sweeps.contrasts.pair import (
    ATTRACTIVE,
    BISTABLE,
    REGIMES,
    REPULSIVE,
    Axes,
    Inversion,
    Pair,
    PhaseJump,
)  # fmt: skip

Array = np.ndarray

DIMS = ("frequency", "free_amplitude", "setpoint")
ABOUT = {
    "frequency": {"long_name": "drive frequency", "units": "Hz"},
    "free_amplitude": {"long_name": "free amplitude at resonance", "units": "m"},
    "setpoint": {"long_name": "setpoint (amplitude over free amplitude at the drive frequency)", "units": "1"},
}

MARGIN = 0.03  # in setpoint: a feedback that scans lets the amplitude err by a few percent
SHARE = 0.9  # of the largest contrast: what is left is not worth tapping harder
NOTABLE, AMPLE = 0.5, 30.0  # contrasts [degree] that barely stand out of the noise of a phase image, and by far
RULE = (
    f"Recommended is where the tip indents least among points away from jumps with a contrast of {AMPLE:g} degrees, or "
    f"{100 * SHARE:.0f} % of the largest where that is less."
)


def dataset_of_map(
    axes: Axes, names: Sequence[str], engaged: Answers, regime: Array, motion: Array, jumps: Sequence[PhaseJump],
    inversions: Sequence[Inversion],
) -> xr.Dataset:  # fmt: skip
    """Make the Dataset of a map as `phasemap.contrast` describes it, with all its dimensions, without attributes."""
    coords: dict[str, Any] = {dim: (dim, values, ABOUT[dim]) for dim, values in zip(DIMS, axes, strict=True)}
    coords["material"] = ("material", list(names), {"long_name": "material"})
    dims = ("material", *DIMS)
    both = f"{names[1]} minus {names[0]}"
    status = {"ancillary_variables": "status"}
    value = {name: FLOATS[name].value(engaged.rows) for name in ("phase", "height", "indentation", "phase_spread")}
    phase, height = (value[name][1] - value[name][0] for name in ("phase", "height"))
    data = {
        "contrast": (DIMS, phase, {"long_name": f"phase contrast, {both}", "units": "degree", **status}),
        "height_contrast": (DIMS, height, {"long_name": f"height contrast, {both}", "units": "m", **status}),
        **{name: (dims, value[name], {**float_attributes(name), **status}) for name in value},
        "regime": (dims, regime, coded("regimes in which a stable orbit holds the setpoint", *REGIMES)),
        "branch": (dims, branch_of(engaged.rows), flag_attributes("branch")),
        "motion": (dims, motion, flag_attributes("motion")),
        "status": (dims, engaged.status, flag_attributes("status")),
        "solver": (dims, engaged.solver, flag_attributes("solver")),
        **_points("inversion", "inversion of the contrast", inversions),
        **_points("jump", "jump", jumps),
    }
    degree = {"units": "degree"}
    data["inversion_phase"] = (
        "inversion", np.array([zero.phase for zero in inversions], float),
        {"long_name": "phase of both materials at the inversion", **degree},
    )  # fmt: skip
    material = np.array([jump.material for jump in jumps], np.int8)
    data["jump_material"] = ("jump", material, coded("material whose phase jumps", *names))
    for word, side in (("from", "before"), ("to", "after")):
        phases = np.array([getattr(jump, side) for jump in jumps]).reshape(-1, 2)
        its_phase, contrast = phases[np.arange(len(jumps)), material], phases[:, 1] - phases[:, 0]
        data[f"jump_{word}_contrast"] = ("jump", contrast, {"long_name": f"contrast {side} the jump", **degree})
        data[f"jump_{word}_phase"] = ("jump", its_phase, {"long_name": f"phase {side} the jump", **degree})
    inverts = np.array([jump.inverts for jump in jumps], np.int8)
    data["jump_inverts"] = ("jump", inverts, coded("whether the contrast changes its sign in the jump", "no", "yes"))
    return xr.Dataset(data, coords)


def _points(dim: str, what: str, places: Sequence[PhaseJump] | Sequence[Inversion]) -> dict[str, Any]:
    """Variables with the positions of jumps or inversions."""
    points = np.array([one.point for one in places]).reshape(-1, 3)
    return {
        f"{dim}_{name}": (dim, points[:, i], {**ABOUT[name], "long_name": f"{ABOUT[name]['long_name']} of the {what}"})
        for i, name in enumerate(DIMS)
    }


class Recommended(NamedTuple):
    """The point recommended."""

    place: tuple[int, int, int] | None  # its indices in the map, None if no point holds both materials
    sentence: str  # where it is, and why


def choose(
    axes: Axes, names: Sequence[str], engaged: Answers, regime: Array, motion: Array, jumps: Sequence[PhaseJump]
) -> Recommended:
    """Choose the point to work at, from arrays of shape (2, frequencies, free amplitudes, setpoints, ...)."""
    contrast, height = (FLOATS[name].value(engaged.rows[1] - engaged.rows[0]) for name in ("phase", "height"))
    depth = engaged.rows[..., col.INDENTATION].max(axis=0)
    known, size = np.isfinite(contrast), np.abs(contrast)
    single = known & np.isin(regime, (ATTRACTIVE, REPULSIVE)).all(0) & (motion == 0).all(0)
    distance = _distances(axes, single, jumps)
    safe = single & (distance >= MARGIN) & ~_near_jump(axes, single, jumps)
    for grade, allowed in enumerate((safe, single, known)):
        largest = size[allowed].max(initial=0.0)
        if largest >= NOTABLE:
            place = _index_of_least(np.where(allowed & (size >= min(SHARE * largest, AMPLE)), depth, np.inf))
            words = (
                f"{names[1]} minus {names[0]} is {contrast[place]:.1f} degrees",
                _regimes(names, regime[(slice(None), *place)]),
                _caution(grade, float(distance[place])),
            )
            return Recommended(place, f"{_where(axes, place)}: {', '.join(words)}")
    if not known.any():
        return Recommended(
            None, "no point of the map holds both materials; change the setpoints or the free amplitudes."
        )
    place = _index_of_least(np.where(known, -np.abs(height), np.inf))
    return Recommended(
        place,
        f"{_where(axes, place)}: the phase does not tell the materials apart (at most {size[known].max():.2g} degrees "
        f"anywhere); use the height, where {names[1]} minus {names[0]} is {say(height[place], 'm', 3)}.",
    )


def reason_of(
    pair: Pair, axes: Axes, names: Sequence[str], engaged: Answers, regime: Array, motion: Array,
    place: tuple[int, int, int],
) -> str:  # fmt: skip
    """Why the second material is brighter or darker than the first at a place of the map, in sentences."""
    frequency, free_amplitude, setpoint = (values[i] for values, i in zip(axes, place, strict=True))
    work = pair.work(frequency, free_amplitude, np.array([setpoint]))
    motions = []
    for material, name in enumerate(names):
        at = (material, *place)
        row = engaged.rows[at]
        motions.append(
            PointMotion.of(
                work.lever, float(work.amplitudes[material]), math.degrees(row[col.PHASE]), name=name, advice="",
                regime="repulsive" if col.is_repulsive(row) else "attractive", bistable=bool(regime[at] == BISTABLE),
                motion=word_of("motion", int(motion[at])), solver=word_of("solver", int(engaged.solver[at])),
                lost=float(row[col.DISSIPATION]), virial=float(row[col.VIRIAL]),
                indentation=float(row[col.INDENTATION]), tip_offset=float(row[col.TIP_OFFSET]),
            )
        )  # fmt: skip
    return " ".join(lines_of(motions[0], motions[1]))


def _index_of_least(values: Array) -> tuple[int, int, int]:
    """Indices of the smallest value."""
    frequency, free_amplitude, setpoint = np.unravel_index(int(np.argmin(values)), values.shape)
    return int(frequency), int(free_amplitude), int(setpoint)


def _distances(axes: Axes, single: Array, jumps: Sequence[PhaseJump]) -> Array:
    """Distance in setpoint of each point from the nearest jump, second regime or failure; infinite without any."""
    setpoints = axes[2]
    distance = np.full(single.shape, np.inf)
    for frequency, free_amplitude in np.ndindex(single.shape[:2]):
        here = (axes[0][frequency], axes[1][free_amplitude])
        places = [jump.point[2] for jump in jumps if (jump.point[0], jump.point[1]) == here]
        bad = np.array([*places, *setpoints[~single[frequency, free_amplitude]]])
        if len(bad):
            distance[frequency, free_amplitude] = np.abs(setpoints[:, None] - bad).min(axis=1)
    return distance


def _near_jump(axes: Axes, single: Array, jumps: Sequence[PhaseJump]) -> Array:
    """True where a jump, second regime or failure lies before the next free amplitude or frequency of the map."""
    beside = np.zeros(single.shape, bool)
    for axis in (0, 1):
        count = single.shape[axis]
        for shift in (-1, 1):
            neighbour = np.clip(np.arange(count) + shift, 0, count - 1)
            beside |= ~np.take(single, neighbour, axis)
    for jump in jumps:
        low = tuple(int(np.searchsorted(x, at, "right")) - 1 for x, at in zip(axes, jump.point, strict=True))
        high = tuple(int(np.searchsorted(x, at, "left")) for x, at in zip(axes, jump.point, strict=True))
        if low[2] == high[2]:  # on the way to a neighbour, not along the setpoint
            beside[low] = beside[high] = True
    return beside


def _where(axes: Axes, place: tuple[int, int, int]) -> str:
    """Setpoint, free amplitude and, if it varies, frequency of a place, in words."""
    frequency, free_amplitude, setpoint = (values[i] for values, i in zip(axes, place, strict=True))
    words = f"setpoint {setpoint:.3g}, free amplitude {say(free_amplitude, 'm', 3)}"
    return words + (f", drive {say(frequency, 'Hz', 6)}" if len(axes[0]) > 1 else "")


def _regimes(names: Sequence[str], regime: Array) -> str:
    """Regimes of both materials, in words."""
    words = [REGIMES[int(code)] for code in regime]
    if words[0] == words[1]:
        return f"both {words[0]}"
    return " and ".join(f"{name} {word}" for name, word in zip(names, words, strict=True))


def _caution(grade: int, distance: float) -> str:
    """Sentence on the distance of the point from a jump or second regime, and what to beware of."""
    if grade == 2:
        return "but not safe: bistable or irregular, where the phase depends on what the tip met before, or wanders."
    if np.isinf(distance):
        words = "with no jump or second regime at this free amplitude"
    else:
        words = f"{distance:.2g} in setpoint from the nearest jump or second regime"
    if grade == 0:
        return f"{words}."
    if distance < MARGIN:
        return f"{words}, which is close: hold the amplitude well."
    return f"{words}, but with one close by in free amplitude or frequency: keep the drive constant."
