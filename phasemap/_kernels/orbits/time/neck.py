"""A neck between tip and surface in the march: drawn out, and broken, with the energy that is lost there."""

from __future__ import annotations

from typing import TYPE_CHECKING

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.neck_energy import loop_energy
from phasemap._kernels.orbits.time.contact import OFF_SURFACE, Motion
from phasemap._kernels.orbits.time.relaxing import Relaxing, stored_energy

if TYPE_CHECKING:
    from phasemap._kernels.orbits.time.elastic import Elastic

NECK_DRAWN = 2  # what an elastic contact does, beside OFF_SURFACE and `elastic.CONTACT_MADE`


@kernel
def draw_neck(contact: Elastic, q: float, motion: Motion) -> None:
    """Let the contact draw out a neck: the tip is in it, at q."""
    now = contact.now
    now.mode, now.bottom, now.deep, motion.here.at.x = NECK_DRAWN, contact.p[col.RELEASE], contact.neck, q


@kernel(inline=True)
def break_neck(contact: Elastic, motion: Motion) -> None:
    """Let the neck break: the tip is off the surface at the depth of release, and the energy of the loop is lost."""
    contact.now.mode, motion.here.at.x = OFF_SURFACE, contact.p[col.RELEASE]
    motion.sums.loss += loop_energy(contact.law, contact.p) * contact.compliance


@kernel
def form_or_break_neck(contact: Relaxing, motion: Motion) -> None:
    """Let a neck of liquid form over a dent, or break.

    Its steps add up all its work, so attraction stores nothing meanwhile.
    """
    now, x, t = contact.now, motion.here.at.x, motion.time
    motion.sums.loss += stored_energy(contact, 0.0, x, t)
    now.held = 1 - now.held
    motion.sums.loss -= stored_energy(contact, 0.0, x, t)
