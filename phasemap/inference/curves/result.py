"""Result of a fit: values and errors, how far to believe them, and the curve beside the data."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from phasemap.experiment.interaction.contact import LAWS
from phasemap.experiment.material import Material
from phasemap.experiment.microscope import Microscope
from phasemap.inference.curves.data import DIRECTIONS, OF_SAMPLE, CurveSetting, Data
from phasemap.inference.curves.evidence import Estimate
from phasemap.inference.curves.residuals import Choice, CurveProblem, Ruler, difference
from phasemap.inference.determined import (
    DETERMINED,
    END,
    OPEN,
    REACH,
    UNLIKELY,
    chance,
    codes_of,
    correlation_of,
    say_codes,
)
from phasemap.results.variables import coded, float_attributes
from phasemap.sweeps.sweep import sweep_distance, sweep_frequency

SHOWN = {"Pa": ("GPa", 1e-9), "m": ("nm", 1e9), "J m-2": ("J/m²", 1.0), "N m-1": ("N/m", 1.0), "Hz": ("kHz", 1e-3),
         "degree": ("°", 1.0), "Pa s": ("Pa s", 1.0), "1": ("", 1.0), "s": ("µs", 1e6), "N s m-1": ("nN s/m", 1e9),
         "m3": ("nm³", 1e27)}  # fmt: skip
STRONG = 0.9  # correlations above it are worth a line
WORSE = 9.0  # in chi2, by which the orbit visited must fit a datum worse than another one to be the wrong one
APART = 10.0  # factor between moduli of which nobody would say that they are of one material
MOST_NAMED = 6  # data that a sentence names


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """Result of a fit to a measured curve; `print` it for a report.

    Attributes
    ----------
    material : Material
        With the fitted values.
    scope : Microscope
        With the fitted values, if any belong to it.
    values, errors : dict of str to float
        Fitted parameters and their standard errors, in `units`; infinite where the data do not determine one.
    correlation : xarray.DataArray
        Correlations of the errors, dims ("parameter", "other").
    chi2 : float
        Sum of squared differences of data and curve, over their errors.
    degrees : int
        Data less parameters; about what chi2 should be.
    discrepancy : float
        Factor by which the errors of the data would have to be larger for the model to describe them, 1 at least; the
        errors of the parameters have it in them.
    evidence : float
        Logarithm of how likely the law makes the data, whatever its parameters are within what is known of them
        beforehand, up to a constant of the data: what is larger by 5 is 150 times as likely.
    rivals : tuple of Fit
        Fits with other contact laws that were asked for, the likeliest first.
    good : bool
        Whether chi2 is likely, all properties of the material are determined, and a sweep of the fitted material
        visits the branches on which the data are, but for single data next to a jump.
    status : str
        What is wrong and what would help, or that nothing is.
    curve : xarray.Dataset
        The fitted material's sweep, as `phasemap.sweep_frequency` or `sweep_distance` gives it, and over its directions
        and axis what was measured (`measured_amplitude`, `measured_phase`, `measured_amplitude_error`,
        `measured_phase_error`), what was fitted to it (`fitted_amplitude`, `fitted_phase`; NaN in a direction that was
        not measured) and which data the sweep does not visit (`off_branch`).
    starts, evaluations : int
        Starting points used, and curves computed.
    """

    material: Material
    scope: Microscope
    values: dict[str, float]
    errors: dict[str, float]
    units: dict[str, str]
    correlation: xr.DataArray
    chi2: float
    degrees: int
    discrepancy: float
    evidence: float
    good: bool
    status: str
    curve: xr.Dataset
    starts: int
    evaluations: int
    rivals: tuple[Fit, ...] = ()

    @property
    def law(self) -> str:
        """The contact law, by its name in `LAWS` if it has one."""
        law = self.scope.interaction.law
        return next((name for name, one in LAWS.items() if one == law), law.name)

    def __repr__(self) -> str:
        """The values, and whether to believe them."""
        text = ", ".join(
            f"{name} {with_error(value, self.errors[name], self.units[name])}" for name, value in self.values.items()
        )
        return f"Fit({'good' if self.good else 'doubtful'}: {text})"

    def __str__(self) -> str:
        """A report with units."""
        width = max(len(name) for name in self.values)
        lines = [f"{'good fit' if self.good else 'DOUBTFUL FIT'}: {self.status}"]
        for name, value in self.values.items():
            lines.append(f"  {name:<{width}}  {with_error(value, self.errors[name], self.units[name])}")
        lines.append(f"  chi2 {self.chi2:.1f} for {self.degrees} degrees of freedom ({self.chi2 / self.degrees:.2f})")
        for fit in (self, *self.rivals) if self.rivals else ():
            apart = fit.evidence - self.evidence
            lines.append(f"  law {fit.law:<14} chi2 over degrees {fit.chi2 / fit.degrees:<7.3g} evidence {apart:+.1f}")
        names = list(self.values)
        for i, name in enumerate(names):
            for j in range(i):
                number = float(self.correlation[i, j])
                if abs(number) > STRONG:
                    lines.append(f"  {names[j]} and {name} are correlated by {number:+.3f}")
        return "\n".join(lines)

    def to_dataset(self) -> xr.Dataset:
        """The curve, and over the dim "parameter" values, errors and correlations; writes to netCDF."""
        names = list(self.values)
        units = " ".join(f"{name}:{self.units[name].replace(' ', '.')}" for name in names)
        numbers = {
            f"parameter_{word}": ("parameter", list(part.values()), {"long_name": long_name, "parameter_units": units})
            for word, part, long_name in (
                ("value", self.values, "fitted value"), ("error", self.errors, "standard error of the fitted value")
            )
        }  # fmt: skip
        ds = self.curve.assign(numbers).assign(parameter_correlation=self.correlation)
        ds.attrs.update(
            law=self.law,
            chi2=self.chi2, degrees_of_freedom=self.degrees, good=int(self.good), fit_status=self.status,
            starts=self.starts, evaluations=self.evaluations,
        )  # fmt: skip
        return ds


def in_unit(value: float, unit: str) -> str:
    """A value in a handy unit."""
    word, factor = SHOWN[unit]
    return f"{value * factor:.3g} {word}".rstrip()


def with_error(value: float, error: float, unit: str) -> str:
    """A value and its error in a handy unit, to two digits of the error."""
    word, factor = SHOWN[unit]
    plain, value, error = in_unit(value, unit), value * factor, error * factor
    if np.inf > error > 0.5 * value > 0 and word != "°":
        return f"{plain} within a factor of {np.exp(error / value):.2g}"
    if not 0 < error < np.inf:
        return f"{plain}, not determined"
    digits = max(0, 1 - int(np.floor(np.log10(error))))
    return f"{value:.{digits}f} ± {error:.{digits}f} {word}".rstrip()


def make_fit(problem: CurveProblem, solution: Estimate) -> Fit:
    """Fit of a solution, with the curve, the errors and the sentences on how far to believe them."""
    data, q = problem.data, solution.q
    names = [parameter.name for parameter in problem.parameters]
    setup = problem.setup_at(q)
    choice = problem.choose(q, Ruler.strict(data))
    if data.axis == "frequency":
        curve = sweep_frequency(setup.material, setup.scope, data.values, tip_offset=setup.height)
    else:
        curve = sweep_distance(setup.material, setup.scope, data.values + setup.height)
    off, excused = _off_branch(setup, data, choice, curve)
    _add_data(curve, data, choice, off)
    sigmas = np.sqrt(np.diag(solution.covariance))
    correlation = correlation_of(solution.covariance)
    codes = _codes(problem, solution)
    errors = {
        p.name: np.inf if code == OPEN else p.error(float(at), float(error))
        for p, at, error, code in zip(problem.parameters, q, sigmas, codes, strict=True)
    }
    degrees = data.size - len(names)
    of_material = np.array([name in OF_SAMPLE for name in names])
    sentence = say_codes([name.replace("_", " ") for name in names], codes, correlation)
    lost = bool((codes[of_material] != DETERMINED).any())
    wrong = [_unlikely(solution, degrees)] if chance(solution.chi2, degrees) < UNLIKELY else []
    wrong += _run_away(problem, q)
    aside = _other_branch_in_words(data, off & excused, "next to a jump")
    wrong += _other_branch_in_words(data, off & ~excused, "that its sweep does not visit")
    wrong += [sentence] if lost else []
    if not wrong and solution.tried > 1:
        aside.append(f"it needed {solution.tried} starting points.")
    if not wrong and not aside:
        aside = ["the curve agrees with the data, and the data determine every property of the material."]
    if not lost and (codes != DETERMINED).any():
        aside.append(sentence)
    aside += _softer(problem, setup, float(sigmas[names.index("modulus")]) if "modulus" in names else np.inf)
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


def _codes(problem: CurveProblem, solution: Estimate) -> np.ndarray:
    """Codes of how well each parameter is known: as `codes_of`, and better than beforehand."""
    sizes = np.array([max(p.size, 1.0) if p.logarithmic else 1.0 for p in problem.parameters])
    codes = codes_of(solution.covariance * np.outer(sizes, sizes))
    codes[np.abs(solution.q) > END * REACH] = OPEN
    return codes


def _run_away(problem: CurveProblem, q: np.ndarray) -> list[str]:
    """Sentences on parameters that are at the end of the range searched."""
    return [
        f"{one.name.replace('_', ' ')} has run to {in_unit(one.value(at), one.units)}, the end of the range searched."
        for one, at in zip(problem.parameters, q, strict=True)
        if abs(at) > END * REACH
    ]


def _softer(problem: CurveProblem, setup: CurveSetting, error: float) -> list[str]:
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


def _off_branch(setup: CurveSetting, data: Data, choice: Choice, curve: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """True for data that the sweep does not visit, and for those of them that are alone next to a jump of the sweep."""
    off = np.zeros((len(data.directions), len(data.values)), bool)
    excused = off.copy()
    apart = np.zeros((2, *off.shape))
    values = curve[data.axis].values
    for i, direction in enumerate(data.directions):
        seen = curve.sel(direction=direction)
        read = setup.read(seen.amplitude.values, seen.phase.values)
        for name, measured in data.measured.items():
            for k, model in enumerate((read[name], choice.read[name][i])):
                apart[k, i] += (difference(name, model, measured[i]) / data.errors[name][i]) ** 2
        off[i] = ~(apart[0, i] <= apart[1, i] + WORSE)
        for jump in _jumps_of(curve, data.axis, direction):
            for side in (values[values >= jump], values[values < jump]):
                if len(side):
                    excused[i] |= np.abs(values - jump) <= np.abs(side - jump).min() * (1 + 1e-9)
    return off, excused


def _jumps_of(curve: xr.Dataset, axis: str, direction: str) -> np.ndarray:
    """Values at which a sweep jumps in a direction; of one marched in time, where the phase crosses the resonance."""
    if curve[f"curve_{axis}"].size:
        code = DIRECTIONS[axis].index(direction)
        return curve[f"jump_{axis}"].values[curve.jump_direction.values == code]
    values, sides = curve[axis].values, curve["branch"].sel(direction=direction).values
    turns = np.flatnonzero(sides[1:] != sides[:-1])
    return 0.5 * (values[turns] + values[turns + 1])


def _add_data(curve: xr.Dataset, data: Data, choice: Choice, off: np.ndarray) -> None:
    """Add measured and fitted values to the Dataset of the sweep."""
    everything = DIRECTIONS[data.axis]
    rows = [everything.index(direction) for direction in data.directions]
    dims = ("direction", data.axis)
    for name in data.measured:
        about = float_attributes(name)
        for word, long_name, values in (
            ("measured_{}", "measured {}", data.measured[name]),
            ("measured_{}_error", "standard error of the measured {}", data.errors[name]),
            ("fitted_{}", "{} of the fit, as the instrument would read it", choice.read[name]),
        ):
            full = np.full((2, len(data.values)), np.nan)
            full[rows] = values
            curve[word.format(name)] = (dims, full, {**about, "long_name": long_name.format(name)})
    flags = np.zeros((2, len(data.values)), np.int8)
    flags[rows] = off
    curve["off_branch"] = (dims, flags, coded("whether the sweep visits the datum's branch", "visited", "off_branch"))


def _unlikely(solution: Estimate, degrees: int) -> str:
    """Sentence on a chi2 that is too large, and what was made of it."""
    tried = solution.tried
    return (
        f"chi2 is {solution.chi2 / degrees:.3g} times the degrees of freedom after {tried} starting "
        f"point{'s' * (tried > 1)}: the model describes the data to within {solution.growth:.2g} times their errors "
        "only, which the errors of all parameters allow for."
    )


def _other_branch_in_words(data: Data, off: np.ndarray, where: str) -> list[str]:
    """Sentence on data that are on another branch."""
    sentences, (word, factor) = [], SHOWN["Hz" if data.axis == "frequency" else "m"]
    for direction, at in zip(data.directions, off, strict=True):
        if at.any():
            shown = ", ".join(f"{value * factor:.6g}" for value in data.values[at][:MOST_NAMED])
            more = f" and {at.sum() - MOST_NAMED} more" if at.sum() > MOST_NAMED else ""
            sentences.append(f"The fit has data {where} ({direction}) on another branch: {shown}{more} {word}.")
    return sentences
