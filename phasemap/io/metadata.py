"""How an image was scanned: canonical names, their units, and numbers as vendors write them."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

CANONICAL = {
    "drive_frequency": "Hz",
    "free_amplitude": "m",  # of the free lever at the drive frequency
    "setpoint": "1",  # amplitude over free amplitude
    "stiffness": "N/m",
    "resonance_frequency": "Hz",
    "quality_factor": "1",
    "line_rate": "Hz",  # lines a second, each trace and retrace
    "proportional_gain": "1",  # gains are in units of the vendor
    "integral_gain": "1",
    "drive_voltage": "V",
    "phase_sign": "1",  # -1 where lag counts positive, which is as the vendor documents it
    "phase_zero": "degree",  # recorded phase of the free lever at the drive frequency
    "setpoint_amplitude": "m",
    "free_amplitude_voltage": "V",  # volts where no sensitivity makes metres of them
    "setpoint_voltage": "V",
    "amplitude_sensitivity": "m/V",
}
"""Names of attributes and their units."""

_PREFIXES = {"G": 1e9, "M": 1e6, "k": 1e3, "m": 1e-3, "µ": 1e-6, "u": 1e-6, "n": 1e-9, "p": 1e-12}
_UNITS = ("V", "m", "Hz", "s", "m/V", "N/m", "")
_NUMBER = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)\s*(\S*)", re.IGNORECASE)


@dataclass
class ScanData:
    """What is known about a scan."""

    # By names of `CANONICAL`, in their units; what is not known is absent
    values: dict[str, float] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)  # sentences on what must not be taken for more than it is
    # Names of the values that are of the lever's type and not of this lever
    nominal: list[str] = field(default_factory=list)
    # Height and width of the image [m], where the file says it better than Gwyddion
    size: tuple[float, float] | None = None

    def take(self, **found: float | None) -> None:
        """Keep the values that are there."""
        self.values |= {name: value for name, value in found.items() if value is not None and math.isfinite(value)}


def of_simulation(attrs: Mapping[Any, Any]) -> dict[str, float]:
    """The canonical values of an image that phasemap simulated.

    It is empty for other images, and without the zero of a phase that was levelled.
    """
    try:
        told = json.loads(attrs["configuration"])
        lever, drive = told["microscope"]["cantilever"], told["microscope"]["drive"]
        return _of_tables(lever, drive, told["setpoint"], told["control"], "levelled" in attrs)
    except (ArithmeticError, AttributeError, KeyError, RecursionError, TypeError, ValueError):
        return {}  # the attribute may be there and be somebody else's


def _of_tables(
    lever: Mapping[str, Any], drive: Mapping[str, Any], setpoint: Any, control: Mapping[str, Any], levelled: bool
) -> dict[str, float]:
    """The canonical values of a configuration."""
    resonance, quality = lever["resonance_frequency"], lever["quality_factor"]
    frequency = drive["frequency"] or resonance
    ratio, deflection = frequency / resonance, drive.get("excitation") == "base"
    scan = ScanData()
    scan.take(
        drive_frequency=frequency,
        free_amplitude=drive["free_amplitude"] / off_resonance(ratio, quality, deflection),
        setpoint=setpoint,
        stiffness=lever["stiffness"],
        resonance_frequency=resonance,
        quality_factor=quality,
        line_rate=control.get("line_rate"),
        proportional_gain=control.get("proportional_gain"),
        integral_gain=control.get("integral_gain"),
        phase_zero=phase_of_free(ratio, quality, deflection),
    )
    if levelled:
        del scan.values["phase_zero"]
    return scan.values


def off_resonance(ratio: float, quality: float, deflection: bool = False) -> float:
    """Amplitude of the free tip at resonance over what is seen at `ratio` times the resonance frequency [1].

    `deflection`: whether the detector sees the deflection of a lever whose base is driven, and not the position of
        the tip.

    Examples
    --------
    >>> off_resonance(1.0, 400.0), round(off_resonance(1.0, 3.0, True), 4)
    (1.0, 0.9487)
    """
    seen = math.hypot(ratio**2, ratio / quality) if deflection else 1.0
    return quality * math.hypot(1 - ratio**2, ratio / quality) / seen


def phase_of_free(ratio: float, quality: float, deflection: bool) -> float:
    """Phase that is seen of the free lever at `ratio` times the resonance frequency [degree]."""
    phase = math.atan2(quality * (1 / ratio - ratio), 1.0)
    if deflection:
        phase += math.atan(1 / quality) - math.atan2(1 / quality, ratio)
    return math.degrees(phase)


def quantity(text: str | None) -> float | None:
    """A number with its unit in SI units, a percentage as a fraction; None where there is none.

    Examples
    --------
    >>> quantity("172.823kHz"), quantity("50 %"), quantity("none")
    (172823.0, 0.5, None)
    """
    found = _NUMBER.match(text or "")
    if not found:
        return None
    number, unit = float(found[1]), found[2].removesuffix("<sup>-1</sup>")
    if unit == "%":
        return number / 100
    if unit in _UNITS or unit[:1] not in _PREFIXES or unit[1:] not in _UNITS:
        return number
    return number * _PREFIXES[unit[0]]
