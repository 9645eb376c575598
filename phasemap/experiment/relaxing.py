"""Maps of materials that relax: what makes them standard linear solids."""

from __future__ import annotations

from typing import Any

import numpy as np

from phasemap._shared.dask_arrays import is_lazy
from phasemap._shared.errors import InputError, Word
from phasemap.experiment.prony import spectrum_of
from phasemap.experiment.surface_maps import where


def check_relaxing(maps: dict[str, Any]) -> None:
    """Refuse maps of a surface that are not those of standard linear solids.

    Numbers of Dask arrays are not looked at; `phasemap.simulate` refuses these.
    """
    if "relaxation" in maps:
        _check_spectra(maps)
    given = [name for name in ("relaxed_modulus", "relaxation_time") if name in maps]
    if not given:
        return
    if len(given) < 2:
        missing = "relaxation_time" if given[0] == "relaxed_modulus" else "relaxed_modulus"
        raise InputError(missing, None, f"given together with {given[0]}")
    refuse_film("thickness" in maps)
    if any(is_lazy(one) for one in maps.values()):
        return
    above = np.atleast_2d(maps["relaxed_modulus"] > maps["modulus"])
    if above.any():
        most = float(np.max(maps["relaxed_modulus"]))
        raise InputError("relaxed_modulus", most, "at most modulus, that of a sudden touch", where(above))
    if any(bool(np.any(maps[name] > 0)) for name in ("damping", "viscosity") if name in maps):
        allowed = "relaxation, or damping or viscosity, not both on one surface"
        hint = "Give the others viscosity = 0, or a relaxation time too: a preset takes viscosity = 0 beside it."
        raise InputError("relaxation_time", Word("given beside a damping or viscosity"), allowed, hint)


def _check_spectra(maps: dict[str, Any]) -> None:
    """Refuse maps beside spectra of relaxation that do not go together with them."""
    refuse_film("thickness" in maps)
    if any(is_lazy(one) for one in maps.values()):
        raise InputError("relaxation", Word("in Dask arrays"), "maps in memory where materials have spectra")
    keys, modulus = np.broadcast_arrays(maps["relaxation"], maps["modulus"])
    for key in np.unique(keys[np.isfinite(keys)]):
        first, own = spectrum_of(key).instantaneous, modulus[keys == key]
        if not np.allclose(own, first, rtol=1e-9, atol=0):
            raise InputError("modulus", float(own.flat[0]), f"that of the spectrum, {first:g} Pa, where there is one")
    if any(bool(np.any(maps[name] > 0)) for name in ("damping", "viscosity") if name in maps):
        raise InputError("relaxation", Word("given beside a damping or viscosity"), "one kind of loss on a surface")


def refuse_film(film: bool) -> None:
    """Refuse films among materials that relax."""
    if film:
        raise InputError("relaxation_time", Word("given beside a thickness"), "either of them: only half-spaces relax")
