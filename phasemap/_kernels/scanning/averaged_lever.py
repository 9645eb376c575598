"""Equation of the lever averaged over its period, for the complex amplitude that the lock-in sees.

With z = Re(a exp(i omega tau)) and the first harmonic P, S of the surface's part,

    a'' + 2 (alpha0 + i omega) a' = R,   R = u0 - (1 - omega^2 + 2 i alpha0 omega) a - (P - i S) a/|a|

(theory, Eq. (slow-flow-1); Wang 1999, Eqs. 5-8, before they are set to rest; the free lever's own terms are exact).
What moves slowly is b = a + a'/(2 (alpha0 + i omega)): b' = R/(2 (alpha0 + i omega)), and a = b - b'/(2 (alpha0 + i
omega)) up to the next order (theory, Eq. (slow-flow-2)). P and S are those of a tip that comes as deep as |a| + mean
deflection + kappa P below the surface, which itself depends on P.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator
from phasemap._kernels.lever import inverse_inertia, reach_of
from phasemap._kernels.orbits.averaged.harmonics import harmonics
from phasemap._kernels.records import record
from phasemap._kernels.scanning.higher_harmonics import Shares, tip_shift
from phasemap._kernels.scanning.loop import (
    A_IMAG,
    A_REAL,
    INTEGRAL,
    SCANNER,
    SCANNER_SPEED,
    Loop,
    lock_in_rates,
    scanner_command,
)

LEAST_AMPLITUDE = 1e-6  # of the setpoint amplitude: a has no phase at 0
EXACT_DEPTH = 1e-7  # of the setpoint amplitude: error of the depth that needs no correction
CORRECTED_DEPTH = 1e-5  # of the setpoint amplitude: error of the depth after a correction
MOST_DEPTHS = 12  # that are tried for one right-hand side


@record
class FlowMemory:
    """Numbers that one right-hand side of the slow flow leaves for the next."""

    step: float  # length of the next step in time [tau]
    shift: float  # how far mean deflection and higher harmonics carry the tip towards the ground [m]
    lead_real: float  # b - a [m]
    lead_imag: float
    # Of the harmonics that were last computed:
    known: int  # whether there are any (1 or 0)
    depth: float  # of the tip [m]
    carried: float  # what carries the tip there [m]
    push: float  # P [m]
    drag: float  # S [m]
    shifted: float  # the shift that goes with them [m]


class Sample(NamedTuple):
    """A material under the lever, and its shares in the shift of the tip (`tip_shift`)."""

    oscillator: Oscillator
    shares: Shares


@kernel
def modulus(a: complex) -> float:
    """|a|, for numbers that are neither huge nor tiny."""
    return math.sqrt(a.real * a.real + a.imag * a.imag)


@kernel
def slow_flow_rhs(
    sample: Sample, loop: Loop, ground: float, y: np.ndarray, memory: FlowMemory, out: np.ndarray
) -> None:
    """Right-hand side of the slow flow over a ground of this height [m]: rates of b, of the integral, of the scanner.

    The amplitude a of the lever follows from b. The depth of the tip is where what P carries it by agrees with P. It is
    found along the secant through the harmonics that were last computed, which were those of almost the same depth.
    """
    oscillator, shares = sample
    lever = oscillator.lever
    omega = lever[col.OMEGA]
    to, out[INTEGRAL], _ = scanner_command(loop, y)
    place, out[SCANNER], out[SCANNER_SPEED] = to, 0.0, 0.0
    if loop.spring != 0.0:
        place, out[SCANNER] = y[SCANNER], y[SCANNER_SPEED]
        out[SCANNER_SPEED] = loop.spring * (to - place) - loop.loss * y[SCANNER_SPEED]
    elif loop.proportional != 0.0:
        # The controller acts once a period: Kp e is half a period old, on average. The sum over periods that is I has
        # the latest error whole, and is half a period ahead: both together are in time.
        place += math.pi / omega * loop.proportional * lock_in_rates(loop, y)[0]
    away, shift = place - ground, memory.shift
    inverse = inverse_inertia(lever)
    free = complex(lever[col.DYNAMIC_STIFFNESS], lever[col.DYNAMIC_LOSS])
    lead = complex(memory.lead_real, memory.lead_imag)
    b = complex(y[A_REAL], y[A_IMAG]) + lead
    a, rate, whole = b - lead, complex(0.0, 0.0), modulus(b)
    for _ in range(MOST_DEPTHS):
        size = max(modulus(a), LEAST_AMPLITUDE * loop.setpoint)
        depth, c = size + shift - away, (away - shift) / size
        push, drag, mean = harmonics(oscillator, size, c)
        unit = a * (1.0 / size)
        rate = (lever[col.DRIVE] - free * a - complex(push, -drag) * unit) * inverse
        lead = rate * inverse
        new = mean + tip_shift(oscillator, size, c, push, shares)
        carried = modulus(b - lead) - whole + new
        wrong, known = whole + carried - away - depth, memory.known
        stepped = depth - memory.depth
        rest = stepped - (carried - memory.carried)
        more_push, more_drag, more = push - memory.push, drag - memory.drag, new - memory.shifted
        memory.known, memory.depth, memory.carried = 1, depth, carried
        memory.push, memory.drag, memory.shifted = push, drag, new
        shift = new
        if abs(wrong) < EXACT_DEPTH * loop.setpoint:
            break
        if known and abs(wrong) <= abs(rest):
            t = wrong / rest
            rate -= t * complex(more_push, -more_drag) * unit * inverse
            lead = rate * inverse
            shift += t * more
            if abs(wrong * stepped) < CORRECTED_DEPTH * loop.setpoint * max(
                abs(depth), reach_of(oscillator.p)
            ):  # all is nearly straight
                break
        a = b - lead
    else:
        rate = complex(math.nan, math.nan)
    memory.shift, memory.lead_real, memory.lead_imag = shift, lead.real, lead.imag
    y[A_REAL], y[A_IMAG] = b.real - lead.real, b.imag - lead.imag
    out[A_REAL], out[A_IMAG] = rate.real, rate.imag
