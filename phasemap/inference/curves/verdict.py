"""From a solution to a `Fit`: the curve beside the data, and what speaks against it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from phasemap._shared.sentences import listed
from phasemap.inference.curves.data import DIRECTIONS, Data, Setup
from phasemap.inference.curves.problem import Choice, Problem, Ruler, difference
from phasemap.inference.curves.result import SHOWN, Fit
from phasemap.inference.curves.solve import UNLIKELY, Knowledge, Solution, knowledge
from phasemap.inference.verdict import chance
from phasemap.results.variables import coded, float_attributes
from phasemap.sweeps.sweep import sweep_distance, sweep_frequency

if TYPE_CHECKING:
    import xarray as xr

WORSE = 9.0  # in chi2, by which the orbit visited must fit a datum worse than another one to be the wrong one
UNKNOWN = 1.0  # error of a logarithm: as large, and the value is not known within a factor of e
END = 0.98  # of the range searched: a parameter beyond has run away
SMALL = -2.0  # on a logarithmic scale: a value as far below its start goes to 0
ALONE = 0.98  # share of one parameter in a combination that the data do not see: it is that parameter
MOST_NAMED = 6  # data that a sentence names


def make_fit(problem: Problem, solution: Solution, tried: int) -> Fit:
    """Judge a solution."""
    import xarray as xr

    data, q = problem.data, solution.q
    names = [parameter.name for parameter in problem.parameters]
    setup, known = problem.at(q), knowledge(problem, q)
    choice = problem.choose(q, Ruler.strict(data))
    curve = _sweep(setup, data)
    off, excused = _off_branch(setup, data, choice, curve)
    _add(curve, data, choice, off)
    lost = _not_determined(problem, solution, known)
    errors = {
        p.name: np.inf if p.name in lost else p.error(float(at), float(error))
        for p, at, error in zip(problem.parameters, q, known.errors, strict=True)
    }
    degrees = data.size - len(names)
    wrong = [sentence for sentence in lost.values() if sentence]
    if chance(solution.chi2, degrees) < UNLIKELY:
        wrong.insert(0, _unlikely(solution.chi2 / degrees, tried))
    aside = _named(data, off & excused, "next to a jump")
    wrong += _named(data, off & ~excused, "that its sweep does not visit")
    if not wrong and tried > 1:
        aside.append(f"it needed {tried} starting points.")
    status = " ".join(wrong + aside) or "the curve agrees with the data, and the data determine every parameter."
    return Fit(
        material=setup.material, scope=setup.scope,
        values={p.name: p.value(float(at)) for p, at in zip(problem.parameters, q, strict=True)},
        errors=errors, units={p.name: p.units for p in problem.parameters},
        correlation=xr.DataArray(
            known.correlation, {"parameter": names, "other": names}, ("parameter", "other"),
            attrs={"long_name": "correlation of the errors", "units": "1"},
        ),
        chi2=solution.chi2, degrees=degrees, good=not wrong, status=status, curve=curve,
        starts=tried, evaluations=problem.evaluations,
    )  # fmt: skip


def _sweep(setup: Setup, data: Data) -> xr.Dataset:
    if data.axis == "frequency":
        return sweep_frequency(setup.material, setup.scope, data.values, tip_offset=setup.height)
    return sweep_distance(setup.material, setup.scope, data.values + setup.height)


def _off_branch(setup: Setup, data: Data, choice: Choice, curve: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Which data the sweep does not visit, and which of these are alone next to a jump of it."""
    off = np.zeros((len(data.directions), len(data.values)), bool)
    excused = off.copy()
    apart = np.zeros((2, *off.shape))
    values = curve[data.axis].values
    for i, direction in enumerate(data.directions):
        seen = curve.sel(direction=direction)
        read = {"amplitude": setup.amplitude_scale * seen.amplitude.values, "phase": seen.phase + setup.phase_offset}
        for name, measured in data.measured.items():
            for k, model in enumerate((np.asarray(read[name]), choice.read[name][i])):
                apart[k, i] += (difference(name, model, measured[i]) / data.errors[name][i]) ** 2
        off[i] = ~(apart[0, i] <= apart[1, i] + WORSE)
        code = DIRECTIONS[data.axis].index(direction)
        for jump in curve[f"jump_{data.axis}"].values[curve.jump_direction.values == code]:
            for side in (values[values >= jump], values[values < jump]):
                if len(side):
                    excused[i] |= np.abs(values - jump) <= np.abs(side - jump).min() * (1 + 1e-9)
    return off, excused


def _add(curve: xr.Dataset, data: Data, choice: Choice, off: np.ndarray) -> None:
    """Put what was measured and fitted beside the sweep."""
    everything = DIRECTIONS[data.axis]
    rows = [everything.index(direction) for direction in data.directions]
    dims = ("direction", data.axis)
    for name in data.measured:
        about = float_attributes(name)
        for word, said, values in (
            ("measured_{}", "measured {}", data.measured[name]),
            ("measured_{}_error", "standard error of the measured {}", data.errors[name]),
            ("fitted_{}", "{} of the fit, as the instrument would read it", choice.read[name]),
        ):
            full = np.full((2, len(data.values)), np.nan)
            full[rows] = values
            curve[word.format(name)] = (dims, full, {**about, "long_name": said.format(name)})
    flags = np.zeros((2, len(data.values)), np.int8)
    flags[rows] = off
    curve["off_branch"] = (dims, flags, coded("whether the sweep visits the datum's branch", "visited", "off_branch"))


def _not_determined(problem: Problem, solution: Solution, known: Knowledge) -> dict[str, str]:
    """A sentence for each parameter that the data do not determine."""
    found = {}
    together = []
    for i, parameter in enumerate(problem.parameters):
        name, q = parameter.name, float(solution.q[i])
        word, factor = SHOWN[parameter.units]
        value = f"{parameter.value(q) * factor:.3g} {word}".rstrip()
        if abs(q) > END * parameter.reach:
            found[name] = f"{name} has run to {value}, the end of the range searched: the data do not determine it."
        elif np.isinf(known.errors[i]):
            if np.abs(known.null[:, i]).max(initial=0.0) > ALONE:
                found[name] = f"The data do not depend on {name}."
            else:
                together.append(name)
        elif parameter.logarithmic and known.errors[i] * parameter.size > UNKNOWN:
            found[name] = f"{name} is not determined: its error is larger than its value, {value}."
            if q < SMALL:
                most = (parameter.value(q) + 2 * parameter.error(q, float(known.errors[i]))) * factor
                found[name] += f" Anything from 0 to about {most:.2g} {word}".rstrip() + " fits as well."
    if together:
        found |= dict.fromkeys(together, "")
        found[together[0]] = f"{listed(together)} are not determined one by one: hold one of them."
    return found


def _unlikely(ratio: float, tried: int) -> str:
    return (
        f"chi2 is {ratio:.3g} times the degrees of freedom after {tried} starting point{'s' * (tried > 1)}: the model "
        "does not describe the data, or the data have larger errors than stated."
    )


def _named(data: Data, off: np.ndarray, where: str) -> list[str]:
    """A sentence on data that are on another branch."""
    said = []
    word, factor = SHOWN["Hz" if data.axis == "frequency" else "m"]
    for i, direction in enumerate(data.directions):
        at = np.flatnonzero(off[i])
        if len(at):
            some = ", ".join(f"{value * factor:.6g}" for value in data.values[at[:MOST_NAMED]])
            more = f" and {len(at) - MOST_NAMED} more" if len(at) > MOST_NAMED else ""
            said.append(f"The fit has data {where} ({direction}) on another branch: {some}{more} {word}.")
    return said
