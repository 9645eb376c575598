"""Where a tip rebounds so fast that the free lever between two taps keeps a time of its own.

In a contact that is short against the period T, a tip of velocity v comes back with -v, and then the lever swings
freely for T - tau. With times in units of the free lever's, epsilon = T - tau - 2 pi, the acceleration -g at the
surface and no losses, the trace of the monodromy matrix is (theory, Eq. (engagement-6))

    -2 cos(epsilon) - 2 sin(epsilon) g/v.

Below resonance T is longer than 2 pi. A contact that lasts for what it is longer keeps the period from doubling; in a
shorter one the period doubles wherever the tip meets the surface slowly, as it does between the free amplitude and the
setpoint. Above resonance T is shorter, the trace is large where the tip begins to touch, and the tip leaves that orbit
by a jump. Either way the tip comes to periodic taps, if it does, through motion that is not periodic and may outlive
them: no curve of orbits tells. Of 300 materials drawn at 0.867 to 1.117 of the resonance, the four on another motion
than that of engaging in time have tau/abs(T - 2 pi) from 0.15 to 0.45; samples of 50 to 300 GPa at 1.1 of the
resonance that move irregularly, from 0.68 to 0.99; of 100,000 ordinary pixels none is below 1.26.
"""

from __future__ import annotations

import math

from phasemap._kernels.columns import OMEGA, STIFFNESS
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator, contact_force
from phasemap._kernels.lever import beside_resonance, near_resonance

LASTS = 2.943  # of the depth over the velocity: time of a Hertzian impact, 2 pi^(1/2) Gamma(7/5)/Gamma(9/10)
STORED = 0.4  # of depth times force: energy of a Hertzian contact


@kernel
def rebounds(oscillator: Oscillator, push: float) -> bool:
    """Whether a contact with in-phase force P [m] is shorter than what T differs from the free lever's period.

    A short contact turns the velocity v = pi P/(2 omega) round. It is so short if the depth at which it would last as
    long takes more energy than v^2/2. Within a linewidth of the resonance a lever keeps no time of its own, and
    far from it time has been asked already.
    """
    law, p, lever = oscillator
    if not (push > 0.0 and beside_resonance(lever) and near_resonance(lever)):
        return False
    omega = lever[OMEGA]
    velocity = 0.5 * math.pi * push / omega
    depth = velocity * 2.0 * math.pi * abs(1.0 / omega - 1.0) / LASTS
    elastic = (contact_force(law, depth, p) - contact_force(law, 0.0, p)) / lever[STIFFNESS]
    return bool(STORED * depth * elastic > 0.5 * velocity * velocity)
