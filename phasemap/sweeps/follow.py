"""Sweeps from the objects of the user to a Dataset."""

from __future__ import annotations

import numpy as np
import xarray as xr

from phasemap._kernels import columns as col
from phasemap._kernels.continuation.path import ENTRY_M, ENTRY_Z0
from phasemap._shared.errors import InputError
from phasemap.experiment.material import Material
from phasemap.experiment.microscope import Microscope
from phasemap.results.status import Status
from phasemap.solvers.continuation.complete import (
    FAINT,
    complete,
    held_curves,
    mend,
    orbits_of_amplitude,
    orbits_of_offset,
)
from phasemap.solvers.continuation.off_orbit import OffOrbit
from phasemap.solvers.continuation.path import BEYOND, UNITS, Question, Scale, fixed_path, swept_path
from phasemap.solvers.continuation.pieces import Curves
from phasemap.solvers.continuation.slow_feedback import Place, SlowFeedback
from phasemap.solvers.continuation.visit import Jump, Segment, Visit, like, segments, walk
from phasemap.sweeps import in_time
from phasemap.sweeps.dataset import Axis, dataset

STARTS = (-1.003, 0.0071, 1.003)  # m at which all orbits are sought, to begin the curve from


def distance(material: Material, scope: Microscope, axis: np.ndarray, samples: int) -> xr.Dataset:
    """`phasemap.sweep_distance`."""
    if Question(material, scope).only_in_time:
        return in_time.distance(Question(material, scope), axis, samples)
    path = fixed_path(Question(material, scope))
    wanted = np.sort(axis)
    curves = Curves(path, ENTRY_Z0, wanted, (wanted[0], np.inf, FAINT * scope.driven_amplitude), samples)
    curves.from_far(wanted[-1] + 1e-3 * abs(wanted[-1]) + 1e-10)
    complete(curves, wanted[0])
    parts = segments(curves.pieces, col.TIP_OFFSET)
    approach = walk(curves, col.TIP_OFFSET, _at(parts, wanted[-1]), parts, True, 0)
    retract = walk(curves, col.TIP_OFFSET, _last(parts, approach, wanted[0]), parts, False, 1)
    about = Axis("tip_offset", axis, "m", "tip offset", ("approach", "retract"))
    return dataset(curves, about, lambda x: x, [approach, retract], material, scope, {})


def setpoint(material: Material, scope: Microscope, axis: np.ndarray, samples: int) -> xr.Dataset:
    """`phasemap.sweep_setpoint`."""
    if Question(material, scope).only_in_time:
        return in_time.setpoint(Question(material, scope), axis, samples)
    free = scope.driven_amplitude
    feedback = SlowFeedback(held_curves(fixed_path(Question(material, scope)), np.sort(axis) * free, samples))
    n = len(axis)
    down, place = _hold(feedback, feedback.far(), range(n - 1, -1, -1), 0)
    up, _ = _hold(feedback, place, range(n), 1)
    about = Axis("setpoint", axis, "1", "setpoint", ("down", "up"), col.AMPLITUDE, True, col.TURN)
    return dataset(feedback.curves, about, lambda x: x / free, [down, up], material, scope, {})


def parameter(
    material: Material, scope: Microscope, name: str, axis: np.ndarray, ratio: float | None, height: float | None,
    samples: int,
) -> xr.Dataset:  # fmt: skip
    """`phasemap.sweep_parameter` and `phasemap.sweep_frequency`."""
    if ratio is not None and scope.drive.excitation != "direct":
        hint = "A feedback on the deflection is not followed along other parameters; solve the values one by one."
        raise InputError("excitation", scope.drive.excitation, "'direct' for a sweep with a setpoint held", hint)

    question, scale = Question(material, scope), Scale.over(axis)
    for value in (scale.low, scale.high):
        question.with_parameter(name, value)
    if question.only_in_time:
        return in_time.parameter(question, name, UNITS[name], axis, ratio, height, samples)

    def held_under(changed: Microscope) -> float:
        return ratio * changed.driven_amplitude if ratio is not None else (height or 0.0)

    path = swept_path(question, name, scale, held_under, ratio is not None)
    order = np.argsort(axis)
    wanted = scale.m(axis[order])
    starts = np.array(STARTS)
    every = np.sort(np.concatenate([wanted, starts]))
    curves = Curves(path, ENTRY_M, every, (-BEYOND, BEYOND, 0.0), samples)
    for m in starts:
        begin(curves, float(m), ratio is not None)
    if ratio is None:
        mend(curves, scope.drive.free_amplitude)
    curves.choose(wanted)
    if ratio is None:
        up, down = _both(curves)
    else:
        up, down = _both_held(curves, question, name, scale, ratio)
    held = {"setpoint": ratio} if ratio is not None else {"tip_offset": height}
    about = Axis(name, axis, UNITS[name], name.replace("_", " "), ("up", "down"), col.PARAMETER, ratio is not None)
    return dataset(curves, about, scale.value, [up, down], material, scope, held)


def _at(parts: list[Segment], x: float) -> Segment | None:
    """The first stable segment at x, in the order of the curve from far."""
    return next((part for part in parts if part.row_at(x) is not None), None)


def _last(parts: list[Segment], visit: Visit, x: float) -> Segment | OffOrbit | None:
    """Segment of the curve, or motion off it, on which a sweep down to x has ended."""
    if isinstance(visit.ended, OffOrbit):
        return visit.ended
    row = visit.rows[0]
    there = [part for part in parts if part.row_at(x) is not None]
    same = [part for part in there if np.isclose(part.rows[0, col.AMPLITUDE], row[col.AMPLITUDE], rtol=1e-9)]
    return same[0] if same else (there[-1] if there and np.isnan(row[col.AMPLITUDE]) else None)


def _hold(feedback: SlowFeedback, place: Place | None, order: range, direction: int) -> tuple[Visit, Place | None]:
    """Hold one amplitude after the other."""
    curves = feedback.curves
    n = len(curves.wanted)
    rows, traces = np.full((n, col.FULL), np.nan), np.full((n, 2, curves.samples), np.nan)
    status, jumps = np.full(n, Status.no_stable_orbit.code, np.int8), list[Jump]()
    for k in order:
        if place is None:
            continue
        held = feedback.seek(place, k, direction)
        if held.jump is not None:
            jumps.append(held.jump)
        if held.place is not None and held.row is not None:
            place, rows[k], status[k] = held.place, held.row, Status.good.code
            traces[k] = np.nan if held.trace is None else held.trace
    return Visit(rows, traces, status, jumps), place


def begin(curves: Curves, m: float, of_amplitude: bool) -> None:
    """Follow the curve from every orbit at m that is not known yet."""
    from phasemap._kernels.lever import free_amplitude
    from phasemap._kernels.orbits.collocation.path import fixed_path, held_value

    oscillator = curves.standing(m)
    value, path = held_value(curves.path, m), fixed_path(oscillator)
    rows, _ = orbits_of_amplitude(path, value) if of_amplitude else orbits_of_offset(path, value, False)
    for row in rows:
        if not curves.knows(row, m):
            curves.from_orbit(row, m, of_amplitude)
    if not of_amplitude:
        # Where nothing acts, or no curve leads there, the lever still swings freely.
        free = np.zeros(col.COLUMNS)
        free[col.TIP_OFFSET], free[col.AMPLITUDE] = value, free_amplitude(oscillator.lever)
        curves.from_orbit(free, m, False)


def _both(curves: Curves) -> tuple[Visit, Visit]:
    """Up and down at a fixed tip offset, each begun on the orbit that stays farthest from the surface."""
    parts = segments(curves.pieces, col.PARAMETER)
    visits = []
    for direction, x in enumerate((curves.wanted[0], curves.wanted[-1])):
        there = [(part.row_at(x), part) for part in parts]
        reached = [(float(row[col.INDENTATION]), i) for i, (row, _) in enumerate(there) if row is not None]
        first = there[min(reached)[1]][1] if reached else None
        visits.append(walk(curves, col.PARAMETER, first, parts, direction == 1, direction))
    return visits[0], visits[1]


def _both_held(curves: Curves, question: Question, name: str, scale: Scale, ratio: float) -> tuple[Visit, Visit]:
    """Up and down with the setpoint held, each begun by engaging from far."""
    parts = segments(curves.pieces, col.PARAMETER, held=True)

    def landing(edge: np.ndarray, m: float) -> Segment | OffOrbit | None:
        """The feedback moves the tip, at the new value of the parameter, until the amplitude is back."""
        return engaged(m, edge) or (OffOrbit(edge) if question.scope.interaction.law.hysteretic else None)

    def engaged(m: float, edge: np.ndarray | None = None) -> Segment | OffOrbit | None:
        """Orbit on which the feedback holds the setpoint, coming from an orbit or from far."""
        here = question.with_parameter(name, float(scale.value(m)))
        feedback = SlowFeedback(held_curves(fixed_path(here), np.array([ratio * here.scope.driven_amplitude]), 0))
        place = feedback.far() if edge is None else feedback.nearest(edge)
        if place is None:
            return None
        held = feedback.seek(place, 0, 0)
        if held.place is None or held.row is None:
            return None
        return held.place.on if isinstance(held.place.on, OffOrbit) else like(parts, m, held.row)

    visits = []
    for direction, x in enumerate((curves.wanted[0], curves.wanted[-1])):
        first = engaged(float(x))
        visits.append(walk(curves, col.PARAMETER, first, parts, direction == 1, direction, landing))
    return visits[0], visits[1]
