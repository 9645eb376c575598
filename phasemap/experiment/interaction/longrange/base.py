"""The base class of long-range laws."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, ClassVar

from phasemap._kernels.columns import BIAS, INVERSE_REACH, LONGRANGE

if TYPE_CHECKING:
    import numpy as np

    Array = np.ndarray

CLOSEST = 0.3e-9  # gap at contact [m] where there is no decay length


class LongRange(ABC):
    """Force between tip and surface outside contact, d <= 0 (d = minus the gap).

    `force` and `slope` are scalar formulas in plain Python as those of a `ContactLaw`: they take d [m] and a row of
    parameters p, of which p[4] ... p[7] are those of `columns`. A part of the force that stays what it is at d = 0
    while the tip is in contact is said by `in_contact`, and stands at p[11].
    """

    name: ClassVar[str] = "long-range law"
    attracts: ClassVar[bool] = False
    """Whether it attracts, the more the nearer the tip. Averaging decides the branch of such forces alone."""

    @staticmethod
    @abstractmethod
    def force(d: float, p: Array) -> float:
        """Force [N], positive repulsive."""

    @staticmethod
    @abstractmethod
    def slope(d: float, p: Array) -> float:
        """dF/dd [N/m]."""

    @abstractmethod
    def columns(self, pull: Array, decay_length: float | None, radius: float) -> tuple[Array | float, ...]:
        """At most four: the whole attraction at d = 0 [N], and 1 over the length on which it changes there [1/m]; more.

        `pull`: the van der Waals attraction at d = 0 [N], which falls over `decay_length` [m] if there is one.
        """

    def in_contact(self, decay_length: float | None, radius: float) -> float:
        """Attraction [N] in contact beside that of the contact law, negative repulsive."""
        return 0.0


def vanderwaals(d: float, p: Array) -> float:
    """The inverse-square attraction [N] beside another force that p[BIAS] is of at d = 0."""
    s = 1.0 - d * p[INVERSE_REACH]
    return -(p[LONGRANGE] - p[BIAS]) / (s * s)


def vanderwaals_slope(d: float, p: Array) -> float:
    """Its derivative [N/m]."""
    s = 1.0 - d * p[INVERSE_REACH]
    return -2.0 * (p[LONGRANGE] - p[BIAS]) * p[INVERSE_REACH] / (s * s * s)


def whole(pull: Array, decay_length: float | None, other: float, scale: float) -> Array:
    """Attraction at d = 0 [N] of the van der Waals force, if there is one, and another force of this scale [N].

    It is 0 where there is no force at any d only.
    """
    import numpy as np

    found = (pull if decay_length is not None else 0.0 * pull) + other
    return np.where(found == 0.0, 1e-15 * scale, found)
