"""A tapping tip on one scan line in time: full equation of motion, lock-in, PI controller, scanner.  Shares nothing with phasemap.

    z'' + 2 (a0 + a_s(d)) z' + z + F(d)/k = u0 cos(theta),   theta' = omega,   d = z - z0   (lengths in nm, forces as
    F/k in nm) d >= 0:  F = K sqrt(R) d^1.5 - f0,  a_s = a1 sqrt(d / R);      d < 0:  F = -f0 / (1 - d/d0)^2,  a_s = 0

Apart, the state is (theta, d, v) and runs in tau; in contact it is (theta, x = sqrt(d), v) and runs in s with d tau = 2
x ds, so that both powers of d are polynomials in x and dx/ds = v either way.  Dormand and Prince's order 8 with error
control (coefficients from scipy); contact begins and ends at a root of the step length, also where the tip turns back
within a step.  The lock-in's integral of z exp(-i theta) over the period is two more components of the state.
"""

import math

import numpy as np
from numba import njit
from scipy.integrate._ivp import dop853_coefficients as _c

A8, B8, E3, E5 = (np.ascontiguousarray(m) for m in (_c.A[:12, :12], _c.B, _c.E3[:12], _c.E5[:12]))
THETA, X, V = 0, 1, 2
U0, AL0, OM, SIZE, D0, KS, F0, AS = range(8)  # the first five belong to the lever, the others to a material
TURN = 2 * math.pi
LONGEST = 0.6  # step [1, in tau]


@njit(cache=True)
def rates(mode, y, p, z0, out):
    c, s = math.cos(y[0]), math.sin(y[0])
    x, v = y[1], y[2]
    if mode == 0:
        d, u, along, al = x, 1.0 - x / p[D0], 1.0, p[AL0]
        f = -p[F0] / (u * u)
    else:
        d, along, al = x * x, 2.0 * x, p[AL0] + p[AS] * x
        f = p[KS] * x * d - p[F0]
    z = d + z0
    out[0] = p[OM] * along
    out[1] = v
    out[2] = along * (p[U0] * c - z - f - 2.0 * al * v)
    out[3] = along * z * c
    out[4] = along * z * s


@njit(cache=True)
def step(mode, y, p, z0, h, stage, new, size):
    """One step of length h into `new`; its error relative to `size` (5)."""
    rates(mode, y, p, z0, stage[0])
    for i in range(1, 12):
        for c in range(5):
            total = 0.0
            for j in range(i):
                total += A8[i, j] * stage[j, c]
            new[c] = y[c] + h * total
        rates(mode, new, p, z0, stage[i])
    e3 = e5 = 0.0
    for c in range(5):
        total = a = b = 0.0
        for j in range(12):
            total += B8[j] * stage[j, c]
            a += E3[j] * stage[j, c]
            b += E5[j] * stage[j, c]
        new[c] = y[c] + h * total
        e3 += (a / size[c]) ** 2
        e5 += (b / size[c]) ** 2
    below = math.sqrt((e5 + 0.01 * e3) * 5.0)
    return abs(h) * e5 / below if below > 0.0 else below


@njit(cache=True)
def root(mode, y, p, z0, lo, hi, component, target, stage, new, size, slope):
    """Step length in (lo, hi) at which a component of the state reaches the target; `new` is the state there.

    Newton's method, bisection where it would leave the bracket.  The component is on one side at lo, on the other at
    hi.
    """
    step(mode, y, p, z0, hi, stage, new, size)
    positive = new[component] > target
    h = hi
    for _ in range(200):
        rates(mode, new, p, z0, slope)
        f = new[component] - target
        if (f > 0.0) == positive:
            hi = h
        else:
            lo = h
        last = h
        h = h - f / slope[component] if slope[component] != 0.0 else lo
        if not lo < h < hi:
            h = 0.5 * (lo + hi)
        step(mode, y, p, z0, h, stage, new, size)
        if abs(h - last) <= 4e-16 * hi:
            break
    return h


@njit(cache=True)
def period(z, v, z0, p, tol, first):
    """One drive period from theta = 0 at the tip offset z0: (z, v) at its end, the lock-in's first harmonic, steps.

    `first` (2): lengths of the steps to begin with, apart and in contact; kept up to date.
    """
    y, new, mid, slope = np.zeros(5), np.empty(5), np.empty(5), np.empty(5)
    stage, size = np.empty((12, 5)), np.empty(5)
    d = z - z0
    mode = 1 if d > 0.0 or (d == 0.0 and v > 0.0) else 0
    y[1], y[2] = (math.sqrt(d) if mode else d), v
    h, steps = first[mode], 0
    while True:
        size[0], size[1], size[2] = tol, tol * (math.sqrt(p[SIZE]) if mode else p[SIZE]), tol * p[SIZE]
        size[3] = size[4] = tol * p[SIZE]
        rest = (TURN - y[0]) / p[OM]
        ends = mode == 0 and h >= rest
        now = rest if ends else h
        error = step(mode, y, p, z0, now, stage, new, size)
        steps += 1
        if steps > 100000:
            return z, v, complex(np.nan, np.nan), steps
        if not error <= 1.0:
            h = now * (max(0.2, 0.9 * error ** (-0.125)) if error > 1.0 and error < 1e9 else 0.1)
            continue
        longer = min(now * min(4.0, 0.9 * max(error, 1e-12) ** (-0.125)), LONGEST)
        # leaving the mode: x > 0 apart, x < 0 in contact; it may come back within the step, hence the turning point
        out = 1.0 if mode == 0 else -1.0
        lo, hi = 0.0, -1.0
        turns = out * y[2] > 0.0 and out * new[2] < 0.0
        if out * new[1] > 0.0:
            hi = now
            if (
                y[1] == 0.0
            ):  # just entered: the state is on the border at both ends, and beyond the turning point inside
                if not (out * y[2] < 0.0 and out * new[2] > 0.0):
                    h = 0.5 * now
                    continue
                lo = root(mode, y, p, z0, 0.0, now, V, 0.0, stage, mid, size, slope)
        elif turns:
            turn = root(mode, y, p, z0, 0.0, now, V, 0.0, stage, mid, size, slope)
            if out * mid[1] > 0.0:
                hi = turn
        if hi > 0.0:
            now = root(mode, y, p, z0, lo, hi, X, 0.0, stage, new, size, slope)
            new[1] = 0.0
        if mode == 1 and new[0] >= TURN:
            root(mode, y, p, z0, 0.0, now, THETA, TURN, stage, new, size, slope)
            first[1] = h
            y[:] = new
            break
        y[:] = new
        if hi > 0.0:
            first[mode] = h
            mode = 1 - mode
            h = first[mode]
        elif ends:
            first[0] = max(longer, h)
            break
        else:
            h = longer
    d = y[1] * y[1] if mode else y[1]
    return d + z0, y[2], p[OM] / math.pi * complex(y[3], -y[4]), steps


@njit(cache=True)
def low_pass(stages, value, r):
    """Equal one-pole filters in a row, r = (time held) / (time constant), input held: exact."""
    n = len(stages)
    old = stages - value
    for i in range(n):
        total, weight = 0j, math.exp(-r)
        for j in range(i + 1):
            total += weight * old[i - j]
            weight *= r / (j + 1)
        stages[i] = value + total


@njit(cache=True)
def phase(x):
    """Degrees, within 180 of 0."""
    return math.degrees(math.atan2(x.real, -x.imag))


@njit(cache=True)
def march(tip, stages, loop, surface, label, levers, r, goal, gains, ramp, tol, first, record):
    """Periods one after another; returns how many were made.

    tip (z, v), stages (filters), loop (Z, integral, Z_engage): state, kept up to date.  surface (n) [nm] and label (n):
    what is under the tip at the middle of each period.  gains (Kp, Ki T).  ramp > 0: the controller is off, the tip
    comes down by so much a period, until the amplitude is at the goal.  record (n, 5): Z, error, phase [degree],
    amplitude, steps of the integrator.
    """
    for n in range(len(surface)):
        z0 = loop[0] - surface[n]
        tip[0], tip[1], a, steps = period(tip[0], tip[1], z0, levers[label[n]], tol, first)
        before = stages[-1]
        low_pass(stages, a, r)
        x = stages[-1]
        e = abs(x) - goal
        mean = (abs(before) + abs(x)) / 2
        record[n, 0], record[n, 1], record[n, 3], record[n, 4] = loop[0], mean - goal, mean, steps
        record[n, 2] = (phase(before) + phase(x)) / 2
        if ramp > 0.0:
            if e <= 0.0:
                return n + 1
            loop[0] -= ramp
        else:
            loop[1] += gains[1] * e
            loop[0] = loop[2] - (gains[0] * e + loop[1])
    return len(surface)


def table(case):
    """One row of parameters for each material, and the free first harmonic [nm]."""
    k, q, w, r = case["stiffness"], case["quality_factor"], case["frequency_ratio"], case["tip_radius"] * 1e9
    rows = np.zeros((len(case["materials"]), 8))
    u0 = case["free_amplitude"] / q * 1e9
    free = u0 / complex(1 - w * w, w / q)
    for row, m in zip(rows, case["materials"]):
        row[[U0, AL0, OM, SIZE, D0]] = u0, 0.5 / q, w, abs(free), case["decay_length"] * 1e9
        row[KS] = 4 / 3 * m["modulus"] / (1 - m["poisson_ratio"] ** 2) / k * 1e-9 * math.sqrt(r)
        row[F0] = 2 * math.pi * m["adhesion"] / k * r
        row[AS] = m["damping"] / math.sqrt(r)
    return rows, free


def path(case, t):
    """Position along the line [pixel] at the times t [s], and direction: 1 trace, -1 retrace, 0 turning."""
    length, o = float(len(case["labels"])), case["overscan"]
    v = 2 * length * (1 + 4 * o) * case["line_rate"]
    half, across = 2 * o * length / v, length / v
    t1, t2 = half, half + across
    t3 = t2 + 2 * half
    t4 = t3 + across
    a = v * v / (2 * o * length)
    x = np.select(
        [t < t1, t < t2, t < t3, t < t4],
        [
            -o * length + a * t * t / 2,
            v * (t - t1),
            length + v * (t - t2) - a * (t - t2) ** 2 / 2,
            length - v * (t - t3),
        ],
        -v * (t - t4) + a * (t - t4) ** 2 / 2,
    )
    return x, np.select([t < t1, t < t2, t < t3, t < t4], [0, 1, 0, -1], 0)


def under(case, x):
    """Topography [nm] and material at the positions x [pixel]."""
    n = len(case["labels"])
    return np.interp(x, np.arange(n) + 0.5, np.array(case["topography"]) * 1e9), np.array(case["labels"])[pixel(n, x)]


def pixel(n, x):
    return np.clip(np.floor(x), 0, n - 1).astype(int)


class Machine:
    """The state of everything between periods."""

    def __init__(self, case, tol):
        self.case, self.tol = case, tol
        self.levers, free = table(case)
        self.frequency = case["resonance_frequency"] * case["frequency_ratio"]
        order = case["order"]
        self.r = 2 * math.pi * case["bandwidth"] / math.sqrt(2 ** (1 / order) - 1) / self.frequency
        self.goal = case["setpoint"] * abs(free)
        self.gains = np.array([case["proportional_gain"], case["integral_gain"] / self.frequency])
        self.stages = np.full(order, free)
        self.tip = np.array([free.real, -self.levers[0, OM] * free.imag])  # z = Re(a e^{i theta}) at theta = 0
        self.loop = np.zeros(3)
        self.first = np.array([0.1, 0.01])

    def run(self, surface, label, ramp=0.0):
        record = np.empty((len(surface), 5))
        args = (self.levers, self.r, self.goal, self.gains, ramp, self.tol, self.first, record)
        made = march(self.tip, self.stages, self.loop, np.ascontiguousarray(surface), label, *args)
        if not np.all(np.isfinite(record[:made])):
            raise ArithmeticError(self.case["name"])
        return record[:made]

    def engage(self, pace=0.004):
        """Come down slowly until the amplitude is at the setpoint, then let the feedback settle, standing still; record of the latter.

        pace: way down in Q periods, relative to the free amplitude.
        """
        free = abs(self.stages[-1])
        surface, label = under(self.case, np.full(500, -self.case["overscan"] * len(self.case["labels"])))
        self.loop[:] = free + 5.0 + surface[0], 0.0, 0.0
        down = self.run(surface, label, pace * free / self.case["quality_factor"])
        while down[-1, 1] > 0.0:
            down = self.run(surface, label, pace * free / self.case["quality_factor"])
        self.loop[1], self.loop[2] = 0.0, self.loop[0] + self.gains[0] * down[-1, 1]
        settled = []
        while len(settled) <= 6 or np.ptp(settled[-1][:, 0]) > 1e-8 or np.max(np.abs(settled[-1][:, 1])) > 1e-8:
            settled.append(self.run(surface, label))
            if len(settled) > 400:
                raise ArithmeticError(f"{self.case['name']}: the feedback does not settle")
        return np.concatenate(settled)

    def scan(self):
        """One line, there and back.  Records (n, 5), x [pixel], direction."""
        n = math.ceil(self.frequency / self.case["line_rate"])
        x, direction = path(self.case, (np.arange(n) + 0.5) / self.frequency)
        return self.run(*under(self.case, x)), x, direction


def weights(case, frequency, count):
    """Time [periods] for which each period counts in the pixels 0 ... nx - 1 of a pass, in the order of time: (passes, nx, count).

    A period counts where its middle is, and in the pixel after, for as long as it is there.
    """
    nx, o = len(case["labels"]), case["overscan"]
    dwell = frequency / (2 * nx * (1 + 4 * o) * case["line_rate"])  # periods
    out = np.zeros((2, nx, count))
    for number, start in enumerate((2 * o * nx * dwell, (1 + 6 * o) * nx * dwell)):
        for k in range(nx):
            left, right = start + k * dwell, start + (k + 1) * dwell
            n = np.arange(count)
            over = np.minimum(n + 1, right) - np.maximum(n, left)
            out[number, k] = np.where(n + 0.5 < right, np.maximum(over, 0), 0)
    return out


def lines(case, record, x, direction, goal):
    """Averages over each pixel, {trace, retrace: {quantity: (nx) in m and degree}}, left to right."""
    n = len(case["labels"])
    out = {}
    for name, sign in (("trace", 1), ("retrace", -1)):
        here = direction == sign
        i = pixel(n, x[here])
        count = np.bincount(i, minlength=n)
        share = weights(case, case["resonance_frequency"] * case["frequency_ratio"], len(record))[0 if sign > 0 else 1]
        mean = [((share @ record[:, c]) / share.sum(axis=1))[::sign] for c in range(4)]
        out[name] = {
            "height": (mean[0] - goal) * 1e-9,
            "amplitude_error": mean[1] * 1e-9,
            "phase": mean[2],
            "amplitude": mean[3] * 1e-9,
            "lowest_amplitude": np.array([np.min(record[here, 3][i == j]) for j in range(n)]) * 1e-9,
            "phase_wraps": np.bincount(i, np.abs(np.diff(record[here, 2], prepend=record[here, 2][0])) > 180, n).astype(
                int
            ),
            "periods": count,
        }
    return out
