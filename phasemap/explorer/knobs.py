"""The sliders and choices of the page, which its file ``knobs.json`` declares, and what a subject has in each."""

from __future__ import annotations

import json
import re
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

from phasemap.experiment.control import Engage
from phasemap.experiment.interaction import ContactLaw
from phasemap.experiment.prony import Prony, spectrum_name
from phasemap.explorer.subject import Subject
from phasemap.results.variables import describe

LOSSES = "materials.*.loss"  # a choice of the page alone: the keys that it shows say the same
FIRST_ALONE = {"free_amplitude": None, "detection": "fm"}  # of a second mode that is not driven


class Knob(NamedTuple):
    """A slider: a number with ends."""

    label: str
    unit: str
    size: float  # of the unit [SI]
    # low, high: ends of the slider [SI]; a number that is typed in may lie beyond
    low: float
    high: float


@cache
def knobs() -> dict[str, Knob]:
    """Every slider with ends of its own, by the key of a scene that it sets; * stands for any material."""
    return {
        one["key"]: Knob(one["label"], one["unit"], one.get("size", 1.0), one["low"], one["high"])
        for one in _declared()
        if "low" in one
    }


def starred(key: str) -> str:
    """The key with * in place of the number of a material."""
    return re.sub(r"^materials\.\d+\.", "materials.*.", key)


def values_of(subject: Subject) -> dict[str, Any]:
    """What a subject has in each slider and choice; a law of the user's own by its name."""
    control = describe(subject.options.get("control") or Engage())
    found: dict[str, Any] = {}
    for one in _declared():
        part, _, name = one["key"].rpartition(".")
        if "presets" in one or one["key"] == LOSSES:
            continue
        if part == "materials.*":
            every = enumerate(subject.materials.values())
            found |= {f"materials.{i}.{name}": _plain(getattr(it, name)) for i, it in every}
        elif part == "scan":
            found[one["key"]] = subject.options[name]
        elif part == "detector":
            found[one["key"]] = subject.scope.detector
        elif part == "drive.second":
            found[one["key"]] = getattr(subject.scope.drive.second, name, FIRST_ALONE[name])
        elif part == "realism":
            found[one["key"]] = getattr(subject.realism, name)
        else:
            found[one["key"]] = control.get(name) if part == "control" else getattr(getattr(subject.scope, part), name)
    contact, modes = found["interaction.contact"], len(subject.scope.cantilever.eigenmodes)
    law = contact.name if isinstance(contact, ContactLaw) else contact
    return found | {"interaction.contact": law, "cantilever.modes": modes}


def _plain(value: Any) -> Any:
    """A number, or the name of a spectrum."""
    return spectrum_name(value) if isinstance(value, Prony) else value


@cache
def _declared() -> list[dict[str, Any]]:
    """What the page's file declares."""
    declared: list[dict[str, Any]] = json.loads(files("phasemap.explorer").joinpath("page", "knobs.json").read_bytes())
    return declared
