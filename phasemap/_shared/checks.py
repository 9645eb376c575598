"""Checks of single values, shared by the value objects."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Sequence
from numbers import Integral, Real
from typing import Any

from phasemap._shared.errors import InputError
from phasemap._shared.memory import check_fits
from phasemap._shared.quantities import KINDS, NotThatUnit, array_in_si, in_si, is_quantity, range_in_si, with_unit

LONGEST = 10**8  # pixels along a side, so that numbers of pixels and of bytes fit into 64 bits
WIDEST = 1e100  # m, of a pixel or a disc, so that their squares are finite
HIGHEST = 2**128 - 1  # of whole numbers without a maximum of their own; seeds have 128 bits


def number(
    name: str, value: object, unit: str, *, minimum: float = -math.inf, above: float = -math.inf,
    maximum: float = math.inf, below: float = math.inf,
) -> float:  # fmt: skip
    """Return a number, text with a unit or a quantity as a float in `unit`."""
    given = value
    if isinstance(value, str) or is_quantity(value):
        try:
            given = in_si(value, unit)
        except NotThatUnit:
            allowed = range_in_words(unit, minimum=minimum, above=above, maximum=maximum, below=below)
            raise InputError(
                name, value, allowed + (f", or {with_unit(unit)}" if unit not in ("1", "") else "")
            ) from None
    if isinstance(given, Real) and not isinstance(given, bool):
        try:
            x = float(given)
        except OverflowError:
            x = math.inf
        if math.isfinite(x) and minimum <= x <= maximum and above < x < below:
            return x
        if abs(x) <= WIDEST:  # a limit beyond is for arithmetic, and of no interest to people
            minimum, above = (limit if limit > -WIDEST else -math.inf for limit in (minimum, above))
            maximum, below = (limit if limit < WIDEST else math.inf for limit in (maximum, below))
    raise InputError(name, value, range_in_words(unit, minimum=minimum, above=above, maximum=maximum, below=below))


def numbers(name: str, values: Any, unit: str) -> Any:
    """Return what may be many numbers, but for those with units, as it is, and those as a float or an array in `unit`.

    `values`: text ("40 nm", "60 nm:10 nm:100"), a quantity, lists of them, or anything else.
    """
    try:
        if not isinstance(values, str):
            return array_in_si(values, unit)
        spread = range_in_si(values, unit)
    except NotThatUnit:
        example = KINDS[unit][1]
        allowed = f"numbers{f' in {unit}' if unit != '1' else ''}, with units such as {example!r}, or START:STOP:N"
        raise InputError(name, values, allowed) from None
    if len(spread) == 1:
        return spread[0]
    import numpy as np

    check_fits(name, 8.0 * spread[2], "Give fewer numbers.")
    return np.linspace(spread[0], spread[1], int(spread[2]))


def range_in_words(
    unit: str, *, minimum: float = -math.inf, above: float = -math.inf, maximum: float = math.inf,
    below: float = math.inf,
) -> str:  # fmt: skip
    """Say a range so that it reads well aloud."""
    bounds = []
    if max(above, minimum) > -math.inf:
        bounds.append(f"above {above:g}" if above >= minimum else f"of at least {minimum:g}")
    if min(below, maximum) < math.inf:
        of = "" if bounds else "of "
        bounds.append(f"below {below:g}" if below <= maximum else f"{of}at most {maximum:g}")
    shown = "" if unit in ("1", "") else f" {unit}" if bounds else f", in {unit}"
    return " ".join(["a finite number", " and ".join(bounds)]).rstrip() + shown


def whole(name: str, value: object, minimum: int, maximum: int | None = None) -> int:
    """Return `value` as an int, or raise `InputError`."""
    if isinstance(value, Integral) and not isinstance(value, bool):
        n = int(value)
        if n >= minimum and n <= (HIGHEST if maximum is None else maximum):
            return n
        if n > HIGHEST and maximum is None:
            maximum = HIGHEST
    allowed = f"of at least {minimum}" if maximum is None else f"from {minimum} to {maximum}"
    raise InputError(name, value, f"a whole number {allowed}")


def is_sign(value: object) -> bool:
    """True if a value is 1 or -1."""
    return isinstance(value, Real) and not isinstance(value, bool) and value in (1, -1)


def check_choice(name: str, value: object, choices: Iterable[str]) -> None:
    """Refuse what is not one of the choices."""
    choices = list(choices)
    if not isinstance(value, str) or value not in choices:
        known = {choice.casefold(): choice for choice in choices}
        near = difflib.get_close_matches(value.casefold(), known, 1, 0.5) if isinstance(value, str) else []
        hint = f"Did you mean {known[near[0]]!r}?" if near else ""
        raise InputError(name, value, "one of " + ", ".join(choices), hint)


def shape_pair(value: object) -> tuple[int, int]:
    """Return `value` as (rows, columns), or raise `InputError`."""
    if isinstance(value, (str, bytes)) or not isinstance(value, Sequence) or len(value) != 2:
        raise InputError("shape", value, "two whole numbers, (rows, columns)")
    for name, side in zip(("number of rows", "number of columns"), value, strict=True):
        whole(name, side, 1)
        whole(name, side, 1, LONGEST)
    return int(value[0]), int(value[1])


def pixel_pair(value: object) -> tuple[float, float]:
    """Return `value` as the (dy, dx) of one pixel [m], or raise `InputError`."""
    if isinstance(value, Sequence) and not isinstance(value, (str, bytes)):
        if len(value) != 2:
            raise InputError("pixel_size", value, "one length in m, or two, (dy, dx)")
        return _side("pixel_size dy", value[0]), _side("pixel_size dx", value[1])
    if getattr(getattr(value, "magnitude", None), "shape", ()) == (2,):
        return pixel_pair(list(value))  # type: ignore[call-overload]
    size = _side("pixel_size", value)
    return size, size


def _side(name: str, value: object) -> float:
    """Return the side of a pixel [m]; the size of the largest image can still be squared."""
    return number(name, value, "m", above=0, maximum=WIDEST)
