"""Names and units of recorded channels and settings, and how an image was scanned."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from phasemap._shared.errors import FileError, InputError
from phasemap._shared.notices import unquestioned
from phasemap._shared.pixels import coordinate_step
from phasemap._shared.units import say
from phasemap.experiment.described import made
from phasemap.experiment.microscope import Cantilever, Drive, Microscope, Tip

LARGEST = 1e-3  # m, of a pixel and of a height: some ten times what scanners reach


class Kind(NamedTuple):
    """A quantity that microscopes record: how its channels are called, its units and its long name."""

    pattern: re.Pattern[str]
    units: dict[str, tuple[float, str]]  # unit in the file: factor to the unit of the Dataset, that unit
    what: str
    long_name: str


def _called(words: str) -> re.Pattern[str]:
    """Pattern for names with these words, but not of a higher eigenmode; the first may have a number."""
    return re.compile(rf"(?:{words})(?![\s_]*(?:error|sens|offset|[2-9]))", re.IGNORECASE)


METRES = {"m": (1.0, "m"), "um": (1e-6, "m"), "µm": (1e-6, "m"), "μm": (1e-6, "m"), "nm": (1e-9, "m")}
"""Lengths; the letter micro is one of two characters."""
_DEGREE, _RADIAN = (1.0, "degree"), (57.29577951308232, "degree")
_ANGLES = {"deg": _DEGREE, "degree": _DEGREE, "degrees": _DEGREE, "°": _DEGREE, "rad": _RADIAN, "radian": _RADIAN}
_AMPLITUDE = METRES | {"V": (1.0, "V"), "mV": (1e-3, "V")}
KINDS = {
    "height": Kind(
        re.compile("height|z[- ]?(?:axis|sensor|height|detector|drive)|topography", re.IGNORECASE),
        METRES, "a length", "recorded height",
    ),
    "phase": Kind(
        _called("phase|lock-?in phase|ncm phase|tapping phase"),
        _ANGLES, "an angle", "recorded phase, zero and sign as the instrument has them",
    ),
    "amplitude": Kind(
        _called("amplitude|lock-?in amplitude|ncm amplitude"), _AMPLITUDE, "a length or a voltage", "recorded amplitude"
    ),
    "amplitude_error": Kind(
        re.compile(r"amplitude[\s_]*error", re.IGNORECASE),
        _AMPLITUDE, "a length or a voltage", "recorded amplitude minus setpoint",
    ),
}  # fmt: skip
"""Kinds of channels, by the variable of the Dataset."""


def check_places(path: Path, ds: xr.Dataset) -> None:
    """Refuse an image whose coordinates y and x are not numbers in equal steps."""
    for dim in ("y", "x"):
        try:
            step = coordinate_step(ds, dim)
        except InputError as error:
            raise FileError(f"cannot use {path}: {error}") from None
        if not math.isfinite(step):
            raise FileError(f"cannot use {path}: the places of pixels along {dim} are not numbers.")


def implausible(ds: xr.Dataset) -> list[str]:
    """Sentences on pixels and heights that no microscope reaches: the file is damaged, or in another unit."""
    lengths = {f"a pixel along {dim}": coordinate_step(ds, dim) for dim in ("y", "x") if ds.sizes[dim] > 1}
    if "height" in ds and np.isfinite(ds["height"].values).any():
        with np.errstate(over="ignore"):
            lengths["the relief"] = float(np.ptp(ds["height"].values[np.isfinite(ds["height"].values)]))
    most = say(LARGEST, "m")
    return [f"{what} is {size:.3g} m; plausible: at most {most}" for what, size in lengths.items() if size > LARGEST]


CANONICAL = {
    "drive_frequency": "Hz",
    "free_amplitude": "m",  # of the free lever at the drive frequency
    "setpoint": "1",  # amplitude over free amplitude
    "stiffness": "N/m",
    "resonance_frequency": "Hz",
    "quality_factor": "1",
    "tip_radius": "m",
    "line_rate": "Hz",  # lines a second, each trace and retrace
    "proportional_gain": "1",  # gains are in units of the vendor
    "integral_gain": "1",
    "drive_voltage": "V",
    "phase_sign": "1",  # -1 where lag counts positive, which is as the vendor documents it
    "phase_zero": "degree",  # recorded phase of the free lever at the drive frequency
    "lock_in_phase": "degree",  # what the instrument adds to the phase, which tuning sets
    "day": "d",  # of the scan, since 1970-01-01
    "setpoint_amplitude": "m",
    "free_amplitude_voltage": "V",  # volts where no sensitivity makes metres of them
    "setpoint_voltage": "V",
    "amplitude_sensitivity": "m/V",
}
"""Names of attributes and their units."""

DATES = ("%Y-%m-%d", "%d-%m-%Y", "%I:%M:%S %p %a %b %d %Y")  # Asylum Research, Nanosurf, NanoScope
_PREFIXES = {"G": 1e9, "M": 1e6, "k": 1e3, "m": 1e-3, "µ": 1e-6, "u": 1e-6, "n": 1e-9, "p": 1e-12}
_UNITS = ("V", "m", "Hz", "s", "m/V", "N/m", "")
_NUMBER = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)\s*(\S*)", re.IGNORECASE)


@dataclass
class ScanData:
    """Known settings of a scan."""

    # By names of `CANONICAL`, in their units; what is not known is absent
    values: dict[str, float] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)  # sentences on what must not be taken for more than it is
    # Names of the values that are of the lever's type and not of this lever
    nominal: list[str] = field(default_factory=list)
    # Height and width of the image [m], where the file says it better than Gwyddion
    size: tuple[float, float] | None = None

    def set_known(self, **found: float | None) -> None:
        """Set these values, but for those that a file does not say: None and NaN."""
        self.values |= {name: value for name, value in found.items() if value is not None and math.isfinite(value)}


NOT_OURS = (ArithmeticError, AttributeError, KeyError, RecursionError, TypeError, ValueError)
"""Errors of an attribute ``configuration`` that is not there, or somebody else's."""


def settings_of_image(image: xr.Dataset) -> dict[str, Any]:
    """What an image or a sweep says of its scan: attributes, and where phasemap made it what these leave out.

    Of several setpoints it is that of the coordinate, where one was selected.
    """
    setpoint = image.coords.get("setpoint")
    selected = {} if setpoint is None or setpoint.ndim else {"setpoint": float(setpoint)}
    return {**_of_simulation(image.attrs), **image.attrs, **selected}


def is_simulated(image: xr.Dataset) -> bool:
    """True if phasemap made an image or a sweep."""
    return bool(_of_simulation(image.attrs))


def _of_simulation(attrs: Mapping[Any, Any]) -> dict[str, float]:
    """Canonical values of a simulated image or sweep, but the zero of a levelled phase; empty for others."""
    try:
        told = json.loads(attrs["configuration"])
        scope = microscope_of_configuration(told["microscope"])
        setpoint = told.get("setpoint")
        known = _of_microscope(scope, setpoint if isinstance(setpoint, int | float) else None, told.get("control", {}))
    except NOT_OURS:
        return {}
    return {name: value for name, value in known.items() if name != "phase_zero" or "levelled" not in attrs}


def recorded_microscope(attrs: Mapping[Any, Any]) -> tuple[Microscope, str] | None:
    """Microscope of a simulated image or sweep, and the law that phasemap does not have, for which DMT stands there.

    None of others.
    """
    try:
        told = json.loads(attrs["configuration"])["microscope"]
        with suppress(InputError):
            return made(told, Microscope), ""
        law = told["interaction"]["contact"]
        return microscope_of_configuration(told), law["kind"] if isinstance(law, dict) else str(law)
    except NOT_OURS:
        return None


def recorded_sign(attrs: Mapping[Any, Any]) -> int:
    """Sign of a recorded phase: -1 where the file says that lag counts positive, else 1."""
    return -1 if attrs.get("phase_sign") == -1 else 1


@unquestioned()  # who made the image was told then
def microscope_of_configuration(told: Mapping[str, Any]) -> Microscope:
    """Lever, radius, drive and detector of a configuration of `describe`, whatever its interaction."""
    lever, drive, tip = made(told["cantilever"], Cantilever), made(told["drive"], Drive), Tip(told["tip"]["radius"])
    return Microscope(lever, tip, drive, detector=told.get("detector", "slope"))


def _of_microscope(scope: Microscope, setpoint: Any, control: Mapping[str, Any]) -> dict[str, float]:
    """The canonical values of a configuration."""
    lever = scope.cantilever
    scan = ScanData()
    scan.set_known(
        drive_frequency=scope.drive.frequency or lever.resonance_frequency, free_amplitude=scope.driven_amplitude,
        setpoint=setpoint, stiffness=lever.stiffness, resonance_frequency=lever.resonance_frequency,
        quality_factor=lever.quality_factor, tip_radius=scope.tip.radius, line_rate=control.get("line_rate"),
        proportional_gain=control.get("proportional_gain"), integral_gain=control.get("integral_gain"),
        phase_zero=scope.free_phase, phase_sign=1.0,
    )  # fmt: skip
    return scan.values


def day_of(text: str | None) -> float | None:
    """Days from 1970-01-01 to a date as instruments write it; None where it is none."""
    for form in DATES:
        try:
            return float((datetime.strptime((text or "").strip(), form) - datetime(1970, 1, 1)).days)
        except ValueError:
            continue
    return None


def quantity(text: str | None) -> float | None:
    """A number with its unit in SI units, a percentage as a fraction; None where there is none."""
    match = _NUMBER.match(text or "")
    if not match or match[2].startswith(","):  # a decimal comma
        return None
    number, unit = float(match[1]), match[2].removesuffix("<sup>-1</sup>")
    if unit == "%":
        return number / 100
    if unit in _UNITS or unit[:1] not in _PREFIXES or unit[1:] not in _UNITS:
        return number
    return number * _PREFIXES[unit[0]]
