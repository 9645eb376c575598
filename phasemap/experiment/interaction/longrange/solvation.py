"""The force of a liquid that lies in layers between two surfaces."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from phasemap._kernels.columns import LONGRANGE
from phasemap._shared.fields import Number
from phasemap.experiment.interaction.longrange.base import LongRange

if TYPE_CHECKING:
    import numpy as np

WAVENUMBER, INVERSE_DECAY = 6, 7  # columns: 2 pi/sigma [1/m], 1/lambda [1/m]


@dataclass(frozen=True)
class Solvation(LongRange):
    """F = -2 pi R (w + W) cos(2 pi d/sigma) exp(d/lambda), w the material's adhesion.

    Israelachvili, Intermolecular and Surface Forces, 3rd ed. (2011), chapter 15: between layers of molecules the
    pressure oscillates with the gap, at a period of about their size, and falls exponentially. By Derjaguin: theory,
    Eq. (longrange-3). All adhesion is of this kind: there is no other attraction, and no decay length. In contact the
    force stays what it is at d = 0.

    Parameters
    ----------
    strength : float
        W [J/m2], beside the adhesion of the materials; negative where it repels at contact.
    period : float
        sigma [m], > 0.
    decay : float
        lambda [m], > 0.
    """

    strength: Number[float] = Number("J/m2", 0.0, minimum=-1e3, maximum=1e3, usual=(1e-6, 1.0))
    period: Number[float] = Number("m", 0.3e-9, above=0, usual=(0.1e-9, 10e-9))
    decay: Number[float] = Number("m", 0.3e-9, above=0, usual=(0.05e-9, 100e-9))
    name: ClassVar[str] = "solvation"

    def columns(self, pull: np.ndarray, decay_length: float | None, radius: float) -> tuple[np.ndarray | float, ...]:
        """p[WAVENUMBER] = 2 pi/sigma [1/m], p[INVERSE_DECAY] = 1/lambda [1/m]."""
        other, wavenumber = self.in_contact(decay_length, radius), 2 * math.pi / self.period
        return pull + other, max(wavenumber, 1 / self.decay), wavenumber, 1 / self.decay

    def in_contact(self, decay_length: float | None, radius: float) -> float:
        return 2 * math.pi * radius * self.strength

    @staticmethod
    def force(d: float, p: np.ndarray) -> float:
        return -p[LONGRANGE] * math.cos(d * p[WAVENUMBER]) * math.exp(d * p[INVERSE_DECAY])

    @staticmethod
    def slope(d: float, p: np.ndarray) -> float:
        x = d * p[WAVENUMBER]
        turn = p[INVERSE_DECAY] * math.cos(x) - p[WAVENUMBER] * math.sin(x)
        return -p[LONGRANGE] * turn * math.exp(d * p[INVERSE_DECAY])
