"""DMT contact with losses that are not those of a bulk: in the attraction, and by adhesion that grows in contact."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from phasemap._kernels.forces import hertzian, hertzian_slope
from phasemap._shared.fields import Number
from phasemap.experiment.interaction.base import SphereLaw

if TYPE_CHECKING:
    import numpy as np

    Array = np.ndarray


@dataclass(frozen=True)
class LossyDMT(SphereLaw):
    """DMT contact that loses energy outside contact, or by adhesion: theory, Eqs. (losses-1) and (losses-2).

    Outside contact -Gamma exp(d/Lambda) d' acts beside the attraction (Gotsmann et al., Phys. Rev. B 60, 11051 (1999)).
    In contact the work of adhesion is w on the way in, and w_r from the deepest point on until contact ends. Both add
    to the damping in contact. Motion over it is marched in time.

    Parameters
    ----------
    adhesion_ratio : float
        w_r / w [1], >= 1, of every material.
    outer_loss : float
        Gamma [N s/m], >= 0.
    outer_length : float
        Lambda [m], > 0.
    """

    adhesion_ratio: Number[float] = Number("1", 1.0, minimum=1.0, maximum=1e3)
    outer_loss: Number[float] = Number("N s/m", 0.0, minimum=0, maximum=1e3, usual=(1e-12, 1e-2))
    outer_length: Number[float] = Number("m", 1e-9, above=0, usual=(0.05e-9, 100e-9))
    name: ClassVar[str] = "lossy dmt"
    in_time: ClassVar[bool] = True
    lossy: ClassVar[bool] = True

    force = staticmethod(hertzian)
    slope = staticmethod(hertzian_slope)

    def columns(self, contact_stiffness: Array, adhesion: Array, radius: float) -> tuple[Array, ...]:
        """p[CONTACT] = K sqrt(R) [N m^-1.5], p[PULL] and p[WITHDRAWN] = attractions of w and of w_r - w [N]."""
        pull = self.pull(contact_stiffness, adhesion, radius)
        return contact_stiffness * math.sqrt(radius), pull, (self.adhesion_ratio - 1.0) * pull

    def loss_outside(self) -> tuple[float, float]:
        return 1.0 / self.outer_length, self.outer_loss
