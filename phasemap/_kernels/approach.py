"""Which averaged orbit the controller finds when it engages from far.

At fixed drive the averaged orbits form a curve, followed here from far in the plane of the harmonic orbit's gap
b = z0 - A0 - A and of its amplitude. Quasi-static engagement follows the curve while z0 falls. Where z0 would rise
(a fold) the state jumps to the first later piece of the curve that z0 reaches again while falling. So the visited part
of the curve is where z0 is lower than ever before, and the controller stops at the first visited crossing of the
setpoint; a crossing that lies inside the jump counts if the tip lands beyond it, since the controller then retracts
to it.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from phasemap._kernels import columns as col
from phasemap._kernels.averaging import harmonics, mismatch
from phasemap._kernels.law import OPTIONS, Law, contact_force
from phasemap._kernels.mesh import reach_of

LARGEST_STEP = 0.6  # in (zeta, WEIGHT ln A), with b = epsilon sinh(zeta)
SMALLEST_STEP = 1e-6
TINY = 1e-6
WEIGHT = 4.0
MOST_STEPS = 400
MARGIN = 0.06  # a fold within this fraction of the setpoint makes the averaged decision doubtful
SURE, DOUBTFUL = 0, 1
START = 3.0  # where the scan at the setpoint amplitude starts, in reaches
PLAIN = 0.06  # mismatch at its first maximum that leaves no doubt, over that of the free lever


@njit(**OPTIONS)
def free_amplitude(lever: np.ndarray) -> float:
    """Amplitude [m] of the free lever at the drive frequency."""
    omega = lever[col.OMEGA]
    return lever[col.BASE] / math.hypot(1.0 - omega * omega, 2.0 * lever[col.ALPHA0] * omega)


@njit(**OPTIONS)
def scale_of(law: Law, p: np.ndarray, lever: np.ndarray, free: float) -> float:
    """Length [m] on which orbits change as the tip comes near: the reach of the long-range force.

    Without one, the indentation at which a force that sets in with contact takes up a third of the drive.
    """
    if p[4] != 0.0:
        return max(reach_of(law, p), 1e-3 * free)
    pull = -contact_force(law, 0.0, p) / lever[col.STIFFNESS]
    if not pull > 0.0:
        return 1e-3 * free
    half = min(0.15 * math.pi * lever[col.BASE] / pull, 0.05)
    return 0.5 * free * half * half


@njit(**OPTIONS)
def log_mismatch(
    law: Law, p: np.ndarray, lever: np.ndarray, reach: float, epsilon: float, zeta: float, eta: float
) -> float:
    """Logarithm of drive needed over drive given, squared, in the coordinates in which the curve is followed."""
    amplitude = math.exp(eta / WEIGHT)
    c = 1.0 + epsilon * math.sinh(zeta) / amplitude
    push, drag, _ = harmonics(law, p, lever, reach, amplitude, c)
    return math.log(1.0 + mismatch(lever, amplitude, push, drag))


@njit(**OPTIONS)
def crossing(
    law: Law, p: np.ndarray, lever: np.ndarray, reach: float, amplitude: float, near: float, far: float
) -> float:
    """Return c between near and far where an orbit has this amplitude (regula falsi); NaN if not bracketed."""
    push, drag, _ = harmonics(law, p, lever, reach, amplitude, near)
    h_near = math.log(1.0 + mismatch(lever, amplitude, push, drag))
    push, drag, _ = harmonics(law, p, lever, reach, amplitude, far)
    h_far = math.log(1.0 + mismatch(lever, amplitude, push, drag))
    if (h_near > 0.0) == (h_far > 0.0):
        return math.nan
    c = near
    for _ in range(60):
        before = c
        c = (near * h_far - far * h_near) / (h_far - h_near)
        push, drag, _ = harmonics(law, p, lever, reach, amplitude, c)
        h = math.log(1.0 + mismatch(lever, amplitude, push, drag))
        if abs(h) < 1e-10 or abs(c - before) < 1e-14 * max(1.0, abs(c)):
            break
        if (h > 0.0) == (h_far > 0.0):
            far, h_far = c, h
            h_near *= 0.5
        else:
            near, h_near = c, h
            h_far *= 0.5
    return c


@njit(**OPTIONS)
def far_start(law: Law, p: np.ndarray, lever: np.ndarray, reach: float, free: float, amplitude: float) -> float:
    """Return c so large that the surface hardly matters at this setpoint."""
    allowed = 0.02 * (1.0 - amplitude / free) * lever[col.BASE]
    away = scale_of(law, p, lever, free) / free
    for _ in range(60):
        if p[4] == 0.0 or abs(harmonics(law, p, lever, reach, free, 1.0 + away)[0]) < allowed:
            break
        away *= 1.5
    return 1.0 + away


@njit(**OPTIONS)
def _at_gap(
    law: Law, p: np.ndarray, lever: np.ndarray, reach: float, amplitude: float, gap: float
) -> tuple[float, float]:
    """Mismatch and in-phase force P of the harmonic orbit with this gap."""
    push, drag, _ = harmonics(law, p, lever, reach, amplitude, 1.0 + gap / amplitude)
    return mismatch(lever, amplitude, push, drag), push


@njit(**OPTIONS)
def caution(lever: np.ndarray) -> float:
    """How much wider than in air at high Q a margin must be: averaging is off by terms of order 1/Q."""
    return 1.0 + 120.0 * lever[col.ALPHA0]


@njit(**OPTIONS)
def engage_at_resonance(law: Law, p: np.ndarray, lever: np.ndarray, amplitude: float, guess: np.ndarray) -> bool:
    """`engage` without following the curve, where the answer is plain; False where it is not.

    At resonance the largest attraction P falls as A^(-1/2), and what holding the ratio r = A/A_free takes is
    u0 (1 - r^2)^(1/2): the attractive branch is nearest to its end at r = 3^(-1/2), and for r above that it reaches the
    setpoint if it exists there. So the mismatch at the setpoint amplitude is scanned from far to deep. It rises with
    the attraction to a first maximum. Well above zero there, the crossing before it is the one; well below, the tip
    jumps to the repulsive crossing behind.
    """
    free = free_amplitude(lever)
    if lever[col.OMEGA] != 1.0 or p[4] == 0.0:
        return False
    reach = reach_of(law, p)
    plain = (PLAIN * (1.0 - (amplitude / free) ** 2) + 0.03) * caution(lever)
    at = START * reach
    h, push = _at_gap(law, p, lever, reach, amplitude, at)
    before, h_before, first, h_first = at, h, 2.0 * at, -1.0
    attractive = h > 0.0  # the crossing lies farther out
    while attractive and h_first <= 0.0 and h > 0.0:
        before, h_before = at, h
        at *= 1.6
        h, push = _at_gap(law, p, lever, reach, amplitude, at)
    far = at
    if not attractive:
        for i in range(60):
            first, h_first = before, h_before
            before, h_before = at, h
            at = reach * START * 0.62 ** (i + 1) if i < 7 else -reach * 0.03 * 1.7 ** (i - 7)
            h, push = _at_gap(law, p, lever, reach, amplitude, at)
            if h < h_before or push > 0.0:
                break
            if h > plain:
                break
        if h > plain and push < 0.0 and h > h_before:
            attractive, far = True, before
            before = at
        else:
            # The first maximum lies between `first` and `at`: golden sections on -P.
            low, high = at, first
            one, two = low + 0.382 * (high - low), low + 0.618 * (high - low)
            h_one, push_one = _at_gap(law, p, lever, reach, amplitude, one)
            h_two, push_two = _at_gap(law, p, lever, reach, amplitude, two)
            for _ in range(5):
                if push_one < push_two:
                    high, two, h_two, push_two = two, one, h_one, push_one
                    one = low + 0.382 * (high - low)
                    h_one, push_one = _at_gap(law, p, lever, reach, amplitude, one)
                else:
                    low, one, h_one, push_one = one, two, h_two, push_two
                    two = low + 0.618 * (high - low)
                    h_two, push_two = _at_gap(law, p, lever, reach, amplitude, two)
            h_before, before = (h_one, one) if push_one < push_two else (h_two, two)
            if abs(h_before) < plain:
                return False
            if h_before > 0.0:
                attractive, far = True, START * reach
            else:
                while h <= 0.0 or push <= 0.0:
                    if h > 0.0 or at < -2.0 * amplitude:
                        return False
                    before = at
                    at = 1.7 * at if at < 0.0 else -0.03 * reach
                    h, push = _at_gap(law, p, lever, reach, amplitude, at)
                far = before
                before = at
    c = crossing(law, p, lever, reach, amplitude, 1.0 + before / amplitude, 1.0 + far / amplitude)
    if math.isnan(c):
        return False
    push, drag, mean = harmonics(law, p, lever, reach, amplitude, c)
    # dz0/dA along the orbits, from the two slopes of the mismatch at fixed A and fixed c.
    small = 1e-5
    h_c = _at_gap(law, p, lever, reach, amplitude, amplitude * (c - 1.0 + small * reach / amplitude))[0]
    push_a, drag_a, _ = harmonics(law, p, lever, reach, amplitude * (1.0 + small), c)
    h_a = mismatch(lever, amplitude * (1.0 + small), push_a, drag_a)
    h = mismatch(lever, amplitude, push, drag)
    if not c - (h_a - h) / (h_c - h) * reach / amplitude > 0.2 or (push > 0.0) == attractive:
        return False
    guess[0], guess[1], guess[2], guess[3], guess[4] = amplitude * c + mean, mean, amplitude, push, drag
    return True


@njit(**OPTIONS)
def engage_traced(law: Law, p: np.ndarray, lever: np.ndarray, amplitude: float, guess: np.ndarray) -> tuple[int, int]:
    """`engage` along the whole curve of averaged orbits."""
    free = free_amplitude(lever)
    reach = reach_of(law, p)
    epsilon = scale_of(law, p, lever, free)
    start = far_start(law, p, lever, reach, free, amplitude)
    zeta, eta = math.asinh((start - 1.0) * free / epsilon), WEIGHT * math.log(free)
    step, t_zeta, t_eta = 0.3, -1.0, 0.0
    h = log_mismatch(law, p, lever, reach, epsilon, zeta, eta)
    a, c, z, lowest, found = free, start, start * free, 1e300, math.nan
    rising, surety, margin = False, SURE, MARGIN * caution(lever)
    for _ in range(MOST_STEPS):
        slope_zeta = (log_mismatch(law, p, lever, reach, epsilon, zeta + TINY, eta) - h) / TINY
        slope_eta = (log_mismatch(law, p, lever, reach, epsilon, zeta, eta + TINY) - h) / TINY
        slope = math.hypot(slope_zeta, slope_eta)
        n_zeta, n_eta = slope_zeta / slope, slope_eta / slope
        onward = 1.0 if n_eta * t_zeta - n_zeta * t_eta > 0.0 else -1.0
        turn = onward * (n_eta * t_zeta - n_zeta * t_eta)  # cosine of the angle to the step before
        t_zeta, t_eta = onward * n_eta, -onward * n_zeta
        if turn < 0.8:
            step *= max(0.3, turn)
        # From a point along the tangent, go back to the curve along the normal.
        while True:
            at_zeta, at_eta, s = zeta + step * t_zeta, eta + step * t_eta, 0.0
            h, across = log_mismatch(law, p, lever, reach, epsilon, at_zeta, at_eta), slope
            for _ in range(5):
                if abs(h) < 1e-3 * step * across:
                    break
                move = -h / across
                h_new = log_mismatch(
                    law, p, lever, reach, epsilon, at_zeta + (s + move) * n_zeta, at_eta + (s + move) * n_eta
                )
                across = (h_new - h) / move
                s, h = s + move, h_new
                if not 0.2 * slope < across < 5.0 * slope or abs(s) > 0.5 * step:
                    break
            if abs(h) < 1e-3 * step * slope and abs(s) < 0.5 * step:
                break
            step *= 0.4
            if step < SMALLEST_STEP:
                return col.NO_AVERAGED_ORBIT, DOUBTFUL
        zeta, eta = at_zeta + s * n_zeta, at_eta + s * n_eta
        step = min(step * (1.6 if abs(s) < 0.1 * step else 1.0 if abs(s) < 0.25 * step else 0.6), LARGEST_STEP)

        a_before, c_before, z_before = a, c, z
        a = math.exp(eta / WEIGHT)
        c = 1.0 + epsilon * math.sinh(zeta) / a
        z = a * c + harmonics(law, p, lever, reach, a, c)[2]
        if a > a_before and not rising and abs(a_before - amplitude) < margin * amplitude:
            surety = DOUBTFUL
        rising = a > a_before
        if a_before > amplitude >= a and z < z_before and math.isnan(found):
            found = crossing(law, p, lever, reach, amplitude, c, c_before)
            if math.isnan(found):
                return col.NO_AVERAGED_ORBIT, DOUBTFUL
            if amplitude * found + harmonics(law, p, lever, reach, amplitude, found)[2] >= lowest:
                surety = DOUBTFUL
        elif a > amplitude >= a_before and z >= lowest:
            found = math.nan  # the tip lands before that crossing
        if not math.isnan(found) and z < lowest and (a < amplitude * (1.0 - margin) or rising):
            break
        lowest = min(lowest, z)
        if a < 0.3 * amplitude and c < -1.5:
            break
    if math.isnan(found):
        return col.NO_STABLE_ORBIT, DOUBTFUL
    push, drag, mean = harmonics(law, p, lever, reach, amplitude, found)
    guess[0], guess[1], guess[2], guess[3], guess[4] = amplitude * found + mean, mean, amplitude, push, drag
    return col.GOOD, surety


@njit(**OPTIONS)
def engage(law: Law, p: np.ndarray, lever: np.ndarray, amplitude: float, guess: np.ndarray) -> tuple[int, int]:
    """Find the averaged orbit that holds `amplitude` after engaging from far.

    Fills guess = (z0, mean deflection, A, P, S) and returns a status code and how sure the decision is.
    """
    narrowest = free_amplitude(lever) / math.sqrt(3.0)
    if amplitude > narrowest:
        if engage_at_resonance(law, p, lever, amplitude, guess):
            return col.GOOD, SURE
        return engage_traced(law, p, lever, amplitude, guess)
    # Below, the tip must first have passed where the attractive branch is nearest to its end.
    plain = engage_at_resonance(law, p, lever, narrowest, guess)
    if plain and guess[3] < 0.0 and engage_at_resonance(law, p, lever, amplitude, guess) and guess[3] < 0.0:
        return col.GOOD, SURE
    status, surety = engage_traced(law, p, lever, amplitude, guess)
    pulled = lever[col.OMEGA] == 1.0 and p[4] != 0.0
    return status, surety if plain or not pulled else DOUBTFUL


@njit(**OPTIONS)
def in_phase(law: Law, p: np.ndarray, lever: np.ndarray, reach: float, amplitude: float, c: float) -> float:
    """P + A (1 - omega^2), the part of the drive that acts against stiffness; it passes zero between two branches."""
    return harmonics(law, p, lever, reach, amplitude, c)[0] + amplitude * (1.0 - lever[col.OMEGA] ** 2)


@njit(**OPTIONS)
def averaged_orbits(law: Law, p: np.ndarray, lever: np.ndarray, amplitude: float) -> np.ndarray:
    """Every averaged orbit with this amplitude, far to near, as rows (z0, mean deflection, A, P, S).

    Two branches may be picometres apart, but between them the in-phase force passes zero: those points are sampled too.
    """
    reach = reach_of(law, p)
    free = free_amplitude(lever)
    epsilon = scale_of(law, p, lever, free) / amplitude
    start = max(far_start(law, p, lever, reach, free, amplitude), 1.5)
    zeta, end, samples = math.asinh(2.0 * start / epsilon), -math.asinh(6.0 / epsilon), 400
    at = np.empty(2 * samples + 2)
    count = 0
    x_before = 0.0
    for i in range(samples + 1):
        c = 1.0 + epsilon * math.sinh(zeta + (end - zeta) * i / samples)
        x = in_phase(law, p, lever, reach, amplitude, c)
        if i > 0 and (x > 0.0) != (x_before > 0.0):
            near, far = c, at[count - 1]
            for _ in range(60):
                middle = 0.5 * (near + far)
                if (in_phase(law, p, lever, reach, amplitude, middle) > 0.0) == (x > 0.0):
                    near = middle
                else:
                    far = middle
            at[count] = 0.5 * (near + far)
            count += 1
        at[count] = c
        count += 1
        x_before = x
    rows = np.zeros((32, 5))
    found = 0
    for i in range(1, count):
        root = crossing(law, p, lever, reach, amplitude, at[i], at[i - 1])
        if not math.isnan(root) and found < len(rows):
            push, drag, mean = harmonics(law, p, lever, reach, amplitude, root)
            rows[found, 0], rows[found, 1], rows[found, 2] = amplitude * root + mean, mean, amplitude
            rows[found, 3], rows[found, 4] = push, drag
            found += 1
    return rows[:found]
