"""Colours of values: one colour map for one quantity in every picture, and limits that may be given."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import matplotlib
import numpy as np
import xarray as xr
from matplotlib.colors import Colormap, Normalize

from phasemap._shared.arrays import is_varied
from phasemap._shared.checks import check_choice, number
from phasemap._shared.errors import InputError
from phasemap._shared.quantities import KINDS, Scalar
from phasemap._shared.units import Unit, readable

Given: TypeAlias = "Scalar | Mapping[str, Scalar] | None"

MAPS = {
    "height": "afmhot", "phase": "cividis", "amplitude_error": "gray", "contrast": "coolwarm", "residual": "coolwarm",
    "modulus": "plasma", "adhesion": "plasma", "damping": "plasma", "error": "magma_r",
}  # fmt: skip
"""The colour map of a quantity, wherever it is drawn; differences have one that is grey at 0."""
OTHERS = "viridis"
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Colours of lines, symbols and regions: those of Okabe and Ito, which the colour-blind tell apart."""
STYLES, MARKERS = ("-", "--", ":", "-."), ("o", "s", "^", "D", "v", "P")
"""Lines and symbols of free amplitudes."""
SURE = 1.96  # standard errors, to either side, of an interval of 95 %
BARS: dict[str, Any] = {"capsize": 2, "linewidth": 1}  # of errors
NO_REGION, IN_NO_REGION = "0.85", "grey: in no region"
FAILED = "#00e646"  # green is in none of them
FAILED_TEXT = "#00803a"  # a darker one, of what is said about pixels and points that failed
SHOWN = (0.5, 99.5)  # percentiles; a few outliers must not cost the contrast
MARGIN = 0.04  # of the range, so that two sharp populations stand clear of the histogram's ends
UNITS = {"height": "m", "phase": "degree", "amplitude_error": "m"}  # where a variable does not say
WORDS = {
    "dissipation": "dissipation per cycle", "dissipation_ev": "dissipation per cycle",
    "loss_tangent_corrected": "corrected loss tangent", "mode2_frequency_shift": "frequency shift of mode 2",
    "mode2_amplitude": "amplitude of mode 2", "mode2_phase": "phase of mode 2",
    "mode2_over_depth": "amplitude 2 over depth", "effective_stiffness_1": "effective stiffness, mode 1",
    "effective_stiffness_2": "effective stiffness, mode 2", "bimodal_modulus_bound": "bound of modulus error",
    **{f"{what}_{n}": f"{what} of harmonic {n}" for n in range(2, 7) for what in ("amplitude", "phase")},
}  # fmt: skip
"""Names of variables in pictures, where they are not the name itself."""
FEWEST, MOST = 0.1, 1e4  # numbers that are short enough for a colour bar, the largest of all shown
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
LEAST = {"phase": 1.0, "amplitude_error": 2e-13}  # ranges shown at least, not to blow up last digits [degree, m]


@dataclass(frozen=True)
class Colours:
    """Limits and the colour map of a quantity that a picture was asked for, None where it chooses."""

    vmin: float | None = None
    vmax: float | None = None
    cmap: str | None = None


CHOSEN = Colours()
"""Colours where a user asks for none."""


@dataclass(frozen=True)
class Scale:
    """Colour map and limits by which the values of one quantity turn into colours."""

    label: str  # of axes and colour bars, with the unit
    # factor, offset: what is shown is the value less the offset, times the factor
    factor: float
    offset: float
    # low, high: limits of what is shown
    low: float
    high: float
    name: str  # of the colour map

    @property
    def cmap(self) -> Colormap:
        """Green where there is no value."""
        return matplotlib.colormaps[self.name].with_extremes(bad=FAILED)

    @property
    def norm(self) -> Normalize:
        """Normalization from shown values to colours."""
        return Normalize(self.low, self.high)

    def shown(self, values: np.ndarray) -> np.ndarray:
        """Values as they are shown."""
        return (values - self.offset) * self.factor


def by_name(given: Any, variables: Collection[str]) -> Mapping[str, Any]:
    """Limits or colour maps by variables; one alone is of the phase, or of the first variable where there is none."""
    if given is None or isinstance(given, Mapping):
        return given or {}
    return {"phase" if "phase" in variables else next(iter(variables)): given}


def given_colours(vmin: Given, vmax: Given, cmap: Any, variables: Mapping[str, str]) -> dict[str, Colours]:
    """Check limits, in SI units or with a unit, and names of colour maps of matplotlib, for what is drawn."""
    asked: dict[str, dict[str, Any]] = {name: {} for name in variables}
    for what, given in (("vmin", vmin), ("vmax", vmax), ("cmap", cmap)):
        for name, value in by_name(given, variables).items():
            check_choice(what, name, variables)
            if what != "cmap":
                unit = variables[name]
                value = number(f"{what} of {name}", value, unit if unit in KINDS else "")
            elif not isinstance(value, str) or value not in matplotlib.colormaps:
                raise InputError(what, value, "a colour map of matplotlib, such as 'cividis', 'coolwarm' or 'gray'")
            asked[name][what] = value
    colours = {name: Colours(**values) for name, values in asked.items()}
    for name, scale in colours.items():
        if scale.vmin is not None and scale.vmax is not None and scale.vmin >= scale.vmax:
            raise InputError(f"vmin of {name}", scale.vmin, f"a number below vmax, which is {scale.vmax:g}")
    return colours


def colour_scale(variable: xr.DataArray, asked: Colours = CHOSEN) -> Scale:
    """Choose how a variable is shown: heights from the lowest pixel, errors symmetric about 0, others as they are.

    `asked`: limits in the unit of the variable; those of a height count from the lowest pixel.
    """
    name = str(variable.name)
    low, high = limits_of(variable.values)
    known = np.isfinite(variable.values)
    offset = float(np.min(variable.values, where=known, initial=low)) if name == "height" else 0.0
    low, high = low - offset, high - offset
    if name == "amplitude_error":
        low, high = -max(-low, high), max(-low, high)
    margin = max(MARGIN * (high - low), (LEAST.get(name, 0.0) - (high - low)) / 2)
    margin = margin or 0.5 * abs(high) or 0.5 * (1e-9 if units_of(variable) == "m" else 1.0)
    low = low - margin if asked.vmin is None else asked.vmin
    high = high + margin if asked.vmax is None else asked.vmax
    if low >= high:
        raise InputError(f"limits of {name}", f"{low:g} to {high:g}", "vmin below vmax; give both")
    unit = _in_thousands(max(-low, high), readable(max(-low, high), units_of(variable)))
    words = str(variable.attrs.get("called", words_of(name))) + (", levelled" if variable.attrs.get("levelled") else "")
    return Scale(
        unit.label(words), 1 / unit.size, offset, low / unit.size, high / unit.size,
        asked.cmap or MAPS.get(name, OTHERS),
    )  # fmt: skip


def _in_thousands(largest: float, unit: Unit) -> Unit:
    """Unit with a power of a thousand, where numbers would not fit beside a colour bar."""
    shown = largest / unit.size
    if not 0 < shown < math.inf or FEWEST <= shown < MOST:
        return unit
    power = 3 * math.floor(math.log10(shown) / 3)
    return Unit(unit.size * 10.0**power, f"10{str(power).translate(RAISED)} {unit.text}".rstrip())


def words_of(name: str) -> str:
    """Name of a variable in a picture."""
    return WORDS.get(name, name.replace("_", " "))


def units_of(variable: xr.DataArray) -> str:
    """The units of a variable, as UDUNITS writes them."""
    return str(variable.attrs.get("units", UNITS.get(str(variable.name), "")))


def limits_of(values: np.ndarray) -> tuple[float, float]:
    """The percentiles shown, or twice a value if all are the same up to rounding; (0, 0) if there is no finite one."""
    finite = values[np.isfinite(values)]
    if finite.size == 0:
        return 0.0, 0.0
    if not is_varied(finite):
        return float(finite[0]), float(finite[0])
    low, high = np.percentile(finite, SHOWN)
    if high == low:  # a few particles on a flat ground
        low, high = finite.min(), finite.max()
    return float(low), float(high)
