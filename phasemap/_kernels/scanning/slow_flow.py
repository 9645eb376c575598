"""Slow flow: the complex amplitude of the lever averaged over its period, together with the loop.

With z = Re(a exp(i omega tau)), a what the lock-in sees, and the first harmonic P, S of the force of the surface,

    a'' + 2 (alpha0 + i omega) a' = R,   R = u0 - (1 - omega^2 + 2 i alpha0 omega) a - (P - i S) a/|a|

(theory, Eq. (slow-flow-1); Wang 1999, Eqs. 5-8, before they are set to rest; the free lever's own terms are exact).
What moves slowly is b = a + a'/(2 (alpha0 + i omega)): b' = R/(2 (alpha0 + i omega)), and a = b - b'/(2 (alpha0 + i
omega)) up to the next order (theory, Eq. (slow-flow-2)). P and S are those of a tip that comes as deep as |a| + mean
deflection + kappa P below the surface, which itself depends on P.

The lever's modes decay within many periods, and its lock-in within a few: the filters are solved exactly along a, which
is a cubic within a step (theory, Eq. (slow-flow-7)), and what is left takes long steps of the classical method of Runge
and Kutta. The rate at the end of a step, which is the first of the next one, in place of some of the fourth gives the
method of order 3 with which it is compared. Steps end where the surface has a corner.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator, parameters
from phasemap._kernels.lever import reach_of
from phasemap._kernels.lever_modes import inverse_inertia
from phasemap._kernels.numerics import copy
from phasemap._kernels.orbits.averaged.harmonics import harmonics
from phasemap._kernels.records import assign, record
from phasemap._kernels.scanning.feedback_loop import (
    A_IMAG,
    A_REAL,
    FILTERS,
    INTEGRAL,
    LOOP_STATE,
    SCANNER,
    SCANNER_SPEED,
    CubicPath,
    Loop,
    Setup,
    Stretch,
    Tally,
    filter_cubic,
    lock_in_output,
    lock_in_rates,
    scanner_command,
)
from phasemap._kernels.scanning.higher_harmonics import Shares, tip_shift

LEAST_AMPLITUDE = 1e-6  # of the setpoint amplitude: a has no phase at 0
EXACT_DEPTH = 1e-7  # of the setpoint amplitude: error of the depth that needs no correction
CORRECTED_DEPTH = 1e-5  # of the setpoint amplitude: error of the depth after a correction
MOST_DEPTHS = 12  # that are tried for one right-hand side
STEP_TOLERANCE = 1.5e-4  # of the setpoint amplitude, local error of a step
LEAST_SCALE = 0.01  # of the setpoint amplitude: a smaller amplitude allows no smaller error of a
MOST_FLOW_STEPS = 500  # between two corners of the surface,
FLOW_STEPS_OF_PERIOD = 8.0  # and as many more in each period: more follow no averaged lever
FIRST_FLOW_STEP, LEAST_FLOW_STEP = 0.1, 1e-9  # in times of the loop; of the span, where the flow diverges
MOST_LONGER, MOST_SHORTER, CAUTION = 5.0, 0.2, 0.9  # a step over the one before, and below the longest allowed
NOISY_STEP = 0.25  # in decay times of lever and lock-in: the longest step with noise

STAGES = 5
_WHEN = np.array([0, 1 / 2, 1 / 2, 1, 1])
COMPARED = 0.1  # how much of the fourth rate the method of order 3 replaces

FIRST_SHARE = col.ROW  # first of the two columns that rows have beyond those of a law: the shares of `share_rows`


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

    The amplitude a of the lever follows from b. The depth of the tip is where P at that depth and the shift by P agree.
    It is found along the secant through the harmonics computed last, which were those of almost the same depth.
    """
    oscillator, shares = sample
    lever = oscillator.lever
    omega = lever[col.OMEGA]
    command, out[INTEGRAL], _ = scanner_command(loop, y)
    place, out[SCANNER], out[SCANNER_SPEED] = command, 0.0, 0.0
    if loop.spring != 0.0:
        place, out[SCANNER] = y[SCANNER], y[SCANNER_SPEED]
        out[SCANNER_SPEED] = loop.spring * (command - place) - loop.loss * y[SCANNER_SPEED]
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


@record
class StepEnd:
    """Recorded channels at one end of a step, and their rates."""

    scanner: float  # Z [m]
    amplitude: float  # that the lock-in shows [m]
    phase: float  # that the lock-in shows [rad]
    scanner_rate: float  # [m per tau]
    amplitude_rate: float
    phase_rate: float  # [rad per tau]
    stopped: int  # whether the scanner is at an end of its range (1 or 0)


class Flow(NamedTuple):
    """The averaged lever under its loop."""

    y: np.ndarray  # state, shape (LOOP_STATE,)
    rates: np.ndarray  # at the stages of a step, shape (STAGES, LOOP_STATE)
    trial: np.ndarray  # a state that is tried
    memory: FlowMemory


def new_flow() -> Flow:
    """Return the averaged lever and its loop with all numbers zero."""
    return Flow(np.zeros(LOOP_STATE), np.zeros((STAGES, LOOP_STATE)), np.zeros(LOOP_STATE), FlowMemory())


@kernel
def scanner_height(loop: Loop, y: np.ndarray) -> float:
    """Height of the scanner [m]."""
    return y[SCANNER] if loop.spring != 0.0 else scanner_command(loop, y)[0]


@kernel
def _scanner_rate(loop: Loop, y: np.ndarray, out: np.ndarray) -> float:
    """Speed of the scanner [m per tau], without what the derivative gain adds to it."""
    if loop.spring != 0.0:
        return y[SCANNER_SPEED]
    return -(loop.proportional * lock_in_rates(loop, y)[0] + out[INTEGRAL])


@kernel
def _note_end(loop: Loop, y: np.ndarray, out: np.ndarray, end: StepEnd) -> None:
    """Fill in what is recorded in this state, and its rates."""
    end.scanner, end.scanner_rate = scanner_height(loop, y), _scanner_rate(loop, y, out)
    end.amplitude, end.phase = lock_in_output(loop, y)
    end.amplitude_rate, end.phase_rate = lock_in_rates(loop, y)
    end.stopped = 1 if scanner_command(loop, y)[2] else 0


@kernel
def _add_step(before: StepEnd, after: StepEnd, h: float, tally: Tally) -> None:
    """Add a step to the integrals: h/2 (f0 + f1) + h^2/12 (f0' - f1')."""
    half, twelfth = 0.5 * h, h * h / 12.0
    tally.time += h
    tally.scanner += half * (before.scanner + after.scanner) + twelfth * (before.scanner_rate - after.scanner_rate)
    tally.amplitude += half * (before.amplitude + after.amplitude)
    tally.amplitude += twelfth * (before.amplitude_rate - after.amplitude_rate)
    tally.phase += half * (before.phase + after.phase) + twelfth * (before.phase_rate - after.phase_rate)
    tally.stopped = max(tally.stopped, before.stopped, after.stopped)


@kernel(light=True)
def _stepped_entries(loop: Loop) -> int:
    """Number of entries of the state that take steps: filters do not, nor does a scanner that follows at once."""
    return FILTERS if loop.spring != 0.0 else SCANNER


@kernel
def _step_error(loop: Loop, k: np.ndarray, h: float, size: float) -> float:
    """Local error of a step to an amplitude of this size [m], over what is allowed.

    The method of order 3 does not see a change with time alone, as where the tip lands within a step, so that the bend
    of the rates counts too. The phase of a faint amplitude has to be as good as any: it is kept as that grows again.
    """
    worst = 0.0
    for j in range(_stepped_entries(loop)):
        bend = k[0, j] - k[1, j] - k[2, j] + k[4, j]
        local = COMPARED * (abs(k[3, j] - k[4, j]) + abs(bend) / 3.0)
        if math.isnan(local):
            return math.inf
        scale = loop.setpoint
        if j < INTEGRAL:
            scale *= min(1.0, max(size / scale, LEAST_SCALE))
        elif j == SCANNER_SPEED:
            scale *= math.sqrt(loop.spring)
        worst = max(worst, local * h / (STEP_TOLERANCE * scale))
    return worst


@kernel
def _path(loop: Loop, k: np.ndarray, stage: int, b: complex, h: float, inverse: complex) -> CubicPath:
    """Path of the amplitude a during a step, through what rates of b are known: a = b - b' inverse."""
    start = complex(k[0, A_REAL], k[0, A_IMAG])
    bend = twist = complex(0.0, 0.0)  # b' = start + bend x + twist x^2, x = t/h
    if stage == 2 or stage == 3:
        bend = 2.0 * (complex(k[stage - 1, A_REAL], k[stage - 1, A_IMAG]) - start)
    elif stage == 4:
        half = 0.5 * complex(k[1, A_REAL] + k[2, A_REAL], k[1, A_IMAG] + k[2, A_IMAG])
        end = complex(k[3, A_REAL], k[3, A_IMAG])
        bend, twist = 4.0 * half - end - 3.0 * start, 2.0 * (end - 2.0 * half + start)
    a_filter = 1.0 / loop.rate
    a_step = a_filter / h
    bend *= a_step
    twist *= 2.0 * a_step * a_step
    return CubicPath(
        b - inverse * start, a_filter * start - inverse * bend, a_filter * bend - inverse * twist, a_filter * twist
    )


@kernel
def _add_flow_noise(lever: np.ndarray, loop: Loop, h: float, noise: np.random.Generator, y: np.ndarray) -> None:
    """Add noise of a time h to the amplitude a and to the first filter: theory, Eq. (slow-flow-8)."""
    alpha0, rate = lever[col.ALPHA0], loop.rate
    thermal = math.sqrt(-loop.thermal_noise * math.expm1(-2.0 * alpha0 * h))
    detector = math.sqrt(-0.5 * loop.detector_noise * rate * math.expm1(-2.0 * rate * h))
    for part in range(2):
        y[A_REAL + part] += thermal * noise.standard_normal()
        y[FILTERS + part] += detector * noise.standard_normal()


@kernel
def flow_on(flow: Flow, setup: Setup, row: np.ndarray, stretch: Stretch, tally: Tally) -> int:
    """Move the averaged lever over a stretch of ground; returns a status."""
    p = parameters(row)
    shares = Shares(row[FIRST_SHARE], row[FIRST_SHARE + 1])
    flow.memory.known = 0
    return _flow_over(setup, Sample(Oscillator(setup.law, p, setup.lever), shares), stretch, flow, tally)


@kernel
def _flow_over(setup: Setup, sample: Sample, stretch: Stretch, flow: Flow, tally: Tally) -> int:
    """`flow_on` over one material, which comes by value: read from the row in every step, it takes 3 % longer."""
    _, lever, loop, noise = setup
    y, k, trial, memory = flow
    ground, slope, span = stretch
    noisy = loop.thermal_noise > 0.0 or loop.detector_noise > 0.0
    longest = NOISY_STEP / max(loop.rate, lever[col.ALPHA0]) if noisy else math.inf
    if not memory.step > 0.0:
        memory.step = FIRST_FLOW_STEP / loop.rate
    inverse, moving = inverse_inertia(lever), _stepped_entries(loop)
    before, after = StepEnd(), StepEnd()
    slow_flow_rhs(sample, loop, ground, y, memory, k[0])
    _note_end(loop, y, k[0], before)
    done = 0.0
    for _ in range(MOST_FLOW_STEPS + int(FLOW_STEPS_OF_PERIOD * span * lever[col.OMEGA] / (2.0 * math.pi))):
        remaining = span - done
        steps = max(1.0, math.ceil(remaining / min(memory.step, longest) - 1e-9))
        h = remaining / steps
        shift, lead = memory.shift, complex(memory.lead_real, memory.lead_imag)
        b = complex(y[A_REAL], y[A_IMAG]) + lead
        for stage in range(1, STAGES):
            for j in range(moving):
                way = _WHEN[stage] * k[stage - 1, j]
                if stage == STAGES - 1:
                    way = (k[0, j] + 2.0 * (k[1, j] + k[2, j]) + k[3, j]) / 6.0
                trial[j] = y[j] + h * way
            trial[A_REAL] += lead.real - memory.lead_real
            trial[A_IMAG] += lead.imag - memory.lead_imag
            filter_cubic(loop, y, _path(loop, k, stage, b, h, inverse), _WHEN[stage] * h, trial)
            if noisy and stage == STAGES - 1:
                _add_flow_noise(lever, loop, h, noise, trial)
            slow_flow_rhs(sample, loop, ground + slope * (done + _WHEN[stage] * h), trial, memory, k[stage])
        error = _step_error(loop, k, h, modulus(complex(trial[A_REAL], trial[A_IMAG])))
        memory.step = (
            h * min(MOST_LONGER, max(MOST_SHORTER, CAUTION * error**-0.25)) if error > 0.0 else MOST_LONGER * h
        )
        if error <= 1.0:
            if abs(memory.push) > lever[col.DRIVE] + loop.most_push * modulus(complex(trial[A_REAL], trial[A_IMAG])):
                return col.NOT_CONVERGED
            _note_end(loop, trial, k[STAGES - 1], after)
            _add_step(before, after, h, tally)
            assign(before, after)
            copy(trial, y)
            copy(k[STAGES - 1], k[0])
            done += h
            if steps == 1.0:
                y[SCANNER] = scanner_height(loop, y)
                return col.GOOD
        else:
            memory.shift, memory.lead_real, memory.lead_imag = shift, lead.real, lead.imag
            if not memory.step > LEAST_FLOW_STEP * span:
                return col.DIVERGED
    return col.NOT_CONVERGED
