"""The phase contrast between two materials, as a map."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from phasemap._kernels import columns as col
from phasemap._kernels.rows.answers import Answers
from phasemap._shared.arrays import real_numbers
from phasemap._shared.asked import asked_as
from phasemap._shared.errors import InputError
from phasemap._shared.memory import check_fits
from phasemap._shared.notices import unquestioned
from phasemap._shared.threads import Progress, spread, workers_of
from phasemap.experiment.accuracy import Accuracy
from phasemap.experiment.described import describe
from phasemap.experiment.material import Material
from phasemap.experiment.microscope import Microscope
from phasemap.results.variables import motion_of, provenance
from phasemap.solvers.continuation.path import NUMBERS
from phasemap.solvers.problem import check_setpoint
from phasemap.solvers.solver import by_name, check_marches
from phasemap.sweeps.contrasts.pair import Axes, Pair, borders, regime_of, regimes
from phasemap.sweeps.contrasts.result import DIMS, RULE, choose, dataset_of_map, reason_of
from phasemap.sweeps.sweep import SETPOINT, check_axis

Array = np.ndarray

SETPOINTS = "0.3:0.95:40"
PER_POINT = 16  # numbers of a point beside the columns of a solver, in what is recorded of it


@asked_as("The two materials come one after the other: contrast(first, second, scope), not in a dict or list.")
def contrast(
    first: Material,
    second: Material,
    scope: Microscope,
    setpoints: Any = SETPOINTS,
    free_amplitudes: Any = None,
    frequencies: Any = None,
    solver: str = "auto",
    accuracy: Accuracy | None = None,
    *,
    names: Sequence[str] = ("first", "second"),
    progress: Progress | None = None,
    threads: int | None = None,
) -> xr.Dataset:
    """Map the phase contrast between two materials, and find where it jumps, turns round and is best.

    Parameters
    ----------
    first, second : Material
        The contrast is the phase on the second less that on the first.
    scope : Microscope
    setpoints : array_like
        Amplitudes over the free one at the drive frequency, 0 to 1, rising or falling; by default 40, 0.3 to 0.95.
    free_amplitudes : float or array_like, optional
        At resonance [m]; that of `scope` by default. An array becomes a dimension.
    frequencies : float or array_like, optional
        Of the drive [Hz]; that of `scope` by default. An array becomes a dimension.
    solver, accuracy
        As in `phasemap.simulate`.
    names : sequence of str
        Of the two materials.
    progress : callable, optional
        Called as ``progress(done, total)`` from the calling thread, in points of the map; with all of them done while
        jumps and inversions are sought between them.
    threads : int, optional
        All cores by default. The numbers do not depend on it.

    Returns
    -------
    xarray.Dataset
        Dims ("frequency", "free_amplitude", "setpoint"), the first two only where an array was given; "material" leads
        where a variable belongs to one material.

        * `contrast` [degree] and `height_contrast` [m], second less first; `phase`, `height` and more of each material
          after engaging from far;
        * `regime` of each material: attractive, repulsive, or bistable where the controller can hold the setpoint in
          either, whether or not engaging from far leads there. Where contacts remember, that of engaging alone;
        * with the dim "inversion", where the contrast passes zero without a jump, and with the dim "jump", where the
          phase of a material jumps, "to" the side with the larger value of what changes. A contrast below 0.5 degree,
          which noise hides, has no sign: a map without more of either sign has no inversion. Both are sought on the
          lines between neighbours of the map, with exact orbits (with averaged ones if `solver` is "averaging"); what
          happens twice between two neighbours can be missed.

        Attributes `recommendation` and `recommendation_rule`, sentences, and `best_setpoint`, `best_free_amplitude`,
        `best_frequency` and `best_contrast`: the point to work at (see Notes), NaN if no point holds both materials.
        `reason` says why one material is brighter there. The page on the file format lists every variable.

    Notes
    -----
    Recommended is a point where each material has a single regime, with no jump, second regime or failure within 0.03
    in setpoint and on the way to neighbouring amplitudes and frequencies: of all with 0.9 of the largest contrast, or
    30 degrees, the one at which the tip indents least. Where none has 0.5 degree, the margin is given up, then the
    single regime; the sentence says so. Undamped materials differ by their regimes only (Wang 1999): see the height.

    Examples
    --------
    >>> import numpy as np, phasemap as pm
    >>> scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(30e-9))
    >>> sticky = pm.Material(modulus=0.1e9, adhesion=0.05, damping=0.01, poisson_ratio=0.45)
    >>> lossy = pm.Material(modulus=0.1e9, adhesion=0.005, damping=0.03, poisson_ratio=0.45)
    >>> found = pm.contrast(sticky, lossy, scope, np.linspace(0.4, 0.95, 12))
    >>> found.contrast.values[[0, -1]].round(1).tolist()
    [-10.5, 11.9]
    >>> found.inversion_setpoint.values.round(3).tolist()
    [0.79]
    """
    started = time.perf_counter()
    accuracy = Accuracy() if accuracy is None else accuracy
    labels = _check_names(names)
    frequencies = _given("frequencies", frequencies, "Hz")
    free_amplitudes = _given("free_amplitudes", free_amplitudes, "m")
    axes = _axes(scope, frequencies, free_amplitudes, setpoints)
    rising: Axes = (np.sort(axes[0]), np.sort(axes[1]), np.sort(axes[2]))
    pair, workers = Pair.of(first, second, scope, by_name(solver), accuracy), workers_of(threads)
    if pair.materials.in_time:
        check_marches(pair.solver.name)
    check_fits(
        f"a contrast map of {' x '.join(str(len(axis)) for axis in rising)} points",
        16.0 * math.prod(map(len, rising)) * (col.COLUMNS + PER_POINT),
        "Take fewer points.",
    )
    ds = _mapped(pair, rising, labels, workers, progress)
    falling = {dim: slice(None, None, -1) for dim, values in zip(DIMS, axes, strict=True) if values[0] > values[-1]}
    given = {"frequency": frequencies, "free_amplitude": free_amplitudes}
    ds = ds.isel(falling).isel({dim: 0 for dim, values in given.items() if np.ndim(values) == 0})
    configuration = {
        "microscope": describe(_without_axes(scope, frequencies, free_amplitudes)), "first": describe(first),
        "second": describe(second), "names": list(labels), "solver": pair.solver.name, "accuracy": describe(accuracy),
    }  # fmt: skip
    seconds = round(time.perf_counter() - started, 6)
    return ds.assign_attrs(provenance(configuration, "contrast mapped"), seconds=seconds)


def _mapped(pair: Pair, rising: Axes, labels: tuple[str, str], workers: int, progress: Progress | None) -> xr.Dataset:
    """The map over rising axes, its jumps and inversions, and where to work."""
    engaged, regime = _solve(pair, rising, workers, progress)
    points = regime[0].size

    def sought(_done: int, _total: int) -> None:
        if progress is not None:
            progress(points, points)

    jumps, inversions = borders(
        pair, rising, np.degrees(engaged.rows[..., col.PHASE]), regime_of(engaged.rows), workers, sought
    )
    motion = motion_of(engaged.rows, pair.materials.lever)
    ds = dataset_of_map(rising, labels, engaged, regime, motion, jumps, inversions)
    choice = choose(rising, labels, engaged, regime, motion, jumps)
    values, reason = [np.nan] * 4, ""
    if choice.place is not None:
        values = [
            *(axis[i] for axis, i in zip(rising, choice.place, strict=True)),
            ds["contrast"].values[choice.place],
        ]
        reason = reason_of(pair, rising, labels, engaged, regime, motion, choice.place)
    best = {f"best_{name}": float(value) for name, value in zip((*DIMS, "contrast"), values, strict=True)}
    return ds.assign_attrs(recommendation=choice.sentence, recommendation_rule=RULE, reason=reason, **best)


def _without_axes(scope: Microscope, frequencies: Any, free_amplitudes: Any) -> Microscope:
    """The microscope at the numbers that are given instead of its own; what is an axis stays as it is."""
    drive = scope.drive

    def held(given: Any, stated: float | None) -> Any:
        return stated if given is None or np.ndim(given) else float(given)

    with unquestioned():
        amplitude, frequency = held(free_amplitudes, drive.free_amplitude), held(frequencies, drive.frequency)
        return replace(scope, drive=replace(drive, free_amplitude=amplitude, frequency=frequency))


def _axes(scope: Microscope, frequencies: Any, free_amplitudes: Any, setpoints: Any) -> Axes:
    """The values along each axis of the map, in the order in which they were given."""
    drive = scope.drive
    axes = (
        _axis("frequencies", frequencies, drive.frequency or scope.cantilever.resonance_frequency, "frequency"),
        _axis("free_amplitudes", free_amplitudes, drive.free_amplitude, "free_amplitude"),
        check_axis("setpoints", setpoints, SETPOINT),
    )
    for setpoint in axes[2]:
        check_setpoint(setpoint)
    return axes


def _given(name: str, values: Any, unit: str) -> Array | float | None:
    """Values given for an axis, in `unit`: an array, a number, or None."""
    if values is None:
        return None
    numbers = real_numbers(name, values, unit)
    return numbers if numbers.ndim else float(numbers)


def _axis(name: str, values: Any, default: float, parameter: str) -> Array:
    """The values of an axis of the map, one where a number or nothing was given."""
    field = NUMBERS[parameter]
    if np.ndim(values):
        return check_axis(name, values, field)
    if values is None:
        return np.array([default])
    field.called(name).check(values)
    field.look_at(values)
    return np.array([values])


def _check_names(names: object) -> tuple[str, str]:
    """The names of the two materials."""
    allowed = "two different names"
    if isinstance(names, str) or not isinstance(names, Sequence) or len(names) != 2 or names[0] == names[1]:
        raise InputError("names", names, allowed)
    if not all(isinstance(name, str) and name for name in names):
        raise InputError("names", names, allowed)
    return names[0], names[1]


def _solve(pair: Pair, axes: Axes, workers: int, progress: Progress | None) -> tuple[Answers, Array]:
    """Orbits found by engaging at every point of the map, and regimes; shapes (2, *map, ...) and (2, *map)."""
    shape = (2, *(len(values) for values in axes))
    count = shape[3]
    engaged = Answers(np.full((*shape, col.COLUMNS), np.nan), np.zeros(shape, np.int8), np.zeros(shape, np.int8))
    regime = np.zeros(shape, np.int8)

    def solve(first: int, last: int) -> None:
        for line in range(first // count, last // count):
            i, k = divmod(line, shape[2])
            work = pair.work(axes[0][i], axes[1][k], axes[2])
            for whole, part in zip(engaged, pair.engage(work), strict=True):
                whole[:, i, k] = part
            regime[:, i, k] = regimes(work, pair.accuracy.periods).reshape(2, count) | regime_of(engaged.rows[:, i, k])

    spread(solve, range(0, shape[1] * shape[2] * count + 1, count), workers, progress)
    return engaged, regime
