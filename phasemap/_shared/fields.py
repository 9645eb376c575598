"""Value objects: numbers as their fields, what each measures and what is allowed, and how they show themselves."""

from __future__ import annotations

import math
from collections.abc import Callable
from copy import copy
from dataclasses import MISSING, Field, fields
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar, cast

from phasemap._shared.asked import asked_as
from phasemap._shared.checks import number
from phasemap._shared.errors import InputError
from phasemap._shared.notices import Usual, likely, question
from phasemap._shared.units import UDUNITS, say

if TYPE_CHECKING:
    from phasemap._shared.quantities import Scalar

C = TypeVar("C")
T = TypeVar("T", bound=float | None)
_REQUIRED: Any = object()


class Number(Generic[T]):
    """A field of a dataclass that takes a number in SI units, text with a unit or a quantity, and keeps a float.

    `unit`: as in `phasemap._shared.quantities.KINDS`.
    `default`: a field without one has to be given; None is allowed where it is the default, or with `optional`.
    `said`: what it is called where its own name says too little.
    `optional`: whether None, or the text "none", is allowed; by default where None is the default.
    `usual`: the least and the most found in practice, zero aside [unit].
    `asks`: whether the field warns of a value outside; False where its owner does, which knows what else decides.
    `bounds`: minimum, above, maximum, below: what is allowed, as for `phasemap._shared.checks.number`.
    """

    def __init__(
        self, unit: str, default: float | None = _REQUIRED, *, said: str | None = None, optional: bool | None = None,
        usual: Usual | None = None, asks: bool = True, **bounds: float,
    ) -> None:  # fmt: skip
        self.unit, self.usual, self._asks = unit, usual, asks
        self._said, self._bounds = said, bounds
        self._optional = default is None if optional is None else optional
        self._default: Any = default

    def __set_name__(self, owner: type, name: str) -> None:
        self._name, self._said = name, self._said or name

    def __get__(self, instance: object, owner: type | None = None) -> T:
        if instance is not None:
            return cast(T, instance.__dict__[self._name])
        if self._default is _REQUIRED:
            raise AttributeError(self._name)  # by which a dataclass knows that there is no default
        return cast(T, self._default)

    def __set__(self, instance: object, value: T | Scalar) -> None:
        number = None if value is None and self._default is None else self.check(value)
        if number is not None and self._asks:
            self.look_at(number)
        instance.__dict__[self._name] = number

    def check(self, value: object) -> float | None:
        """Value of the field as it is kept; an `InputError` if it is not allowed."""
        if self._optional and (value is None or (isinstance(value, str) and value == "none")):  # as a scene says it
            return None
        try:
            return number(str(self._said), value, self.unit, **self._bounds)
        except InputError as error:
            if self.usual is None or not isinstance(value, (int, float)) or not value > 0:
                raise
            meant = likely(value, self.unit, self.usual)
            hint = f"Did you mean {meant}?" if meant else ""
            raise InputError(error.name, error.value, error.allowed, hint) from None

    def called(self, said: str) -> Number[T]:
        """The same under another name."""
        other = copy(self)
        other._said = said
        return other

    @property
    def ends(self) -> tuple[float, float]:
        """Least value or the value that all are above, and the largest value allowed."""
        bounds = self._bounds
        most = math.nextafter(bounds["below"], -math.inf) if "below" in bounds else bounds.get("maximum", math.inf)
        return bounds.get("above", bounds.get("minimum", -math.inf)), most

    def look_at(self, value: float) -> None:
        """Warn of a value outside all practice."""
        if self.usual is not None:
            question(str(self._said), value, self.unit, self.usual)


def known_as(**symbols: str) -> Callable[[type[C]], type[C]]:
    """Let a dataclass say which argument was meant where a symbol of formulas, or another name, is given for it."""

    def helpful(cls: type[C]) -> type[C]:
        cls.__init__ = cast(Any, asked_as(**symbols)(cls.__init__))  # type: ignore[method-assign]
        return cls

    return helpful


def number_of(cls: type, name: str) -> Number[Any]:
    """Declaration of a field of a class that is a number."""
    number = vars(cls)[name]
    assert isinstance(number, Number)
    return number


class Shown:
    """A dataclass that says only what is not the default; it has to be declared with ``repr=False``."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    def __repr__(self) -> str:
        """Call in Python that makes the object, without what is the default."""
        fields = ", ".join(f"{field.name}={_python(getattr(self, field.name))}" for field in _given(self))
        return f"{type(self).__name__}({fields})"


def values_in_words(thing: Shown) -> str:
    """Values that are set, with units, in one line."""
    parts = []
    for field in _given(thing):
        value, number = getattr(thing, field.name), vars(type(thing)).get(field.name)
        if value is None:
            text = "none"
        elif isinstance(number, Number):
            text = say(value, UDUNITS.get(number.unit, number.unit), 6)
        elif isinstance(value, tuple) and all(isinstance(one, Shown) for one in value):
            text = " and ".join(f"({values_in_words(one)})" for one in value)
        else:
            text = str(value)
        parts.append(f"{field.name.replace('_', ' ')} {text}")
    return ", ".join(parts)


def _given(thing: Shown) -> list[Field[Any]]:
    """Fields that differ from their defaults."""
    every = [field for field in fields(thing) if field.init]
    return [field for field in every if field.default is MISSING or getattr(thing, field.name) != field.default]


def _python(value: object) -> str:
    """A value as Python writes it, numbers without many zeros."""
    short = f"{value:g}" if isinstance(value, float) else ""
    return short if "e" in short and float(short) == value else repr(value)
