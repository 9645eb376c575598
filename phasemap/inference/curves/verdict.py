"""From a solution to a `Fit`: the curve beside the data, and what speaks against it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from phasemap.inference.curves.data import DIRECTIONS, OF_SAMPLE, REACH, Data, Setup
from phasemap.inference.curves.problem import Choice, Problem, Ruler, difference
from phasemap.inference.curves.result import SHOWN, Fit
from phasemap.inference.curves.solve import UNLIKELY, Solution
from phasemap.inference.verdict import DETERMINED, OPEN, chance, codes_of, say_codes
from phasemap.results.variables import coded, float_attributes
from phasemap.sweeps.sweep import sweep_distance, sweep_frequency

if TYPE_CHECKING:
    import xarray as xr

WORSE = 9.0  # in chi2, by which the orbit visited must fit a datum worse than another one to be the wrong one
END = 0.98  # of the range searched: a parameter beyond has run away
APART = 10.0  # factor between moduli of which nobody would say that they are of one material
MOST_NAMED = 6  # data that a sentence names


def make_fit(problem: Problem, solution: Solution) -> Fit:
    """Judge a solution."""
    import xarray as xr

    data, q = problem.data, solution.q
    names = [parameter.name for parameter in problem.parameters]
    setup = problem.at(q)
    choice = problem.choose(q, Ruler.strict(data))
    curve = _sweep(setup, data)
    off, excused = _off_branch(setup, data, choice, curve)
    _add(curve, data, choice, off)
    own = np.sqrt(np.diag(solution.covariance))
    correlation = solution.covariance / np.outer(own, own)
    np.fill_diagonal(correlation, 1.0)
    codes = _codes(problem, solution)
    errors = {
        p.name: np.inf if code == OPEN else p.error(float(at), float(error))
        for p, at, error, code in zip(problem.parameters, q, own, codes, strict=True)
    }
    degrees = data.size - len(names)
    of_material = np.array([name in OF_SAMPLE for name in names])
    said = say_codes([name.replace("_", " ") for name in names], codes, correlation)
    lost = bool((codes[of_material] != DETERMINED).any())
    wrong = [_unlikely(solution, degrees)] if chance(solution.chi2, degrees) < UNLIKELY else []
    wrong += _run_away(problem, solution)
    aside = _named(data, off & excused, "next to a jump")
    wrong += _named(data, off & ~excused, "that its sweep does not visit")
    wrong += [said] if lost else []
    if not wrong and solution.tried > 1:
        aside.append(f"it needed {solution.tried} starting points.")
    if not wrong and not aside:
        aside = ["the curve agrees with the data, and the data determine every property of the material."]
    if not lost and (codes != DETERMINED).any():
        aside.append(said)
    aside += _softer(problem, setup, float(own[names.index("modulus")]) if "modulus" in names else np.inf)
    return Fit(
        material=setup.material, scope=setup.scope,
        values={p.name: p.value(float(at)) for p, at in zip(problem.parameters, q, strict=True)},
        errors=errors, units={p.name: p.units for p in problem.parameters},
        correlation=xr.DataArray(
            correlation, {"parameter": names, "other": names}, ("parameter", "other"),
            attrs={"long_name": "correlation of the errors", "units": "1"},
        ),
        chi2=solution.chi2, degrees=degrees, discrepancy=solution.growth, evidence=solution.evidence,
        good=not wrong, status=" ".join(wrong + aside), curve=curve,
        starts=solution.tried, evaluations=problem.evaluations,
    )  # fmt: skip


def _codes(problem: Problem, solution: Solution) -> np.ndarray:
    """How well each parameter is known: as `codes_of`, and better than beforehand."""
    own, held = np.sqrt(np.diag(solution.covariance)), 1 / np.sqrt(np.diag(np.linalg.inv(solution.covariance)))
    sizes = np.array([max(p.size, 1.0) if p.logarithmic else 1.0 for p in problem.parameters])
    codes = codes_of(own * sizes, held * sizes)
    codes[np.abs(solution.q) > END * REACH] = OPEN
    return codes


def _run_away(problem: Problem, solution: Solution) -> list[str]:
    """A sentence for each parameter that is at the end of what was searched."""
    found = []
    for parameter, q in zip(problem.parameters, solution.q, strict=True):
        if abs(q) > END * REACH:
            word, factor = SHOWN[parameter.units]
            value = f"{parameter.value(float(q)) * factor:.3g} {word}".rstrip()
            found.append(f"{parameter.name.replace('_', ' ')} has run to {value}, the end of the range searched.")
    return found


def _softer(problem: Problem, setup: Setup, error: float) -> list[str]:
    """A sentence where the modulus is not that of the material that the fit started from."""
    ratio = setup.material.modulus / problem.setup.material.modulus
    if not (abs(np.log(ratio)) > np.log(APART) and error < 1):
        return []
    start = f"{problem.setup.material.modulus / 1e9:.3g} GPa that it started from"
    how = f"1/{1 / ratio:.0f} of" if ratio < 1 else f"{ratio:.0f} times"
    return [
        f"The modulus is {how} the {start}: what the tip presses is not that material, but a film on it, or radius, "
        "sensitivity or law are not those of the measurement."
    ]


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


def _unlikely(solution: Solution, degrees: int) -> str:
    tried = solution.tried
    return (
        f"chi2 is {solution.chi2 / degrees:.3g} times the degrees of freedom after {tried} starting "
        f"point{'s' * (tried > 1)}: the model describes the data to within {solution.growth:.2g} times their errors "
        "only, which the errors of all parameters allow for."
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
