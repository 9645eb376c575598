"""Forces outside contact: one law per file, each with its formula, source and equation number."""

from __future__ import annotations

from typing import Any

from phasemap.experiment.interaction.longrange.base import LongRange
from phasemap.experiment.interaction.longrange.dlvo import DLVO
from phasemap.experiment.interaction.longrange.electrostatic import Biased
from phasemap.experiment.interaction.longrange.hydration import Hydration
from phasemap.experiment.interaction.longrange.lennard_jones import LennardJones
from phasemap.experiment.interaction.longrange.solvation import Solvation
from phasemap.experiment.interaction.longrange.vanderwaals import Inverse, InverseSquare

__all__ = [
    "DLVO",
    "FORCES",
    "Biased",
    "Hydration",
    "Inverse",
    "InverseSquare",
    "LennardJones",
    "LongRange",
    "Solvation",
]

FORCES: dict[str, type[Any]] = {law.name: law for law in (DLVO, Hydration, Solvation, LennardJones)}
"""Laws that may stand in place of the van der Waals force."""
