"""Numbers with units: text such as "40 nm" and quantities of pint, as numbers in SI units.

Pint knows what units are called and how large they are; it is imported when the first text or quantity comes.
"""

from __future__ import annotations

import re
from decimal import Decimal
from functools import cache
from typing import TYPE_CHECKING, Any, TypeAlias

from phasemap._shared.units import UDUNITS

if TYPE_CHECKING:
    import pint

Scalar: TypeAlias = "float | str | pint.Quantity[Any]"
"""Type of an argument that is a number: a number in SI units, text with a unit, or a quantity of pint."""

LONGEST = 80  # characters of a number with its unit
KINDS = {
    "1": ("a plain number", "0.7"), "m": ("a length", "40 nm"), "Pa": ("a modulus", "3 GPa"),
    "J/m2": ("an energy per area", "50 mJ/m^2"), "N/m": ("a stiffness", "40 N/m"), "Hz": ("a frequency", "300 kHz"),
    "Pa s": ("a viscosity", "0.5 Pa s"), "V": ("a voltage", "5 V"), "K": ("a temperature", "300 K"),
    "C/m2": ("a charge per area", "10 mC/m^2"), "N s/m": ("a damping coefficient", "0.1 uN s/m"),
    "degree": ("an angle", "20 degrees"), "s": ("a time", "20 us"), "1/s": ("a rate", "500 1/s"),
    "m/sqrt(Hz)": ("a density of noise", "20 fm/sqrt(Hz)"),
    "kg/m3": ("a density", "998 kg/m^3"), "": ("a number with any unit", "3 GPa"),
}  # fmt: skip
"""Quantities that units measure, and an example of each, in words."""
KINDS |= {UDUNITS[unit]: KINDS[unit] for unit in UDUNITS}

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?"
_NAME = r"[A-Za-zµμΩÅ°%]+"
_FACTOR = rf"(?:sqrt\({_NAME}\)|{_NAME}(?:(?:\*\*|\^)?[-+]?\d(?:\.\d)?|⁻?[¹²³])?)"
_UNIT = rf"(?:1/)?{_FACTOR}(?:[*/·. ]{_FACTOR})*"  # one space at most, and none beside a sign
_QUANTITY = re.compile(rf"({_NUMBER}) ?({_UNIT})?")
_POWER = re.compile(r"(?<=[A-Za-zµμΩÅ°])(?=[-+]?\d)")  # of "m2" and "m-2", which pint writes m**2 and m**-2
_TIMES = re.compile(r"(?<=[A-Za-zµμΩÅ°²³])\.(?=[A-Za-z])")  # of "Pa.s"
_ROOT = re.compile(rf"sqrt\(({_NAME})\)")
_SPACES = re.compile(r"\s*([*/·^()]|\s)\s*")


class NotThatUnit(ValueError):
    """Text that is not a number with a unit, or one of another kind."""


def is_quantity(value: object) -> bool:
    """True if a value is a quantity of pint, told without importing it."""
    return hasattr(value, "dimensionality") and hasattr(value, "magnitude")


def in_si(value: object, unit: str) -> object:
    """Return text or a quantity as a number in `unit`, correctly rounded, and anything else as it is.

    `unit`: as in `KINDS`, or as UDUNITS writes it; empty for any, in SI units without a prefix, and degrees.
    Raises NotThatUnit if text is not a number with a unit, or what it measures is not what `unit` does. Turns and
        radians are angles, and an angle is not a plain number: "5 rad/s" is not a frequency.
    """
    if isinstance(value, str):
        number, written = split(value)
        return _converted(number, written, unit)
    if is_quantity(value):
        magnitude = value.magnitude  # type: ignore[attr-defined]
        if getattr(magnitude, "ndim", 0):
            return array_in_si(value, unit)
        return _converted(repr(float(magnitude)), str(value.units), unit)  # type: ignore[attr-defined]
    return value


def array_in_si(value: Any, unit: str) -> Any:
    """An array of a quantity, or lists with text in them, as numbers in `unit` as in `in_si`, or else as it is."""
    if isinstance(value, (list, tuple)):
        return [array_in_si(one, unit) for one in value] if _has_text(value, 2) else value
    if not is_quantity(value) or not getattr(value.magnitude, "ndim", 0):
        return in_si(value, unit)
    return scaled(value.magnitude, str(value.units), unit)


def scaled(values: Any, written: str, unit: str) -> Any:
    """Numbers or an array, lazy or not, from the unit that is written in `unit`, rounded once, or NotThatUnit."""
    if written == unit:
        return values
    size = Decimal(repr(_converted("1", written, unit)))
    if size == 1:
        return values
    if hasattr(values, "astype"):
        values = values.astype("float64")
    return values * float(size) if size > 1 else values / float(1 / size)


def range_in_si(text: str, unit: str) -> tuple[float, ...]:
    """Read START:STOP:N, or one number alone, as a tuple; what has no unit is in SI units."""
    parts = text.split(":")
    ends = [float(part) if split(part)[1] == "" else float(str(in_si(part, unit))) for part in parts[:2]]
    if len(parts) == 1:
        return tuple(ends)
    if len(parts) != 3 or not re.fullmatch(r" *[1-9]\d{0,7} *", parts[2]) or int(parts[2]) < 2:
        raise NotThatUnit(text)
    return *ends, int(parts[2])


def split(text: str) -> tuple[str, str]:
    """Split text into a number and its unit, empty for a plain number; raises NotThatUnit if it is something else."""
    plain = _SPACES.sub(r"\1", text.strip().replace("\N{MINUS SIGN}", "-")) if len(text) <= LONGEST else ""
    match = _QUANTITY.fullmatch(plain)
    if match is None:
        raise NotThatUnit(text)
    return match[1], match[2] or ""


def is_number(text: str) -> bool:
    """True if text is a number, with a unit or without."""
    try:
        split(text)
    except NotThatUnit:
        return False
    return True


def unit_of(value: object) -> str:
    """The unit of text or a quantity, as it is written; empty for a plain number."""
    if isinstance(value, str):
        return split(value)[1]
    return str(value.units) if is_quantity(value) else ""  # type: ignore[attr-defined]


def is_in(value: object, unit: str) -> bool:
    """True if text or a quantity measures what a unit does."""
    try:
        in_si(value, unit)
    except NotThatUnit:
        return False
    return True


def with_unit(unit: str) -> str:
    """Say what text may be given for a number."""
    kind, example = KINDS[unit]
    return f"{kind} such as {example!r}"


def _has_text(values: Any, depth: int) -> bool:
    """True if there is text or a quantity in lists that are this deep at most."""
    return any(
        depth > 1 and _has_text(one, depth - 1)
        if isinstance(one, (list, tuple))
        else isinstance(one, str) or is_quantity(one)
        for one in values
    )


@cache
def _registry() -> pint.UnitRegistry[Any]:
    """Registry of all units of pint, in decimal numbers, so that 40 nm is 40e-9 m to the last bit."""
    import pint

    return pint.UnitRegistry(non_int_type=Decimal, autoconvert_offset_to_baseunit=True)


def _converted(number: str, written: str, unit: str) -> float:
    """Convert a number of one unit into another of the same kind."""
    registry = _registry()
    try:
        given = registry.Quantity(Decimal(number), _parsed(written))
        if not unit:
            base = given.to_base_units()
            return float(base.m_as("degree") if base.units == registry.radian else base.magnitude)
        wanted = registry.Quantity(Decimal(1), _parsed(unit))
        if given.to_root_units().units == wanted.to_root_units().units:
            return float(given.m_as(wanted.units))
    except Exception:  # pint raises what comes up, for what it does not know
        pass
    raise NotThatUnit(f"{number} {written}")


@cache
def _parsed(written: str) -> Any:
    """A unit of pint's registry."""
    text = _TIMES.sub("*", _ROOT.sub(r"\1**0.5", written))
    return _registry().parse_units(_POWER.sub("**", "" if text == "1" else text))
