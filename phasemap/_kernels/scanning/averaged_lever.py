"""What moves the lever averaged over its period, and what the lock-in sees of it.

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
from phasemap._kernels.law import Law, Oscillator
from phasemap._kernels.orbits.averaged.harmonics import harmonics
from phasemap._kernels.scanning.higher_harmonics import lifted
from phasemap._kernels.scanning.loop import AMP, INTEGRAL, KP, LOSS, PLACE, SETPOINT, SPEED, SPRING, command, drift_of

FAINTEST = 1e-6  # of the setpoint amplitude; a has no phase at 0
EXACT, CLOSE = 1e-7, 1e-5  # of the setpoint amplitude: error in the depth without a correction, and after one
TRIES = 12  # harmonics in a row

# Entries of a flow's memory: step; by how much [m] mean deflection and higher harmonics carry the tip towards the
# ground; b - a. And of the harmonics that were last taken: whether there are any, the depth, what carries the tip there
# [m], P, S, and the second entry.
STEP, SHIFT, LEAD, KNOWN, DEPTH, CARRIED, PUSH, DRAG, SHIFTED, MEMORY = 0, 1, 2, 4, 5, 6, 7, 8, 9, 10


class Sample(NamedTuple):
    """A material: its parameters, the reach [m] of its force, and its shares in what carries the tip (`lifted`)."""

    p: tuple[float, ...]
    reach: float
    shares: tuple[float, float]


@kernel
def size_of(a: complex) -> float:
    """|a| of what is neither huge nor tiny."""
    return math.sqrt(a.real * a.real + a.imag * a.imag)


@kernel
def rates(
    law: Law, sample: Sample, lever: np.ndarray, loop: np.ndarray, ground: float, y: np.ndarray, memory: np.ndarray,
    out: np.ndarray,
) -> None:  # fmt: skip
    """Fill `out` with the rates of b, I and the scanner over a ground of this height [m]; a follows from b.

    The depth of the tip is where what P carries it by agrees with P. It is found along the secant through the harmonics
    that were last taken, which were those of almost the same depth.
    """
    p, reach, shares = sample
    omega, alpha0 = lever[col.OMEGA], lever[col.ALPHA0]
    to, out[INTEGRAL], _ = command(loop, y)
    place, out[PLACE], out[SPEED] = to, 0.0, 0.0
    if loop[SPRING] != 0.0:
        place, out[PLACE] = y[PLACE], y[SPEED]
        out[SPEED] = loop[SPRING] * (to - place) - loop[LOSS] * y[SPEED]
    elif loop[KP] != 0.0:
        # The controller acts once a period: Kp e is half a period old, on average. The sum over periods that is I has
        # the latest error whole, and is half a period ahead: both together are in time.
        place += math.pi / omega * loop[KP] * drift_of(loop, y)[0]
    away, shift = place - ground, memory[SHIFT]
    inverse = 0.5 / complex(alpha0, omega)
    free = complex(1.0 - omega * omega, 2.0 * alpha0 * omega)
    lead = complex(memory[LEAD], memory[LEAD + 1])
    b = complex(y[AMP], y[AMP + 1]) + lead
    a, rate, whole = b - lead, complex(0.0, 0.0), size_of(b)
    for _ in range(TRIES):
        size = max(size_of(a), FAINTEST * loop[SETPOINT])
        depth, c = size + shift - away, (away - shift) / size
        push, drag, mean = harmonics(Oscillator(law, p, lever), reach, size, c)
        unit = a * (1.0 / size)
        rate = (lever[col.BASE] - free * a - complex(push, -drag) * unit) * inverse
        lead = rate * inverse
        new = mean + lifted(Oscillator(law, p, lever), reach, size, c, push, shares)
        carried = size_of(b - lead) - whole + new
        wrong, known = whole + carried - away - depth, memory[KNOWN] > 0.0
        stepped = depth - memory[DEPTH]
        rest = stepped - (carried - memory[CARRIED])
        more_push, more_drag, more = push - memory[PUSH], drag - memory[DRAG], new - memory[SHIFTED]
        memory[KNOWN], memory[DEPTH], memory[CARRIED] = 1.0, depth, carried
        memory[PUSH], memory[DRAG], memory[SHIFTED] = push, drag, new
        shift = new
        if abs(wrong) < EXACT * loop[SETPOINT]:
            break
        if known and abs(wrong) <= abs(rest):
            t = wrong / rest
            rate -= t * complex(more_push, -more_drag) * unit * inverse
            lead = rate * inverse
            shift += t * more
            if abs(wrong * stepped) < CLOSE * loop[SETPOINT] * max(abs(depth), reach):  # all is nearly straight
                break
        a = b - lead
    else:
        rate = complex(math.nan, math.nan)
    memory[SHIFT], memory[LEAD], memory[LEAD + 1] = shift, lead.real, lead.imag
    y[AMP], y[AMP + 1] = b.real - lead.real, b.imag - lead.imag
    out[AMP], out[AMP + 1] = rate.real, rate.imag
