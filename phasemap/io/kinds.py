"""The quantities that microscopes record: how their channels are called, and their units."""

from __future__ import annotations

import re
from typing import NamedTuple


class Kind(NamedTuple):
    """A quantity that microscopes record: how its channels are called, its units and its long name."""

    pattern: re.Pattern[str]
    units: dict[str, tuple[float, str]]  # unit in the file: factor to the unit of the Dataset, that unit
    what: str
    long_name: str


def _called(words: str) -> re.Pattern[str]:
    """Not of a higher eigenmode; the first may have a number."""
    return re.compile(rf"(?:{words})(?![\s_]*(?:error|sens|offset|[2-9]))", re.IGNORECASE)


METRES = {"m": (1.0, "m"), "um": (1e-6, "m"), "µm": (1e-6, "m"), "μm": (1e-6, "m"), "nm": (1e-9, "m")}
"""Lengths; the letter micro is one of two characters."""
_DEGREE, _RADIAN = (1.0, "degree"), (57.29577951308232, "degree")
_ANGLES = {"deg": _DEGREE, "degree": _DEGREE, "degrees": _DEGREE, "°": _DEGREE, "rad": _RADIAN, "radian": _RADIAN}
_AMPLITUDE = METRES | {"V": (1.0, "V"), "mV": (1e-3, "V")}
KINDS = {
    "height": Kind(
        re.compile("height|z[- ]?(?:axis|sensor|height|detector|drive)|topography", re.IGNORECASE),
        METRES, "a length", "recorded height",
    ),
    "phase": Kind(
        _called("phase|lock-?in phase|ncm phase|tapping phase"),
        _ANGLES, "an angle", "recorded phase, zero and sign as the instrument has them",
    ),
    "amplitude": Kind(
        _called("amplitude|lock-?in amplitude|ncm amplitude"), _AMPLITUDE, "a length or a voltage", "recorded amplitude"
    ),
    "amplitude_error": Kind(
        re.compile(r"amplitude[\s_]*error", re.IGNORECASE),
        _AMPLITUDE, "a length or a voltage", "recorded amplitude less setpoint",
    ),
}  # fmt: skip
"""By the variable of the Dataset."""
