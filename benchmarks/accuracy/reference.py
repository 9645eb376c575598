"""The reference: periodic orbits by shooting with scipy, which share no code with what they judge.

The equation of motion is integrated over one period by scipy's DOP853, started anew where the tip touches and leaves,
since the force's derivatives jump there; Newton's method on state and tip offset makes the period close on itself at
the setpoint amplitude, which is an integral that is carried along. A start says on which branch to look, and no more:
the orbit must be found to `ENOUGH` whatever the start was.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.accuracy.equation import Case, Equation

Array = np.ndarray
Rate = Callable[[float, Array], list[float]]

COARSE, FINE = 1e-10, 1e-13
"""Relative tolerances of the integrator: on the way, and at the end."""
NEAR, ENOUGH = 1e-6, 2e-9
"""Newton steps [setpoint amplitudes; as an angle, 2e-9 is 1e-7 degree] that end the way and the polish."""
MOST_ITERATIONS = 30
LONGEST_STEP = 0.1
"""[rad] In a step this long the tip turns round at most once."""


class NoOrbit(ArithmeticError):
    """Shooting did not converge."""


@dataclass(frozen=True)
class Start:
    """Roughly where an orbit is; names the branch."""

    # tip_offset, mean_deflection: [m]
    tip_offset: float
    mean_deflection: float
    phase: float  # [degree]


@dataclass(frozen=True)
class Reference:
    """A periodic orbit at the setpoint."""

    # tip_offset, mean_deflection: [m]
    tip_offset: float
    mean_deflection: float
    phase: float  # [degree]
    floquet: float  # largest modulus of the Floquet multipliers [1]
    # phase_uncertainty, height_uncertainty: Last step of Newton's method, and what the integrator's tolerance may
    # do to the orbit [degree, m]; the error that is left is smaller
    phase_uncertainty: float
    height_uncertainty: float
    state: tuple[float, float]  # z, z' [setpoint amplitudes] at `instant`
    instant: float  # time of the state [rad at resonance], near the point farthest from the surface


def find_orbit(case: Case, start: Start) -> Reference:
    """Find the orbit of a case near a start.

    Raises NoOrbit if shooting does not converge.

    Examples
    --------
    >>> case = Case(40.0, 400.0, 20e-9, 10e-9, 2e9, 0.0, 0.0, 0.35, 0.7)
    >>> orbit = find_orbit(case, Start(13.7e-9, 0.0, 45.0))
    >>> round(orbit.phase, 2), round(math.degrees(math.acos(0.7)), 2)  # undamped: but for higher harmonics
    (45.57, 45.57)
    """
    shooting = _Shooting(Equation.of(case), math.radians(90 - start.phase))
    lag, a = shooting.lag, case.amplitude
    mean = start.mean_deflection / a
    x = np.array([mean - 1.0, 0.0, start.tip_offset / a])
    x = shooting.relax(x)
    jacobian, x, _ = shooting.solve(x, None, COARSE, NEAR)
    jacobian, x, step = shooting.solve(x, jacobian, FINE, ENOUGH)
    end = shooting.period(x, FINE)
    doubt = abs(step) + abs(shooting.noise(x, jacobian))
    lag = math.atan2(end[3], end[2])
    multipliers = np.linalg.eigvals(jacobian[:2, :2] + np.eye(2))
    return Reference(
        tip_offset=float(x[2]) * a,
        mean_deflection=float(end[4]) * a,
        phase=90 - math.degrees(lag),
        floquet=float(max(abs(multipliers))),
        phase_uncertainty=math.degrees(float(np.hypot(doubt[0], doubt[1]))),
        height_uncertainty=float(doubt[2]) * a,
        state=(float(x[0]), float(x[1])),
        instant=shooting.begin,
    )


class _Shooting:
    """Residuals of one equation, and Newton's method on them; x = (z, z', z0) at the start of a period."""

    def __init__(self, equation: Equation, lag: float) -> None:
        self.equation = equation
        self.lag = lag
        self.begin = (lag - math.pi) / equation.omega  # the tip is far from the surface, whatever the branch

    def relax(self, x: Array) -> Array:
        """Let a few periods pass where the lever forgets quickly; a harmonic is not a good start in a liquid."""
        if self.equation.alpha0 < 0.02:
            return x
        for _ in range(4):
            x = np.array([*self.period(x, 1e-6)[:2], x[2]])
        return x

    def solve(self, x: Array, jacobian: Array | None, tolerance: float, enough: float) -> tuple[Array, Array, Array]:
        """Newton's method; the Jacobian is kept while the steps shrink tenfold. Returns it, x and the last step."""
        fresh = jacobian is None
        residual = self.residual(x, tolerance)
        if jacobian is None:
            jacobian = self.jacobian(x, residual, tolerance)
        last = math.inf
        for _ in range(MOST_ITERATIONS):
            step = -np.linalg.solve(jacobian, residual)
            size = float(np.max(abs(step)))
            if size > 0.1 * last and not fresh:
                jacobian, fresh = self.jacobian(x, residual, tolerance), True
                continue
            x, residual, taken = self.advance(x, step, residual, tolerance)
            if taken == 1.0 and size < enough:
                return jacobian, x, step
            last, fresh = size, False
        raise NoOrbit("Newton's method did not converge")

    def noise(self, x: Array, jacobian: Array) -> Array:
        """By how much the orbit would differ if the integrator's tolerance were four times as wide."""
        wider = self.residual(x, 4 * FINE) - self.residual(x, FINE)
        return np.asarray(np.linalg.solve(jacobian, wider))

    def advance(self, x: Array, step: Array, residual: Array, tolerance: float) -> tuple[Array, Array, float]:
        """Take a step, or the part of it that brings the orbit nearer to closing."""
        taken = min(1.0, 0.2 / float(np.max(abs(step))))
        before = float(np.linalg.norm(residual))
        while True:
            new = x + taken * step
            after = self.residual(new, tolerance)
            if float(np.linalg.norm(after)) < before or before < 100 * tolerance:
                return new, after, taken
            taken *= 0.5
            if taken < 1e-3:
                raise NoOrbit("no step brings the orbit nearer to closing")

    def residual(self, x: Array, tolerance: float) -> Array:
        """Change of z and z' over a period, and first harmonic less 1."""
        end = self.period(x, tolerance)
        return np.array([end[0] - x[0], end[1] - x[1], math.hypot(end[2], end[3]) - 1])

    def jacobian(self, x: Array, residual: Array, tolerance: float) -> Array:
        """By forward differences, a thousandth of the depth over which the force changes."""
        depth = abs(x[2] + x[0]) + self.equation.decay  # -x[0] is about how far the tip comes down
        width = max(1e-3 * depth, 1e-6)
        columns = [(self.residual(x + width * unit, tolerance) - residual) / width for unit in np.eye(3)]
        return np.column_stack(columns)

    def period(self, x: Array, tolerance: float) -> Array:
        """z, z', cosine and sine part of the first harmonic, and mean deflection after one period."""
        z0 = float(x[2])
        time, end = self.begin, self.begin + 2 * math.pi / self.equation.omega
        y = np.array([x[0], x[1], 0.0, 0.0, 0.0])
        touching = bool(x[0] > z0)
        for _ in range(200):
            time, y = _fly_or_press(self.equation, touching, z0, time, y, end, tolerance)
            if time >= end:
                return y
            touching = not touching
        raise NoOrbit("the tip touches the surface too often in a period")


def _rate(equation: Equation, touching: bool, z0: float) -> Rate:
    """Right-hand side in contact or before it, in plain floats: numpy's scalars are five times slower."""
    omega, alpha0, base = equation.omega, equation.alpha0, equation.base
    stiff, pull, loss, exponent = equation.stiff, equation.pull, equation.loss, equation.exponent
    weight = omega / math.pi
    inverse = 1 / equation.decay if equation.decay > 0 else 0.0
    reach = pull if equation.decay > 0 else 0.0

    def contact(time: float, y: Array) -> list[float]:
        z, v = y.item(0), y.item(1)
        d = max(z - z0, 0.0)
        c, s = math.cos(omega * time), math.sin(omega * time)
        damping = alpha0 + loss * d**exponent
        acceleration = base * c - 2 * damping * v - z - stiff * d * math.sqrt(d) + pull
        return [v, acceleration, weight * z * c, weight * z * s, 0.5 * weight * z]

    def flight(time: float, y: Array) -> list[float]:
        z, v = y.item(0), y.item(1)
        c, s = math.cos(omega * time), math.sin(omega * time)
        nearness = 1 - min(z - z0, 0.0) * inverse
        acceleration = base * c - 2 * alpha0 * v - z + reach / (nearness * nearness)
        return [v, acceleration, weight * z * c, weight * z * s, 0.5 * weight * z]

    return contact if touching else flight


def _fly_or_press(
    equation: Equation, touching: bool, z0: float, time: float, y: Array, end: float, tolerance: float
) -> tuple[float, Array]:
    """Integrate until the tip touches or leaves, or to the end."""
    from scipy.integrate import DOP853

    rate = _rate(equation, touching, z0)
    inward = -1.0 if touching else 1.0  # towards the other side of the surface
    solver = DOP853(rate, time, y, end, rtol=tolerance, atol=1e-2 * tolerance, max_step=LONGEST_STEP)
    while solver.status == "running":
        time, y = solver.t, solver.y
        solver.step()
        if solver.status == "failed":
            raise NoOrbit("the integrator failed")
        turns = inward * y[1] > 0 > inward * solver.y[1]
        if turns or inward * (solver.y[0] - z0) > 0:
            crossing = _crossing(solver.dense_output(), inward, z0, time, solver.t)
            if crossing is not None:
                return _to_surface(rate, z0, time, y, crossing, tolerance)
    return end, solver.y


def _crossing(course: Any, inward: float, z0: float, first: float, last: float) -> float | None:
    """When the tip crosses the surface within a step, even if it turns round in it."""
    from scipy.optimize import brentq

    def speed(time: float) -> float:
        return inward * float(course(time)[1])

    def beyond(time: float) -> float:
        return inward * (float(course(time)[0]) - z0)

    low, high = first, last
    if speed(first) < 0 < speed(last):  # it first moves away
        low = float(brentq(speed, first, last, xtol=1e-15))
    elif speed(first) > 0 > speed(last):
        high = float(brentq(speed, first, last, xtol=1e-15))
    if not beyond(high) > 0:
        return None
    return float(brentq(beyond, low, high, xtol=1e-15)) if beyond(low) < 0 else first


def _to_surface(
    rate: Rate, z0: float, first: float, y: Array, crossing: float, tolerance: float
) -> tuple[float, Array]:
    """Repeat the step up to the crossing, whose time is good to the interpolant only, and go on to the surface."""
    from scipy.integrate import solve_ivp

    if crossing > first:
        y = solve_ivp(rate, (first, crossing), y, "DOP853", rtol=tolerance, atol=1e-2 * tolerance).y[:, -1]
    short = (z0 - y[0]) / y[1] if y[1] != 0 else math.inf
    if abs(short) < 1e-5:  # else it hardly touches, and it does not matter which side it is on
        y = y + short * np.array(rate(crossing, y))
        crossing += short
        y[0] = z0
    return crossing, y
