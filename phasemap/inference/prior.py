"""What is known of materials beforehand: a guess within a factor, and regions of known material."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from phasemap._shared.checks import number
from phasemap._shared.errors import InputError
from phasemap.experiment.material import Material

PRIOR = Material(modulus=1e9, adhesion=0.05, damping=0.01)


def check_prior(prior: object, factor: object) -> float:
    """The factor, after a look at both."""
    if not isinstance(prior, Material):
        raise InputError("prior", prior, "a Material")
    for name, what in (("thickness", "films"), ("relaxation_time", "contacts that remember")):
        if getattr(prior, name) is not None:
            allowed = f"None, for images of {what} are not inverted"
            raise InputError(f"{name} of the prior", getattr(prior, name), allowed)
    for name in ("modulus", "adhesion"):
        number(f"{name} of the prior", getattr(prior, name), "", above=0)
    number("damping of the prior", prior.damping if prior.viscosity is None else prior.viscosity, "1", above=0)
    return number("prior_factor", factor, "1", above=1, maximum=1e3)


def check_known(known: Mapping[int, Material] | None, names: Collection[int]) -> dict[int, Material]:
    """Known materials by the label of their region, of which these are there."""
    known = dict(known or {})
    for name, one in known.items():
        if name not in names:
            raise InputError("a region of known material", name, f"one of {', '.join(map(str, names))}")
        if not isinstance(one, Material):
            raise InputError(f"known material of region {name}", one, "a Material")
        if one.relaxation_time is not None:
            raise InputError(f"relaxation_time of region {name}", one.relaxation_time, "None of a region that is known")
    if len(known) == len(names):
        raise InputError("known", "every region", "fewer: one that is to be found, at least")
    return known
