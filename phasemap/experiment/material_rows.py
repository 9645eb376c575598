"""Materials as rows of numbers, and their stiffness, adhesion and loss under a microscope."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from phasemap._shared.arrays import Array, IntArray, is_uniform, read_only
from phasemap._shared.errors import InputError
from phasemap.experiment.arms import contact_of
from phasemap.experiment.material import Material
from phasemap.experiment.prony import Prony, spectrum_of

if TYPE_CHECKING:
    from phasemap.experiment.microscope import Microscope, Tip

PLAIN = 4
"""Columns of materials that have nothing more: modulus [Pa], adhesion [J/m2], damping [1] or viscosity [Pa s],
Poisson's ratio [1]."""

MORE_NUMBERS = ("thickness", "relaxed_modulus", "relaxation_time", "liquid_film", "contact_angle")
MORE = (*MORE_NUMBERS, "relaxation")
"""Names of the further columns, which are all there or none: [m], [Pa], [s], [m], [degree], key of a spectrum;
infinite where a material has none, but the relaxed modulus is then the modulus."""


def column_of(materials: Array, name: str) -> Array | None:
    """Column of `MORE` of rows of materials; None where no material has it."""
    if materials.shape[1] == PLAIN:
        return None
    column: Array = materials[:, PLAIN + MORE.index(name)]
    return column if np.isfinite(column).any() else None


def rows_of(materials: Iterable[Material]) -> tuple[Array, bool]:
    """The rows of materials that are all viscous or none, shape (n, 4) or (n, 10), and whether they are."""
    every = list(materials)
    viscous = any(one.viscosity for one in every)
    rows = [
        [one.modulus, one.adhesion, (one.viscosity or 0.0) if viscous else one.damping, one.poisson_ratio]
        for one in every
    ]
    if any(getattr(one, name) is not None for one in every for name in MORE):
        for row, material in zip(rows, every, strict=True):
            none = {"relaxed_modulus": material.modulus}
            row += [
                none.get(name, math.inf) if (value := getattr(material, name)) is None else value
                for name in MORE_NUMBERS
            ]
            row.append(material.relaxation.key if isinstance(material.relaxation, Prony) else math.inf)
    return np.array(rows, dtype=np.float64), viscous


def more_of(columns: Sequence[Any]) -> dict[str, Any]:
    """Columns of `MORE` that some material has, from columns that are numbers or maps; spectra by their keys."""
    more = {name: one for name, one in zip(MORE, columns, strict=False) if np.ndim(one) or math.isfinite(one)}
    if "relaxation_time" not in more:
        more.pop("relaxed_modulus", None)
    return more


def materials_of(rows: Array, viscous: bool) -> list[Material]:
    """The materials that have these rows: the inverse of `rows_of`."""
    materials = []
    for modulus, adhesion, loss, poisson_ratio, *rest in rows.tolist():
        more = more_of(rest)
        if "relaxation" in more:
            more["relaxation"] = spectrum_of(more["relaxation"])
        more["viscosity" if viscous else "damping"] = loss
        materials.append(Material(modulus, adhesion, poisson_ratio=poisson_ratio, **more))
    return materials


def distinct_materials(maps: Sequence[Array]) -> tuple[Array, IntArray]:
    """Distinct materials of maps of one shape: a row for each, and which one each pixel has; both read-only."""
    shape = maps[0].shape
    varying = [one.reshape(-1) for one in maps if not is_uniform(one)]
    if not varying:
        return read_only(np.array([[one[0, 0] for one in maps]])), np.broadcast_to(np.int32(0), shape)
    first, flat = factorise(varying)
    pixels = np.divmod(first, shape[1])
    return read_only(np.column_stack([one[pixels] for one in maps])), read_only(flat.reshape(shape))


def factorise(columns: Sequence[Array]) -> tuple[NDArray[np.intp], IntArray]:
    """Find the distinct rows of equally long columns, by their bits: where each occurs, and which one each entry is."""
    size = columns[0].size
    count, codes = _codes(np.ascontiguousarray(columns[0]).view(np.int64))
    for column in columns[1:]:
        if count == size:
            break
        more, code = _codes(np.ascontiguousarray(column).view(np.int64))
        codes *= more
        codes += code
        count, codes = _codes(codes)
    first = np.empty(count, np.intp)
    first[codes[::-1]] = np.arange(size - 1, -1, -1)  # the last assignment holds
    return first, codes.astype(np.int32)


def _codes(values: NDArray[np.int64]) -> tuple[int, NDArray[np.intp]]:
    """Return how many distinct values there are and the rank of each."""
    ordered = np.sort(values)
    distinct = ordered[np.concatenate(([True], ordered[1:] != ordered[:-1]))]
    if len(distinct) <= 1024:  # searching a small table is faster than sorting indices, a large one slower
        return len(distinct), np.searchsorted(distinct, values)
    del ordered
    return len(distinct), np.unique(values, return_inverse=True)[1]


def compliance_of(tip: Tip) -> float:
    """(1 - nu_t^2)/E_t [1/Pa] of a tip; 0 if it is rigid."""
    return 0.0 if tip.modulus is None else (1 - tip.poisson_ratio**2) / tip.modulus


def contact_stiffness(modulus: Array, poisson_ratio: Array, tip: Tip) -> Array:
    """K [Pa] of sphere and plane, 1/K = (3/4) [(1 - nu_s^2)/E_s + (1 - nu_t^2)/E_t] (theory, Eq. (model-6))."""
    with np.errstate(all="ignore"):  # what is not finite has a status of its own
        stiffness: Array = 4 / 3 * modulus / ((1 - poisson_ratio**2) + modulus * compliance_of(tip))
    return stiffness


def damping_of(viscosity: Array, scope: Microscope) -> Array:
    """alpha1 [1] of a Kelvin-Voigt viscosity eta [Pa s]: alpha1 = eta a omega_c / (2 k).

    a is the contact's radius at d = R, that is R for a sphere: theory, Eq. (model-16).
    """
    law, radius = scope.interaction.law, scope.tip.radius
    if scope.interaction.damping_exponent != law.spread:
        beside = "" if law.spread == 0.5 else f" and the contact is {law.name!r}"
        allowed = f"{law.spread:g} where materials have a viscosity{beside}"
        raise InputError("damping_exponent", scope.interaction.damping_exponent, allowed)
    omega_c = 2 * np.pi * scope.cantilever.resonance_frequency
    contact = float(law.radius_at(np.array(radius), radius))
    return np.asarray(viscosity * (contact * omega_c / (2 * scope.cantilever.stiffness)))


def of_one_loss(materials: Mapping[str, Material], scope: Microscope) -> dict[str, Material]:
    """Materials as one surface can have them: where some have a damping, a viscosity is the damping that it is here."""
    if not any(one.damping for one in materials.values()):
        return dict(materials)
    return {
        name: one
        if one.viscosity is None
        else replace(one, viscosity=None, damping=float(damping_of(np.array(one.viscosity), scope)))
        for name, one in materials.items()
    }


def properties(materials: Array, viscous: bool, scope: Microscope) -> tuple[Array, Array, Array]:
    """Stiffness K [Pa], adhesion [J/m2] and damping alpha1 [1] of rows of materials under this microscope."""
    modulus, adhesion, loss, poisson_ratio = materials.T[:4]
    stiffness = contact_stiffness(modulus, poisson_ratio, scope.tip)
    return stiffness, adhesion, damping_of(loss, scope) if viscous else loss


def film_of(materials: Array) -> Array | None:
    """Poisson's ratio [1] and thickness [m] of materials that are films on a rigid base, shape (n, 2); else None."""
    thickness = column_of(materials, "thickness")
    return None if thickness is None else np.column_stack([materials[:, 3], thickness])


def liquid_of(materials: Array) -> Array | None:
    """Thickness [m] and contact angle [degree] of films of liquid, shape (n, 2), infinite if not given; else None."""
    film, angle = column_of(materials, "liquid_film"), column_of(materials, "contact_angle")
    if film is None and angle is None:
        return None
    none = np.full(len(materials), np.inf)
    return np.column_stack([none if film is None else film, none if angle is None else angle])


def relaxation_of(materials: Array, scope: Microscope) -> Array | None:
    """Relaxation under this tip, shape (n, 4), or None: tau [1/omega_c], 1 - E_inf/E_0, address of arms, stiffness.

    The stiffness is that of a sudden touch, over that of the modulus. tau and the share are 0 where nothing relaxes,
    the address where there is one time.
    """
    relaxation, spectrum = _of_one_time(materials, scope), column_of(materials, "relaxation")
    if spectrum is None:
        return relaxation
    if relaxation is None:
        relaxation = np.tile([0.0, 0.0, 0.0, 1.0], (len(materials), 1))
    resonance, soft = scope.cantilever.resonance_frequency, compliance_of(scope.tip)
    for i in np.flatnonzero(np.isfinite(spectrum)):
        compliance = float(soft / (1 - materials[i, 3] ** 2))
        contact = contact_of(float(spectrum[i]), compliance, scope.frequency_ratio * resonance, 2 * np.pi * resonance)
        relaxation[i] = 2 * np.pi * resonance * contact.time, contact.share, contact.address, contact.stiffness
    return relaxation


def _of_one_time(materials: Array, scope: Microscope) -> Array | None:
    """Relaxation of standard linear solids under this tip, as `relaxation_of` returns it.

    An elastic tip in series makes contacts relax sooner, by the ratio of the shares that are left, for the time in
    which they recover does not change: theory, Eq. (memory-1).
    """
    time, relaxed = column_of(materials, "relaxation_time"), column_of(materials, "relaxed_modulus")
    if time is None or relaxed is None:
        return None
    modulus = materials[:, 0]
    first, last = (contact_stiffness(one, materials[:, 3], scope.tip) for one in (modulus, relaxed))
    relaxes = np.isfinite(time) & (relaxed < modulus)
    with np.errstate(all="ignore"):
        tau = 2 * np.pi * scope.cantilever.resonance_frequency * time * (modulus / relaxed) * (last / first)
        share = np.where(relaxes, 1 - last / first, 0.0)
        return np.column_stack([np.where(relaxes, tau, 0.0), share, np.zeros(len(tau)), np.ones(len(tau))])
