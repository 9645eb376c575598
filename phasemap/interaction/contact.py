"""Forces in contact. A law is one class in this file and one entry of `LAWS`.

A law's `force` and `slope` are scalar formulas in plain Python, compiled on first use: they take the indentation d [m]
and the row of parameters that `columns` made. They are called with d >= 0 only.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Protocol, runtime_checkable

if TYPE_CHECKING:
    import numpy as np


@runtime_checkable
class ContactLaw(Protocol):
    """What a contact law offers."""

    name: str

    def columns(self, contact_stiffness: np.ndarray, adhesion: np.ndarray, radius: float) -> tuple[np.ndarray, ...]:
        """At most four parameters p[0] ... p[3] of the formulas, from K [Pa], w [J/m2] and R [m]."""
        ...

    def pull(self, contact_stiffness: np.ndarray, adhesion: np.ndarray, radius: float) -> np.ndarray:
        """Attraction [N] that the long-range force joins at d = 0."""
        ...

    @staticmethod
    def force(d: float, p: np.ndarray) -> float:
        """Force [N] at indentation d [m], positive repulsive."""
        ...

    @staticmethod
    def slope(d: float, p: np.ndarray) -> float:
        """dF/dd [N/m]."""
        ...


class _ThreeHalves:
    """F = p[0] d^(3/2) - p[1]: a sphere pressed into an elastic half-space."""

    @staticmethod
    def force(d: float, p: np.ndarray) -> float:
        return p[0] * d * math.sqrt(d) - p[1]

    @staticmethod
    def slope(d: float, p: np.ndarray) -> float:
        return 1.5 * p[0] * math.sqrt(d)

    def columns(self, contact_stiffness: np.ndarray, adhesion: np.ndarray, radius: float) -> tuple[np.ndarray, ...]:
        return contact_stiffness * math.sqrt(radius), self.pull(contact_stiffness, adhesion, radius)

    def pull(self, contact_stiffness: np.ndarray, adhesion: np.ndarray, radius: float) -> np.ndarray:
        return 2 * math.pi * radius * adhesion


class DMT(_ThreeHalves):
    """F = K sqrt(R) d^(3/2) - 2 pi w R (Derjaguin, Muller, Toporov 1975; Wang 1999, Eq. 2)."""

    name = "dmt"


class Hertz(_ThreeHalves):
    """F = K sqrt(R) d^(3/2) (Hertz 1881): no adhesion, in contact or before it."""

    name = "hertz"

    def pull(self, contact_stiffness: np.ndarray, adhesion: np.ndarray, radius: float) -> np.ndarray:
        return 0.0 * adhesion


LAWS: dict[str, ContactLaw] = {law.name: law for law in (Hertz(), DMT())}
