"""Gains as an operator finds them: raised until the loop rings, and then taken back.

The loop is made linear about every stable orbit that the materials of a scene have at the setpoint, slow flow, lock-in,
controller and scanner together. It rings where an eigenvalue of that system comes to the imaginary axis: theory,
Eq. (slow-flow-9). What is found is tried, for the linear loop does not know what a tip does that is thrown out of
contact.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.law import Oscillator, parameters
from phasemap._kernels.lever import phase_of
from phasemap._kernels.orbits.averaged.branch import held_root
from phasemap._kernels.orbits.averaged.harmonics import harmonics
from phasemap._kernels.scanning import feedback_loop as of
from phasemap._kernels.scanning.feedback_loop import Setup
from phasemap._kernels.scanning.higher_harmonics import TYPICAL_SHARES, tip_shift
from phasemap._kernels.scanning.line import engage_in_time
from phasemap._kernels.scanning.slow_flow import FlowMemory, Sample, slow_flow_rhs
from phasemap._shared.arrays import Array
from phasemap._shared.errors import InputError
from phasemap._shared.random_numbers import generator
from phasemap.experiment.control import Feedback
from phasemap.experiment.microscope import Microscope
from phasemap.imaging.feedback.lines import LoopState, first_orbits, lifts_by_stiffness, loop_of, tau_per_second
from phasemap.imaging.job import Job
from phasemap.solvers.problem import Work

Jacobians = tuple[Array, Array, Array]

BACK = 2.5  # by which gains are taken back from where the loop rings: 8 dB
MOST = 48  # materials that are looked at
RESETS = np.geomspace(0.03, 3.0, 9)  # Kp/Ki that are tried, in decay times of lever and lock-in
FREE = 0.25  # integral gain over the rate of a lag of first order: no overshoot
LOUDEST = 1e3  # Kp at which the search ends
MOST_MARGIN = 1e6  # that is told from infinity
NUDGE = 1e-6  # of the amplitude, for derivatives


class LinearLoop:
    """The loop made linear about every stable orbit of the materials, whatever its gains."""

    def __init__(self, control: Feedback, scope: Microscope, work: Work) -> None:
        self._control, self._scope, self._alpha0 = control, scope, float(work.lever[col.ALPHA0])
        self._tau = tau_per_second(scope)
        self._system = _loop_jacobians(control, scope, work)

    def tuned(self) -> Feedback:
        """Find gains, where the control leaves them open.

        The largest integral gain that is still a factor 2.5 (8 dB) below ringing for every material, and below the
        drive frequency, over all ratios of proportional to integral gain. Where averaging has no stable orbit to start
        from, gains are such that the amplitude of the free lever, which follows the scanner with a lag, settles without
        overshoot.
        """
        control = self._control
        if control.integral_gain is not None:
            return control
        if not len(self._system[0]):
            return replace(control, proportional_gain=0.0, integral_gain=FREE * self._alpha0 * self._tau)
        slowest = 1 / self._alpha0 + control.order / loop_of(control, self._scope, 1.0).rate
        fastest = self._scope.frequency_ratio / (2 * math.pi)  # the controller acts once a period: `check_loop`
        best = 0.0, 0.0
        for reset in RESETS * slowest:
            integral = min(_limit(self._system, reset, 1.0, LOUDEST / reset), fastest) / BACK
            if integral > best[1]:
                best = integral * reset, integral
        if best[1] == 0.0:
            allowed = "a smaller one: with this the loop is never stable"
            raise InputError("derivative_gain", control.derivative_gain, allowed)
        return replace(control, proportional_gain=float(best[0]), integral_gain=float(best[1] * self._tau))

    def margin(self, control: Feedback) -> float:
        """Factor by which both gains could be raised before the loop rings; NaN where nothing is known."""
        proportional, integral = control.proportional_gain or 0.0, (control.integral_gain or 0.0) / self._tau
        if not len(self._system[0]) or proportional == integral == 0.0:
            return math.nan
        return _limit(self._system, proportional, integral, MOST_MARGIN)


def _limit(system: Jacobians, proportional: float, integral: float, highest: float) -> float:
    """Largest factor on both gains, up to `highest`, at which all materials are stable, to 1 %."""
    low = high = highest
    while not _stable(system, low * proportional, low * integral):
        high, low = low, 0.1 * low
        if low < 1e-12 * highest:
            return 0.0
    while high > 1.01 * low:
        middle = math.sqrt(low * high)
        if _stable(system, middle * proportional, middle * integral):
            low = middle
        else:
            high = middle
    return low


def _stable(system: Jacobians, proportional: float, integral: float) -> bool:
    """True if the loop is stable on every material: all eigenvalues have negative real parts."""
    still, by_proportional, by_integral = system
    values = np.linalg.eigvals(still + proportional * by_proportional + integral * by_integral)
    return bool((values.real < 0).all())


def _loop_jacobians(control: Feedback, scope: Microscope, work: Work) -> Jacobians:
    """Jacobians of the loop at all stable orbits: without gains, and changes by a unit of each gain; (n, m, m) each."""
    parts: list[tuple[Array, ...]] = []
    valid = np.flatnonzero(work.refused() == col.GOOD)
    for i in valid[:: max(1, len(valid) // MOST)]:
        p, amplitude = parameters(work.rows[i]), float(work.amplitudes[i])
        for orbit in _orbits(work, p, amplitude):
            loop = loop_of(replace(control, proportional_gain=0.0, integral_gain=0.0), scope, amplitude)
            loop.lowest, loop.highest = -math.inf, math.inf
            state, shift = _steady(work, p, orbit)
            gains = []
            for proportional, integral in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)):
                loop.proportional, loop.integral = proportional, integral
                gains.append(_jacobian(work, p, loop, state, shift))
            if not np.isfinite(gains).all():
                continue  # adhesion bends the lever too much to be averaged
            still = gains[0]
            lever = still[of.A_REAL : of.A_IMAG + 1, of.A_REAL : of.A_IMAG + 1]
            lifted = (
                still[of.A_REAL : of.A_IMAG + 1, of.SCANNER]
                if loop.spring
                else -still[of.A_REAL : of.A_IMAG + 1, of.INTEGRAL]
            )
            seen = of.seen_in_loop(loop, complex(state[of.A_REAL], state[of.A_IMAG]))
            seen *= complex(loop.factor_re, -loop.factor_im)
            rising = np.linalg.solve(lever, -lifted) @ [seen.real, seen.imag]
            # The feedback holds an orbit that is stable and whose amplitude grows with distance.
            if (np.linalg.eigvals(lever).real < 0).all() and rising > 0:
                kept = _moving_entries(loop)
                still, first, second = (jacobian[np.ix_(kept, kept)] for jacobian in gains)
                parts.append((still, first - still, second - still))
    if not parts:
        empty = np.zeros((0, 1, 1))
        return empty, empty, empty
    still, first, second = (np.array(part) for part in zip(*parts, strict=True))
    return still, first, second


def _orbits(work: Work, p: tuple[float, ...], amplitude: float) -> Array:
    """Stable averaged orbits (z0, mean deflection, A, P, S) that are seen with this amplitude, shape (n, 5)."""
    rows = []
    for side in (-1, 1):
        a, c, slope = held_root(Oscillator(work.law, p, work.lever), amplitude, side, True, (math.nan, math.nan))
        if slope < 0:
            push, drag, mean = harmonics(Oscillator(work.law, p, work.lever), a, c)
            rows.append([a * c + mean, mean, a, push, drag])
    return np.array(rows).reshape(-1, 5)


def _moving_entries(loop: of.Loop) -> Array:
    """Indices of the entries of the loop's state that move."""
    still = () if loop.spring else (of.SCANNER, of.SCANNER_SPEED)
    return np.array([j for j in range(of.state_length(loop)) if j not in still])


def _steady(work: Work, p: tuple[float, ...], orbit: Array) -> tuple[Array, float]:
    """State of the loop at rest on an averaged orbit (z0, mean deflection, A, P, S), and what carries the tip there."""
    z0, mean, amplitude, push, drag = orbit[:5]
    c = (z0 - mean) / amplitude
    more = tip_shift(Oscillator(work.law, p, work.lever), amplitude, c, push, TYPICAL_SHARES)
    a = amplitude * np.exp(-1j * (math.pi / 2 - phase_of(work.lever, amplitude, push, drag)))
    state = np.zeros(of.LOOP_STATE)
    state[of.A_REAL : of.A_IMAG + 1] = a.real, a.imag
    state[of.FILTERS :: 2], state[of.FILTERS + 1 :: 2] = a.real, a.imag
    state[of.INTEGRAL], state[of.SCANNER] = -(z0 + more), z0 + more
    return state, float(mean + more)


def _jacobian(work: Work, p: tuple[float, ...], loop: of.Loop, state: Array, shift: float) -> Array:
    """Jacobian of the loop's rates, by central differences."""
    sample = Sample(Oscillator(work.law, p, work.lever), TYPICAL_SHARES)  # will do for ringing
    size = NUDGE * loop.setpoint
    out = np.zeros((of.LOOP_STATE, of.LOOP_STATE))
    rate = np.zeros(of.LOOP_STATE)
    for j in range(of.LOOP_STATE):
        for sign in (1.0, -1.0):
            beside, memory = state.copy(), FlowMemory()
            beside[j] += sign * size
            memory.shift = shift
            for _ in range(2):  # the second time with the a that belongs to its b
                slow_flow_rhs(sample, loop, 0.0, beside, memory, rate)
            before = beside[of.A_REAL : of.A_IMAG + 1]
            for k in range(of.FILTERS, of.state_length(loop), 2):
                rate[k : k + 2] = loop.rate * (before - beside[k : k + 2])
                before = beside[k : k + 2]
            out[:, j] += sign * rate / (2 * size)
    return out


TOO_NEAR = 0.02  # of the setpoint amplitude, when the tip is let go to try gains
HALVINGS = 6


def quietened(control: Feedback, job: Job, work: Work, engine: int) -> tuple[Feedback, int]:
    """Halve the gains, six times at most, until the feedback rests on the softest and the stiffest material.

    Returned, too, is on how many of the two it rests with none of these gains: the tip moves irregularly. A material on
    which the tip is lost whatever the gains, for it sticks there, has no say.
    """
    valid = np.flatnonzero(work.refused() == col.GOOD)
    if not len(valid):
        return control, 0
    stiffness = work.rows[valid, col.CONTACT]
    extremes = np.unique(valid[[stiffness.argmin(), stiffness.argmax()]])
    work = work.part(extremes)
    orbits, status, _ = first_orbits(job, work)
    rows = lifts_by_stiffness(job, work).beside(work.rows) if engine == col.AVERAGING else work.rows
    gains = {name: getattr(control, name) for name in ("proportional_gain", "integral_gain")}
    tried = [replace(control, **{name: 0.5**n * gain for name, gain in gains.items()}) for n in range(HALVINGS + 1)]
    restless = 0
    for i in np.flatnonzero(status == col.GOOD):
        ends = []
        for trial in tried:
            ends.append(_rests(trial, job, work, engine, rows[i], orbits[i]))
            if ends[-1]:
                break
        if ends[-1] is not None:
            restless += not ends[-1]
            tried = tried[len(ends) - 1 :]
    return tried[0], restless


def _rests(control: Feedback, job: Job, work: Work, engine: int, row: np.ndarray, orbit: np.ndarray) -> bool | None:
    """Whether the feedback comes to rest after a nudge; None where the tip is lost."""
    loop, nudged = loop_of(control, job.scope, job.amplitude), orbit.copy()
    loop.lowest, loop.highest = -np.inf, np.inf
    nudged[col.TIP_OFFSET] -= TOO_NEAR * job.amplitude
    setup = Setup(work.law, work.lever, loop, generator(0, "unused: without noise"))
    done = engage_in_time(setup, row, 0.0, nudged, LoopState(engine).state)
    return bool(loop.settled) if done == col.GOOD else None
