"""Configuration objects as plain JSON values, and made of them again."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, TypeVar

from phasemap._shared.errors import InputError
from phasemap._shared.notices import unquestioned
from phasemap.experiment.accuracy import Accuracy
from phasemap.experiment.beam import Eigenmode
from phasemap.experiment.control import Engage, Feedback, Raster
from phasemap.experiment.interaction import WITH_PARAMETERS, ContactLaw, Interaction
from phasemap.experiment.interaction.base import is_own
from phasemap.experiment.interaction.longrange import FORCES, LongRange
from phasemap.experiment.microscope import PARTS, Cantilever, Drive, Microscope, Mode, Tip
from phasemap.experiment.realism import Realism, TipChange

T = TypeVar("T")

KINDS: dict[str, type[Any]] = {
    cls.__name__.lower(): cls
    for cls in (
        *FORCES.values(), *WITH_PARAMETERS.values(), Accuracy, Cantilever, Drive, Eigenmode, Engage, Feedback,
        Interaction, Microscope, Mode, Raster, Realism, Tip, TipChange,
    )
}  # fmt: skip
"""Classes of the objects that `describe` takes."""


def describe(thing: Any) -> Any:
    """A configuration object as plain JSON values."""
    own = isinstance(thing, ContactLaw | LongRange) and is_own(thing)
    if dataclasses.is_dataclass(thing) and not isinstance(thing, type):
        fields = {f.name: describe(getattr(thing, f.name)) for f in dataclasses.fields(thing)}
        return {"kind": _whole_name(thing) if own else type(thing).__name__.lower(), **fields}
    if own:
        return _whole_name(thing)
    if isinstance(thing, tuple):
        return [describe(one) for one in thing]
    return thing if thing is None or isinstance(thing, (bool, int, float, str)) else getattr(thing, "name", str(thing))


def _whole_name(law: object) -> str:
    """Name of a user's law, which may be called as one of phasemap's is."""
    return f"{type(law).__module__}.{type(law).__qualname__}"


def made(stored: Any, *kinds: type[T]) -> T:
    """The object, of one of these kinds, that `describe` described."""
    try:
        with unquestioned():  # who made the image was told already
            thing = _rebuilt(stored)
    except RecursionError:
        raise InputError("configuration of the image", stored, "tables that are not nested so deeply") from None
    if not isinstance(thing, kinds):
        raise InputError("configuration of the image", stored, " or ".join(kind.__name__ for kind in kinds))
    return thing


def _rebuilt(stored: Any) -> Any:
    """Objects rebuilt from the JSON values of `describe`."""
    if isinstance(stored, list):
        return tuple(map(_rebuilt, stored))
    if not isinstance(stored, Mapping):
        return stored
    fields = {name: _rebuilt(value) for name, value in stored.items() if name != "kind"}
    kind = stored.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        raise InputError("kind", kind, "one of " + ", ".join(KINDS))
    if kind == "cantilever":
        fields.setdefault("participation", 1.0)  # of images from before beams, whose lever was a point mass
    known = [field.name for field in dataclasses.fields(KINDS[kind])]
    if set(fields) - set(known):
        raise InputError(f"configuration of {kind}", ", ".join(fields), ", ".join(known))
    for name, part in PARTS.items() if kind == "microscope" else ():
        if not isinstance(fields.get(name), part):
            raise InputError(f"{name} of the image", fields.get(name), f"a {part.__name__}")
    try:
        return KINDS[kind](**fields)
    except TypeError as error:  # one is missing, or not a number
        raise InputError(f"configuration of {kind}", str(stored), "its arguments", f"{error}.") from None
