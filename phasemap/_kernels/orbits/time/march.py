"""The full equation of motion marched in time: the slow, independent truth.

    z'' + 2 (alpha0 + alpha_s(d)) z' + z + F(d)/k = u0 cos(omega tau),    d = z - z0          (Wang 1999, Eq. 1)

by an explicit Runge-Kutta method of order 8 (`runge_kutta`) on steps laid out by a smooth density; no control repeats
them, so the error is C eta^8 (theory, Eqs. (time-1) and (time-2)). Order 8 needs an analytic right-hand side, and F ~
d^(3/2), alpha_s ~ d^(1/2) are not:

* out of contact the state is (d, v) and the independent variable s is the time tau;
* in contact it is (q, v), q = sqrt(d), with dtau = 2 q ds:    q' = v,    v' = 2 q z'',    tau' = 2 q,
  in which every multiple of 1/2 is an analytic power of d, through q = 0 and beyond;
* each change from one to the other is the end of a step (`period`).

All are x' = v, v' = w z'', tau' = w with (x, w) = (d, 1) or (q, 2 q). A contact may have variables of its own, as
`elastic` and `relaxing` say.
"""

from __future__ import annotations

import numpy as np

from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator
from phasemap._kernels.orbits.time.by_memory import by_memory, remembers
from phasemap._kernels.orbits.time.elastic import march_elastic
from phasemap._kernels.orbits.time.elements import CONTACT_MODE, INNER_COUNT, OUTER_COUNT
from phasemap._kernels.orbits.time.tip import PeriodResult


@kernel
def march_period(oscillator: Oscillator, z0: float, step_size: float, y: np.ndarray, acc: PeriodResult) -> int:
    """March for a period of the drive, as the surface is, from drive phase 0 on or where y says that periods begin.

    Parameters
    ----------
    step_size : float
        Size of the steps. The settled phase is off by less than 1e-4, 2e-6, 2e-9 degree at 0.5, 0.3, 0.15 in nine of
        ten orbits with Q <= 1000. The error is of order 8 in it (eta in the theory) and proportional to Q.
    y : ndarray
        State as `tip` names it, advanced in place; where the law may remember it goes on with what `elements` names.
        Whether the tip is in contact or neck is left out and not asked for where the law has no neck: depth says it.
    acc : PeriodResult
        Filled. The energy into the surface is by damping and relaxation, and that of the loop at each release;
        the virial is of the whole surface force.

    Returns
    -------
    int
        Steps taken, or minus a status.
    """
    law, p, lever = oscillator
    if law.memory != 0:
        if remembers(p):
            return by_memory(law, p, lever, z0, step_size, y, acc)
        y[CONTACT_MODE] = y[INNER_COUNT] = y[OUTER_COUNT] = 0.0  # over another material
    return march_elastic(oscillator, z0, step_size, y, acc)
