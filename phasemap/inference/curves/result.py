"""What a fit gives: values and errors, how far to believe them, and the curve beside the data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from phasemap._shared.shown import preformatted
from phasemap.experiment.material import Material
from phasemap.experiment.microscope import Microscope

if TYPE_CHECKING:
    import xarray as xr

SHOWN = {"Pa": ("GPa", 1e-9), "m": ("nm", 1e9), "J m-2": ("J/m²", 1.0), "N m-1": ("N/m", 1.0), "Hz": ("kHz", 1e-3),
         "degree": ("°", 1.0), "Pa s": ("Pa s", 1.0), "1": ("", 1.0)}  # fmt: skip
STRONG = 0.9  # correlations above it are worth a line


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """What a measured curve says about a material; `print` it for a report.

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

    def __repr__(self) -> str:
        """The values, and whether to believe them."""
        said = ", ".join(
            f"{name} {shown(one, self.errors[name], self.units[name])}" for name, one in self.values.items()
        )
        return f"Fit({'good' if self.good else 'doubtful'}: {said})"

    def _repr_html_(self) -> str:
        return preformatted(str(self))

    def __str__(self) -> str:
        """A report with units."""
        width = max(len(name) for name in self.values)
        lines = [f"{'good fit' if self.good else 'DOUBTFUL FIT'}: {self.status}"]
        for name, value in self.values.items():
            lines.append(f"  {name:<{width}}  {shown(value, self.errors[name], self.units[name])}")
        lines.append(f"  chi2 {self.chi2:.1f} for {self.degrees} degrees of freedom ({self.chi2 / self.degrees:.2f})")
        for fit in (self, *self.rivals) if self.rivals else ():
            law, apart = fit.scope.interaction.law.name, fit.evidence - self.evidence
            lines.append(f"  law {law:<14} chi2 over degrees {fit.chi2 / fit.degrees:<7.3g} evidence {apart:+.1f}")
        names = list(self.values)
        for i, one in enumerate(names):
            for j in range(i):
                number = float(self.correlation[i, j])
                if abs(number) > STRONG:
                    lines.append(f"  {names[j]} and {one} are correlated by {number:+.3f}")
        return "\n".join(lines)

    def to_dataset(self) -> xr.Dataset:
        """The curve, and over the dim "parameter" values, errors and correlations; writes to netCDF."""
        names = list(self.values)
        units = " ".join(f"{name}:{self.units[name].replace(' ', '.')}" for name in names)
        numbers = {
            f"parameter_{word}": ("parameter", list(part.values()), {"long_name": said, "parameter_units": units})
            for word, part, said in (
                ("value", self.values, "fitted value"), ("error", self.errors, "standard error of the fitted value")
            )
        }  # fmt: skip
        found = self.curve.assign(numbers).assign(parameter_correlation=self.correlation)
        found.attrs.update(
            law=self.scope.interaction.law.name,
            chi2=self.chi2, degrees_of_freedom=self.degrees, good=int(self.good), fit_status=self.status,
            starts=self.starts, evaluations=self.evaluations,
        )  # fmt: skip
        return found


def shown(value: float, error: float, unit: str) -> str:
    """A value and its error in a handy unit, to two digits of the error.

    Examples
    --------
    >>> shown(0.8912e9, 0.0123e9, "Pa"), shown(0.0137, float("inf"), "1")
    ('0.891 ± 0.012 GPa', '0.0137, not determined')
    """
    import math

    word, factor = SHOWN[unit]
    value, error = value * factor, error * factor
    if math.inf > error > 0.5 * value > 0 and word != "°":
        return f"{value:.3g} {word}".rstrip() + f" within a factor of {math.exp(error / value):.2g}"
    if not 0 < error < math.inf:
        return f"{value:.3g} {word}".rstrip() + ", not determined"
    digits = max(0, 1 - math.floor(math.log10(error)))
    return f"{value:.{digits}f} ± {error:.{digits}f} {word}".rstrip()
