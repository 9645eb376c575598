"""What the keys of a scene measure, as the objects say that they become."""

from __future__ import annotations

from typing import Any

from phasemap._shared.errors import InputError
from phasemap._shared.fields import Number
from phasemap._shared.quantities import NotThatUnit, in_si, is_number, with_unit
from phasemap.experiment.accuracy import Accuracy
from phasemap.experiment.control import Feedback
from phasemap.experiment.interaction import Interaction
from phasemap.experiment.material import Material
from phasemap.experiment.microscope import Cantilever, Drive, Mode, Tip
from phasemap.experiment.realism import Realism, TipChange

OWNERS: dict[str, type] = {
    "cantilever": Cantilever, "tip": Tip, "drive": Drive, "drive.second": Mode, "interaction": Interaction,
    "control": Feedback, "accuracy": Accuracy, "realism": Realism, "realism.tip_change": TipChange,
}  # fmt: skip


def unit_of(key: str) -> str:
    """The unit of a key, as in `phasemap._shared.quantities.KINDS`; empty where it may have any."""
    table, _, name = key.rpartition(".")
    owner = Material if table.startswith("materials.") else OWNERS.get(table)
    number = vars(owner).get(name) if owner is not None else None
    return number.unit if isinstance(number, Number) else "1" if key == "scan.setpoint" else ""


def plain(shown: str, key: str, value: Any) -> Any:
    """Return text with a unit as a number in SI units, and any other value of a key as it is."""
    if not isinstance(value, str) or not is_number(value):
        return value
    unit = unit_of(key)
    try:
        return in_si(value, unit)
    except NotThatUnit:
        raise InputError(shown, value, with_unit(unit)) from None
