"""The base class of contact laws: one formula F(d), from which all else that solvers ask of a law follows."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import numpy as np

from phasemap._kernels.columns import RELEASE, ROW
from phasemap._kernels.forces import power_law, power_law_slope
from phasemap._shared.arrays import Array
from phasemap._shared.errors import InputError, Word
from phasemap.experiment.interaction.longrange import InverseSquare, LongRange

STEP, LEAST = 4e-3, 1e-15
"""Step of the difference quotient over the distance from release, and the least of that distance [m]."""


def is_own(law: object) -> bool:
    """True if a law is the user's, whatever it is called."""
    return not type(law).__module__.startswith("phasemap.")


class Necks(NamedTuple):
    """Necks of liquid, shape (n,) each: columns of parameter rows."""

    release: Array  # depth at which they break [m], <= 0
    forming: Array  # depth at which they form [m]
    force: Array  # attraction in contact [N]
    curve: Array  # 1 / sqrt(V / (pi R)) [1/m]
    fall: Array  # 1 / length [1/m]


class ContactLaw(ABC):
    """Force between tip and surface in contact. A law of your own is a class derived from this one, with one formula.

    `force` and `slope` are scalar formulas in plain Python, compiled on first use: they take the indentation d [m] and
    a row of parameters p. They may call other plain functions and those of `math`; p is indexed, nothing else.

    Contact forms when d rises through 0. It ends when d falls through the release depth d_r <= 0, and for d_r < d < 0,
    in the neck, the force is that of `force` and there is no damping. Without a neck (d_r = 0) the formulas are called
    with d >= 0 only.

    Examples
    --------
    >>> class Cone(ContactLaw):
    ...     @staticmethod
    ...     def force(d, p):
    ...         return 0.3 * p[0] * d * d
    >>> Cone().name, round(Cone.slope(1e-9, [1e9, 0, 1e-8] + 13 * [0]), 12)
    ('Cone', 0.6)
    """

    name: ClassVar[str] = "contact law"
    """The class's own name, unless a law sets another."""

    may_do_without_neck: ClassVar[bool] = False
    """True if contact ends at d = 0 where the long-range force leaves no energy to be lost in the neck.

    Elsewhere such a material is refused, because the loop of approach and retraction would create energy.
    """

    takes_film: ClassVar[bool] = False
    """True if the material may be a film on a rigid base."""

    wets: ClassVar[bool] = False
    """True if films of liquid draw necks, those of `necks`."""

    in_time: ClassVar[bool] = False
    """True if motion under this law can only be marched in time."""

    lossy: ClassVar[bool] = False
    """True if rows have columns WITHDRAWN, LOSS and LOSS_FALL."""

    attraction: ClassVar[LongRange] = InverseSquare()
    """The van der Waals force outside contact."""

    spread: ClassVar[float] = 0.5
    """n of the contact's radius ~ d^n, and so of the damping by a viscosity."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if "name" not in cls.__dict__:
            cls.name = cls.__name__
        for formula, slope, start in (("force", "slope", RELEASE), ("damping", "damping_slope", None)):
            if _rank(cls, formula) < _rank(cls, slope):  # a slope that is inherited is that of another formula
                setattr(cls, slope, _Quotient(formula, start))

    def __repr__(self) -> str:
        return f"{type(self).__name__}()"

    @staticmethod
    @abstractmethod
    def force(d: float, p: Array) -> float:
        """Force [N] at indentation d [m], positive repulsive."""

    @staticmethod
    def slope(d: float, p: Array) -> float:
        """dF/dd [N/m]; by default a difference quotient of fourth order, good to 1e-10 of it for powers of d."""
        raise NotImplementedError

    damping = staticmethod(power_law)
    """alpha_s [1] at indentation d >= 0, of p[8] and p[9]: the power law of the interaction."""

    damping_slope = staticmethod(power_law_slope)
    """Derivative of the damping by the depth [1/m]."""

    def columns(self, contact_stiffness: Array, adhesion: Array, radius: float) -> tuple[Array | float, ...]:
        """Parameters p[0] ... p[3] of the formulas, four at most; by default K [Pa], w [J/m2] and R [m]."""
        return contact_stiffness, adhesion, radius

    def films(self, radius: float, film: Array) -> Array:
        """p[THINNESS] and p[FILM_SERIES] of a law that `takes_film`, shape (n, 2); of others films are refused.

        `film` (shape (n, 2)): Poisson's ratio [1] and thickness [m].
        """
        allowed = f"nothing where the contact is {self.name!r}, which is that of a half-space"
        raise InputError("thickness", Word("given"), allowed, "The contact 'film' takes it.")

    def radius_at(self, depth: Array, radius: float) -> Array:
        """Radius of the contact [m] at a depth [m]; by default sqrt(R d), that of a sphere."""
        return np.sqrt(radius * depth)

    @property
    def withdrawn(self) -> Callable[[float, Array], float] | None:
        """Attraction [N] on the way out of contact beside that on the way in, of a law whose rows do not say it."""
        return None

    @property
    def hysteretic(self) -> bool:
        """True if contact may outlast its depth, in a neck."""
        return self.wets or type(self).release is not ContactLaw.release

    def pull(self, contact_stiffness: Array, adhesion: Array, radius: float) -> Array:
        """Attraction [N] >= 0 that the long-range force joins at d = 0; by default that of `force`."""
        rows = np.zeros((len(contact_stiffness), ROW))
        for j, column in enumerate(self.columns(contact_stiffness, adhesion, radius)):
            rows[:, j] = column
        return np.array([max(-self.force(0.0, row), 0.0) for row in rows])

    def release(self, contact_stiffness: Array, adhesion: Array, radius: float) -> Array:
        """Depth d_r [m] <= 0 at which contact ends; by default 0, no neck."""
        return 0.0 * contact_stiffness

    def necks(self, radius: float, liquid: Array) -> Necks:
        """Necks of liquid on a tip of this radius [m], of a law that `wets`.

        `liquid` (shape (n, 2)): thickness [m] and contact angle [degree] of films; infinite where they are the law's.
        """
        raise NotImplementedError

    def loss_outside(self) -> tuple[float, float]:
        """1 / length [1/m], and damping coefficient at d = 0 [N s/m], of a loss outside contact."""
        return 0.0, 0.0

    def beside(self, decay_length: float | None) -> ContactLaw:
        """The law beside a long-range force that falls over `decay_length` [m]; by default itself."""
        return self


def _rank(kind: type, name: str) -> int:
    """Number of classes between a class and the base that defines an attribute."""
    return next(number for number, one in enumerate(kind.__mro__) if name in vars(one))


class _Quotient:
    """Slope of a formula of a law, as that is when the slope is asked for."""

    def __init__(self, formula: str, start: int | None) -> None:
        self._formula, self._start = formula, start

    def __get__(self, law: ContactLaw | None, owner: type) -> Callable[[float, Array], float]:
        return _difference(getattr(owner if law is None else law, self._formula), self._start)


def _difference(formula: Callable[[float, Array], float], start: int | None) -> Callable[[float, Array], float]:
    """Derivative of a formula: the central difference of order 4, on the side of d = p[start] where the law holds."""

    def slope(d: float, p: Array) -> float:
        least = 0.0 if start is None else p[start]
        x = max(d - least, LEAST)
        h = STEP * x
        middle = least + x
        near = formula(middle + h, p) - formula(middle - h, p)
        far = formula(middle + 2.0 * h, p) - formula(middle - 2.0 * h, p)
        return (8.0 * near - far) / (12.0 * h)

    return slope


class SphereLaw(ContactLaw):
    """A law whose attraction is that of a sphere and a plane; its first parameters by default those of DMT."""

    def columns(self, contact_stiffness: Array, adhesion: Array, radius: float) -> tuple[Array | float, ...]:
        """p[CONTACT] = K sqrt(R) [N m^-1.5], p[PULL] = the attraction [N]."""
        return contact_stiffness * math.sqrt(radius), self.pull(contact_stiffness, adhesion, radius)

    def pull(self, contact_stiffness: Array, adhesion: Array, radius: float) -> Array:
        """2 pi w R [N]."""
        return 2 * math.pi * radius * adhesion
