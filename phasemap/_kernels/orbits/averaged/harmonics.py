"""First-order averaging (Krylov, Bogolyubov, Mitropolsky; Wang 1999, Eqs. 5-8) in the setpoint formulation.

The orbit is taken as z = A0 + A cos(theta). With c = (z0 - A0)/A the depth is d = A (cos(theta) - c), so that for given
(A, c) the first harmonic (P, S) of g = F/k + 2 alpha_s zdot, and then A0 and z0, follow explicitly, and the drive

    (P + A (1 - omega^2))^2 + (2 alpha0 omega A - S)^2 = u0^2

is one scalar equation for c: theory, Eqs. (averaging-4), (averaging-7) and (averaging-8). (The paper replaces omega_e^2
- omega^2 by (1 + omega)(omega_e - omega), equal at first order; here the free lever is kept exact.) Integrals of the
forces that kernels know need no nodes (`known`). Others use Gauss nodes that know the exponents of the integrand
(theory, Eq. (averaging-10)):

* contact: sin(theta/2) = sin(theta0/2) sin(psi), so that d = A (1 - c) cos(psi)^2 and half-integer powers are smooth;
* outside: u = tan(theta/2) = u0 + delta x / (1 - x), delta the distance to the pole of the long-range force;
* neck (laws with a depth of release d_r < 0): the way out stays in contact until d = d_r, at theta_r; with
  theta = theta_r - (theta_r - theta0) x^2 a root of the force at release is smooth.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels.columns import DAMPING, OMEGA, RELEASE, STIFFNESS
from phasemap._kernels.compilation import ANY_ORDER, kernel
from phasemap._kernels.law import (
    Law,
    Oscillator,
    contact_force,
    damping,
    has_hysteresis,
    has_longrange,
    longrange_force,
)
from phasemap._kernels.lever import distance_to_pole, reach_of
from phasemap._kernels.lever_modes import static_compliance
from phasemap._kernels.orbits.averaged.known import (
    Known,
    attraction_integrals,
    constants_of,
    contact_integrals,
    knows_all,
    knows_contact,
)
from phasemap._kernels.orbits.averaged.remembered import remembered_harmonics
from phasemap._kernels.orbits.time.arms import remembers
from phasemap._kernels.quadrature import gauss, gauss_on_half_line


def _contact_nodes(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Squares of cosine and sine of psi at n nodes over the contact, and their weights."""
    x, w = gauss(n)
    return np.cos(x * np.pi / 2) ** 2, np.sin(x * np.pi / 2) ** 2, w * np.pi * np.cos(x * np.pi / 2)


_FAR_X, _FAR_W = gauss_on_half_line(16)  # u = u0 + delta _FAR_X; the weight has dtheta = 2 du/(1 + u^2)
_FINE_X, _FINE_W = gauss_on_half_line(48)  # for a force that may repel or oscillate
_TOUCH_COS2, _TOUCH_SIN2, _TOUCH_W = _contact_nodes(10)
_NECK_X, _NECK_W = gauss(20)
_DEEP_COS2, _DEEP_SIN2, _DEEP_W = _contact_nodes(40)
_ALL_ROUND = np.cos((np.arange(48) + 0.5) * np.pi / 48)

DEEP_CONTACT = -0.6  # below this c the contact integrals need the finer nodes


@kernel
def _neck_integrals(law: Law, p: np.ndarray, amplitude: float, c: float, caught: bool) -> tuple[float, float, float]:
    """Contributions of the neck to the integrals of F, F cos and F sin over 0 ... pi, c < 1.

    On the way out it takes the place of the long-range force, which acts on the way in: half of the difference counts.
    See theory, Eq. (averaging-9). A tip that is caught in it is never released, and has no way in.
    """
    length = -p[RELEASE] / amplitude
    start = math.sqrt((1.0 - c) / (1.0 + c)) if c > -1.0 else math.inf
    x_end = -1.0 if caught else c - length
    if caught:
        width = 2.0 * math.atan(1.0 / start)
        end = math.pi
    else:
        far = math.sqrt((1.0 - x_end) / (1.0 + x_end))
        width = 2.0 * math.atan(2.0 * length / ((1.0 + c) * (1.0 + x_end) * (far + start) * (1.0 + far * start)))
        end = 2.0 * math.atan(far)
    share = 1.0 if caught else 0.5
    bottom = amplitude * (x_end - c) if caught else p[RELEASE]
    mean, push, loss = 0.0, 0.0, 0.0
    for i in range(len(_NECK_X)):
        x = _NECK_X[i]
        back = width * x * x  # theta_r - theta
        theta = end - back
        d = bottom + 2.0 * amplitude * math.sin(0.5 * back) * math.sin(end - 0.5 * back)
        f = share * _NECK_W[i] * 2.0 * width * x * contact_force(law, d, p)
        mean += f
        push += f * math.cos(theta)
        loss += f * math.sin(theta)
    if caught:
        return mean, push, 0.0
    if has_longrange(p):
        delta, rise = distance_to_pole(start, reach_of(p) / amplitude), far - start
        last = rise / (delta + rise)
        for i in range(len(_NECK_X)):
            x = last * _NECK_X[i]
            more = delta * x / (1.0 - x)
            u = start + more
            below = 1.0 / (1.0 + u * u)
            f = 0.5 * last * _NECK_W[i] * 2.0 * delta / (1.0 - x) ** 2 * below
            f *= longrange_force(law, -amplitude * more * (u + start) * below * (1.0 + c), p)
            mean -= f
            push -= f * (2.0 * below - 1.0)
            loss -= f * 2.0 * u * below
    return mean, push, loss


@kernel(fastmath=ANY_ORDER)
def longrange_integrals(law: Law, p: np.ndarray, amplitude: float, c: float) -> tuple[float, float]:
    """Integrals of F and F cos [N] outside contact, over 0 ... pi."""
    if not has_longrange(p) or not c > -1.0:
        return 0.0, 0.0
    if law.longrange_force == 0:
        return attraction_integrals(constants_of(p), amplitude, c)
    mean, push = 0.0, 0.0
    least = max(c - 1.0, 0.0)  # smallest gap over A
    start = math.sqrt((1.0 - c) / (1.0 + c)) if c < 1.0 else 0.0
    delta = distance_to_pole(start, least + reach_of(p) / amplitude)
    far, weights = (_FAR_X, _FAR_W) if law.attracts == 1 else (_FINE_X, _FINE_W)
    for i in range(len(far)):
        u = start + delta * far[i]
        below = 1.0 / (1.0 + u * u)
        # c - cos(theta) without cancellation: both terms are >= 0
        gap = (u - start) * (u + start) * below * (1.0 + c) if c < 1.0 else least + 2.0 * u * u * below
        f = delta * weights[i] * below * longrange_force(law, -amplitude * gap, p)
        mean += f
        push += f * (2.0 * below - 1.0)
    return mean, push


@kernel(inline=True)
def _over_stiffness(
    integrals: tuple[float, float, float], inverse_k: float, amplitude: float, omega: float
) -> tuple[float, float, float]:
    """P, S and A0 [m] from the integrals of F, F cos and alpha_s sin^2 over 0 ... pi."""
    mean, push, loss = integrals
    return 2.0 * inverse_k / math.pi * push, -4.0 / math.pi * amplitude * omega * loss, -inverse_k / math.pi * mean


@kernel(fastmath=ANY_ORDER)
def _without_neck(oscillator: Oscillator, amplitude: float, c: float, outside: bool) -> tuple[float, float, float]:
    """P, S and A0 [m] of a contact without a neck; without the long-range force unless `outside`."""
    law, p, lever = oscillator
    mean, push, loss = 0.0, 0.0, 0.0  # integrals of F, F cos and alpha_s sin^2 over 0 ... pi
    damped = p[DAMPING] != 0.0
    if c < 1.0:
        if knows_contact(law, p, c):
            mean, push, loss = contact_integrals(constants_of(p), amplitude, c)
        elif c <= -1.0:
            share = math.pi / len(_ALL_ROUND)
            for x in _ALL_ROUND:
                d = amplitude * (x - c)
                f = contact_force(law, d, p)
                mean += share * f
                push += share * f * x
                if damped:
                    loss += share * damping(law, d, p) * (1.0 - x * x)
        else:
            m2 = 0.5 * (1.0 - c)
            m = math.sqrt(m2)
            deep = c < DEEP_CONTACT
            cos2, sin2, weights = (_DEEP_COS2, _DEEP_SIN2, _DEEP_W) if deep else (_TOUCH_COS2, _TOUCH_SIN2, _TOUCH_W)
            for i in range(len(cos2)):
                y = (1.0 - c) * cos2[i]
                x = c + y
                d = amplitude * y
                share = m * weights[i] / math.sqrt(1.0 - m2 * sin2[i])
                f = contact_force(law, d, p)
                mean += share * f
                push += share * f * x
                if damped:
                    loss += share * damping(law, d, p) * (1.0 - x * x)
    if outside:
        more_mean, more_push = longrange_integrals(law, p, amplitude, c)
        mean, push = mean + more_mean, push + more_push
    return _over_stiffness((mean, push, loss), 1.0 / lever[STIFFNESS], amplitude, lever[OMEGA])


@kernel
def harmonics(oscillator: Oscillator, amplitude: float, c: float) -> tuple[float, float, float]:
    """P, S and A0 [m] of the harmonic orbit of this amplitude that touches where cos(theta) > c.

    A neck that is longer than the tip withdraws is never released.
    """
    law, p, lever = oscillator
    if knows_all(law, p, c):  # a whole oscillator costs as much to hand over as these integrals
        push, drag, mean = _harmonics_of_known(constants_of(p), 1.0 / lever[STIFFNESS], lever[OMEGA], amplitude, c)
    else:
        push, drag, mean = _harmonics_of_one_mode(oscillator, amplitude, c)
    return push, drag, static_compliance(lever) * mean


@kernel(shared=True)
def _harmonics_of_known(
    known: Known, inverse_k: float, omega: float, amplitude: float, c: float
) -> tuple[float, float, float]:
    """P, S and A0 [m] without a neck, of forces that have integrals in closed form."""
    mean, push, loss = contact_integrals(known, amplitude, c) if c < 1.0 else (0.0, 0.0, 0.0)
    if known.longrange != 0.0:
        more_mean, more_push = attraction_integrals(known, amplitude, c)
        mean, push = mean + more_mean, push + more_push
    return _over_stiffness((mean, push, loss), inverse_k, amplitude, omega)


@kernel(shared=True)
def _harmonics_of_one_mode(oscillator: Oscillator, amplitude: float, c: float) -> tuple[float, float, float]:
    """P, S and the mean A0 [m] that a lever with its first mode alone would have."""
    law, p, lever = oscillator
    if law.memory != 0 and abs(c) < 1.0 and remembers(p):
        return remembered_harmonics(oscillator, amplitude, c)
    if not has_hysteresis(p) or abs(c) >= 1.0:
        return _without_neck(oscillator, amplitude, c, True)  # bit by bit what it is for laws without a neck
    caught = amplitude * (c + 1.0) < -p[RELEASE]
    push, drag, mean = _without_neck(oscillator, amplitude, c, not caught)
    more_mean, more_push, more_drag = _neck_integrals(law, p, amplitude, c, caught)
    share = 2.0 / (math.pi * lever[STIFFNESS])
    return push + share * more_push, drag + share * more_drag, mean - 0.5 * share * more_mean
