"""Sweeps from the objects of the user to a Dataset: along curves of orbits, or in time where none can be followed.

The Dataset has the variables in both directions, the curves behind them, folds and jumps.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from phasemap._kernels import columns as col
from phasemap._kernels.orbits.collocation.path import fixed_path
from phasemap._shared.errors import InputError
from phasemap.experiment.described import describe
from phasemap.experiment.lever import rows_as_seen
from phasemap.experiment.microscope import Microscope
from phasemap.results.status import Status
from phasemap.results.variables import STABILITY, coded, flag_attributes, of_rows, provenance
from phasemap.solvers.continuation.curves import Curves
from phasemap.solvers.continuation.path import MATERIAL, UNITS, Question, Spacing, path_of, path_over
from phasemap.solvers.continuation.visit import (
    Jump,
    OffOrbit,
    Segment,
    SlowFeedback,
    TipPlace,
    Visit,
    far_state,
    move_in_time,
    segment_through,
    stable_rows,
    stable_segments,
    visit_values,
)
from phasemap.solvers.continuation.whole_curves import distance_curves, held_curves, swept_curves
from phasemap.solvers.problem import Work, longest_memory

NAMES = (
    "amplitude", "phase", "height", "tip_offset", "mean_deflection", "indentation", "dissipation", "virial",
    "mean_force", "peak_force", "least_force", "contact_time", "floquet", "multiplier_real", "multiplier_imag",
    "feedback_slope", "energy_closure", "amplitude_spread", "phase_spread", "branch",
    "motion",
)  # fmt: skip
Variables = dict[str, tuple[Any, Any, dict[str, Any]]]
HARMONICS = np.arange(2, 2 + col.HARMONICS)

At = Callable[[int], tuple[Work, float]]
"""Work, and tip offset or amplitude [m], of a value by its number."""


@dataclass(frozen=True, eq=False)
class Axis:
    """Swept quantity: name, values in the order asked for, unit, long name, directions, column of the full rows.

    With `held` a feedback holds the amplitude, and must be stable too. `fold` is the kind of row at which the axis
    turns, and `value` makes values of the axis from its column.
    """

    name: str
    values: np.ndarray
    units: str
    long_name: str
    directions: tuple[str, str]
    column: int = col.TIP_OFFSET
    held: bool = False
    fold: int = col.FOLD
    value: Callable[[np.ndarray], np.ndarray] = lambda x: x


def dataset(
    curves: Curves, axis: Axis, visits: list[Visit], question: Question, held: dict[str, Any] | None = None,
    levers: np.ndarray | None = None,
) -> xr.Dataset:  # fmt: skip
    """Make the Dataset of a sweep; what is `held` is for the provenance.

    `levers`: of the values in rising order, shape (n, ...), or of all; by default those of the curves.
    """
    order = np.argsort(np.argsort(axis.values))  # the kernels had the values in rising order
    rows = np.stack([visit.rows for visit in visits])
    rows = (curves.seen(rows) if levers is None else rows_as_seen(rows, levers))[:, order]
    dims = ("direction", axis.name)
    data = _variables("", rows, dims, axis.name)
    status = np.stack([visit.status[order] for visit in visits]).astype(np.int8)
    data["status"] = (dims, status, flag_attributes("status"))
    data |= _curve(curves, axis)
    data |= _jumps(curves, [jump for visit in visits for jump in visit.jumps], axis)
    coordinates: Variables = {
        "direction": ("direction", list(axis.directions), {"long_name": "direction of the sweep"}),
        axis.name: (axis.name, axis.values, {"long_name": axis.long_name, "units": axis.units}),
        "harmonic": ("harmonic", HARMONICS, {"long_name": "number of the harmonic", "units": "1"}),
    }
    if curves.samples:
        data |= _traces(np.stack([visit.traces[order] for visit in visits]), dims)
        steps = np.arange(curves.samples) / curves.samples * 360
        coordinates["drive_phase"] = ("drive_phase", steps, {"long_name": "phase of the drive", "units": "degree"})
    about = {"material": describe(question.material), "microscope": describe(question.scope)}
    configuration = {**about, "sweep": axis.name, **(held or {})}
    return xr.Dataset(data, coordinates, provenance(configuration, f"{axis.long_name} swept"))


def _variables(prefix: str, rows: np.ndarray, dims: tuple[str, ...], axis: str) -> Variables:
    """Variables of a Dataset, from full rows."""
    data = of_rows(rows, (name for name in NAMES if prefix or name != axis), dims, prefix)
    amplitudes = rows[..., col.HARMONIC : col.HARMONIC + col.HARMONICS]
    attributes = {"long_name": "amplitude of a harmonic of the deflection", "units": "m"}
    return {**data, prefix + "harmonics": ((*dims, "harmonic"), amplitudes, attributes)}


def _traces(traces: np.ndarray, dims: tuple[str, ...]) -> Variables:
    """Deflection and force over a period of the drive."""
    words = (("trace_deflection", "deflection over a period", "m"), ("trace_force", "surface force over a period", "N"))
    return {
        name: ((*dims, "drive_phase"), traces[..., i, :], {"long_name": long_name, "units": units})
        for i, (name, long_name, units) in enumerate(words)
    }


def _curve(curves: Curves, axis: Axis) -> Variables:
    """The complete curve and its folds."""
    pieces, data = curves.pieces, Variables()
    rows = curves.seen(np.concatenate([piece.rows for piece in pieces]) if pieces else np.zeros((0, col.FULL)))
    number = np.repeat(np.arange(len(pieces), dtype=np.int32), [len(piece.rows) for piece in pieces])
    for prefix, dim, part in (("curve_", "point", slice(None)), ("fold_", "fold", rows[:, col.KIND] == axis.fold)):
        chosen = rows[part]
        data |= _variables(prefix, chosen, (dim,), axis.name)
        if axis.name not in NAMES:
            attributes = {"long_name": axis.long_name, "units": axis.units}
            data[prefix + axis.name] = (dim, axis.value(chosen[:, axis.column]), attributes)
        data[prefix + "piece"] = (dim, number[part], {"long_name": "number of the connected piece"})
    flags = stable_rows(rows, axis.held) | (rows[:, col.KIND] == axis.fold)
    data["curve_stable"] = ("point", flags.astype(np.int8), coded("stability of the orbit", *STABILITY))
    return data


def _jumps(curves: Curves, jumps: list[Jump], axis: Axis) -> Variables:
    """Variables of the jumps of a sweep: values, directions, and orbits before and after."""
    nothing = np.full(col.FULL, np.nan)
    ends = [jump.before for jump in jumps], [nothing if jump.after is None else jump.after for jump in jumps]
    before, after = (curves.seen(np.array(side).reshape(len(jumps), col.FULL)) for side in ends)
    attributes = {"long_name": axis.long_name + " at the jump", "units": axis.units}
    codes = np.array([jump.direction for jump in jumps], np.int8)
    data: Variables = {
        "jump_" + axis.name: ("jump", axis.value(before[:, axis.column]), attributes),
        "jump_direction": ("jump", codes, coded("direction of the sweep that jumps", *axis.directions)),
    }
    for word, side in (("from", before), ("to", after)):
        data |= of_rows(side, NAMES, "jump", f"jump_{word}_")
    return data


def distance(question: Question, axis: np.ndarray, samples: int) -> xr.Dataset:
    """`phasemap.sweep_distance`."""
    about, wanted = Axis("tip_offset", axis, "m", "tip offset", ("approach", "retract")), np.sort(axis)
    if question.only_in_time:
        _check_no_samples(samples)
        work = question.work(marched=True)
        return _dataset_in_time(question, [work], about, there_and_back(work, wanted))
    curves = distance_curves(path_of(question), wanted, samples)
    parts = stable_segments(curves)
    above = (part for part in parts if part.row_at(wanted[-1]) is not None)  # on the curve from far
    first = next(above, None) or OffOrbit(state=far_state(curves.oscillator_at(0.0), wanted[-1]))
    approach = visit_values(curves, first, parts, True, 0)
    retract = visit_values(curves, approach.ended, parts, False, 1)
    return dataset(curves, about, [approach, retract], question)


def setpoint(question: Question, axis: np.ndarray, samples: int) -> xr.Dataset:
    """`phasemap.sweep_setpoint`."""
    free, n = question.scope.driven_amplitude, len(axis)
    wanted, falling = np.sort(axis) * free, range(n - 1, -1, -1)
    about = Axis("setpoint", axis, "1", "setpoint", ("down", "up"), col.AMPLITUDE, True, col.TURN, lambda x: x / free)
    if question.only_in_time:
        _check_no_samples(samples)
        work = question.work(marched=True)
        state = far_state(work.oscillator(0))
        visits = [_visit_in_time(state, order, lambda k: (work, wanted[k]), True, n) for order in (falling, range(n))]
        return _dataset_in_time(question, [work], about, visits)
    feedback = SlowFeedback(held_curves(path_of(question), wanted, samples))
    down, place = _hold(feedback, feedback.far(), falling, 0)
    up, _ = _hold(feedback, place, range(n), 1)
    return dataset(feedback.curves, about, [down, up], question)


def parameter(
    question: Question, name: str, axis: np.ndarray, ratio: float | None, height: float, samples: int
) -> xr.Dataset:
    """`phasemap.sweep_parameter` and `phasemap.sweep_frequency`: with this setpoint held, or else this tip offset."""

    def held_under(changed: Microscope) -> float:
        return height if ratio is None else ratio * changed.driven_amplitude

    scale, of_amplitude = Spacing.over(axis), ratio is not None
    directions, words = ("up", "down"), name.replace("_", " ")
    about = Axis(name, axis, UNITS[name], words, directions, col.PARAMETER, of_amplitude, value=scale.value)
    held: dict[str, float | None] = {"setpoint": ratio} if of_amplitude else {"tip_offset": height}
    values = np.sort(axis).tolist()
    laws = values if name in MATERIAL else values[:1]  # what changes the lever or the drive leaves the contact as it is
    if any(question.with_parameter(name, value).only_in_time for value in laws):
        _check_no_samples(samples)
        every = [question.with_parameter(name, value) for value in values]
        works, n = [one.work(marched=True) for one in every], len(axis)
        most = longest_memory(work.law for work in works)
        visits = [  # each direction is begun far above the surface
            _visit_in_time(
                far_state(works[order[0]].oscillator(0), height, most), order,
                lambda k: (works[k], held_under(every[k].scope)), of_amplitude, n,
            )
            for order in (range(n), range(n - 1, -1, -1))
        ]  # fmt: skip
        return _dataset_in_time(question, works, about, visits, held)
    wanted, path = np.sort(scale.m(axis)), path_over(question, name, scale, held_under, of_amplitude)
    curves = swept_curves(path, wanted, samples)
    visits = _sweep_at_offset(curves, height) if ratio is None else _sweep_held(curves, question, name, scale, ratio)
    return dataset(curves, about, visits, question, held)


def _hold(feedback: SlowFeedback, place: TipPlace, order: range, direction: int) -> tuple[Visit, TipPlace]:
    """Hold one amplitude after the other."""
    curves = feedback.curves
    n = len(curves.wanted)
    rows, traces = np.full((n, col.FULL), np.nan), np.full((n, 2, curves.samples), np.nan)
    status, jumps = np.full(n, Status.no_stable_orbit.code, np.int8), list[Jump]()
    for k in order:
        held = feedback.move_to_wanted(place, k, direction)
        status[k] = held.status
        if held.jump is not None:
            if jumps and jumps[-1].after is None and np.array_equal(jumps[-1].before, held.jump.before, equal_nan=True):
                jumps.pop()  # a jump that led to nothing at the value before, and goes on from there
            jumps.append(held.jump)
        if held.place is not None and held.row is not None:
            place, rows[k] = held.place, held.row
            traces[k] = np.nan if held.trace is None else held.trace
    return Visit(rows, traces, status, jumps), place


def _sweep_at_offset(curves: Curves, height: float) -> list[Visit]:
    """Sweeps up and down at a fixed tip offset [m], each begun on the orbit that stays farthest from the surface."""
    parts, visits = stable_segments(curves), []
    for direction, x in enumerate((curves.wanted[0], curves.wanted[-1])):
        reached_rows = [(part.row_at(x), part) for part in parts]
        reached = [(float(row[col.INDENTATION]), i) for i, (row, _) in enumerate(reached_rows) if row is not None]
        far = OffOrbit(state=far_state(curves.oscillator_at(x), height))
        first: Segment | OffOrbit = reached_rows[min(reached)[1]][1] if reached else far
        visits.append(visit_values(curves, first, parts, direction == 1, direction))
    return visits


def _sweep_held(curves: Curves, question: Question, name: str, scale: Spacing, ratio: float) -> list[Visit]:
    """Sweeps up and down with the setpoint held, each begun by engaging from far."""
    parts = stable_segments(curves, held=True)

    def landing(edge: np.ndarray, m: float) -> Segment | OffOrbit:
        """The feedback moves the tip, at the new value of the parameter, until the amplitude is back."""
        return engaged(m, edge) or OffOrbit(edge)

    def engaged(m: float, edge: np.ndarray | None = None) -> Segment | OffOrbit | None:
        """Orbit on which the feedback holds the setpoint, coming from an orbit or from far."""
        here = question.with_parameter(name, float(scale.value(m)))
        feedback = SlowFeedback(held_curves(path_of(here), np.array([ratio * here.scope.driven_amplitude]), 0))
        place = feedback.far() if edge is None else feedback.nearest(edge)
        held = feedback.move_to_wanted(place, 0, 0)
        if held.place is None or held.row is None:
            return None
        return held.place.on if isinstance(held.place.on, OffOrbit) else segment_through(parts, m, held.row)

    visits = []
    for direction, x in enumerate((curves.wanted[0], curves.wanted[-1])):
        first = engaged(float(x))
        visits.append(visit_values(curves, first, parts, direction == 1, direction, landing))
    return visits


def there_and_back(work: Work, rising: np.ndarray) -> list[Visit]:
    """Approach and retract in time over these rising tip offsets [m], as rows of the tip."""
    state, n = far_state(work.oscillator(0), rising[-1]), len(rising)
    orders = range(n - 1, -1, -1), range(n)
    return [_visit_in_time(state, order, lambda k: (work, rising[k]), False, n) for order in orders]


def _visit_in_time(state: np.ndarray, order: Iterable[int], at: At, by_amplitude: bool, n: int) -> Visit:
    """Go from value to value, from this state, which is changed."""
    rows, status = np.full((n, col.FULL), np.nan), np.full(n, Status.not_settled.code, np.int8)
    for k in order:
        work, target = at(k)
        status[k], rows[k] = move_in_time(work.oscillator(0), state, target, by_amplitude)
    return Visit(rows, np.full((n, 2, 0), np.nan), status, [])


def _check_no_samples(samples: int) -> None:
    """Refuse time traces of a sweep in time."""
    if samples:
        raise InputError("samples", samples, "0 where contacts remember or are wet: what is marched keeps no traces")


def _dataset_in_time(
    question: Question, works: list[Work], about: Axis, visits: list[Visit],
    held: dict[str, float | None] | None = None,
) -> xr.Dataset:  # fmt: skip
    """Dataset of a sweep in time, which has no curve; of works of the values in rising order, or one for all."""
    curves = Curves(fixed_path(works[0].oscillator(0)), col.TIP_OFFSET, about.values, (0.0, 0.0, 0.0), 0)
    levers = np.array([work.lever for work in works]) if len(works) > 1 else works[0].lever
    return dataset(curves, about, visits, question, held, levers)
