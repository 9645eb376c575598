"""Makes tests/data/wet.json: a lever that taps on a wet sample, integrated in time and engaged from far.

    python tests/reference/wet_contacts.py make [NUMBER ...]
    python tests/reference/wet_contacts.py check [EVERY]
    python tests/reference/wet_contacts.py compare [SOLVER]

`check` makes each EVERYth case again with steps good to a thirtieth of TOLERANCE and prints what changes. Nothing here is
shared with phasemap, nor with the other references: numpy, numba and the tableau of Dormand and Prince as scipy has it.

Equation.   z'' + 2 (alpha0 + alpha_s) z' + z + F/k = u0 cos(tau),  d = z - z0,  gap D = -d,  tau = 2 pi f0 t,  lengths in nm,
u0 = A0/Q, z towards the sample, driven at resonance. A neck forms when the gap falls to D_on and breaks when it rises to D_off.
    dry    (no neck, d < 0)   F = -f0 / (1 - d/d0)^2,                                        f0 = 2 pi w R
    wet    (neck, d < 0)      F = -s f0 / (1 - d/d0)^2 - C g(D),                             C = 4 pi R gamma cos(theta)
    solid  (d >= 0)           F = K sqrt(R) d^3/2 - s f0 - C,  alpha_s = alpha1 (d/R)^1/2,   K = 4/3 E/(1 - nu^2)
    g      constant volume 1 - D / sqrt(V/(pi R) + D^2); constant force 1; linear 1 - D/D_off
s (`wet_share`): share of the solids' attraction that is left while water is between them.

Sources, and what could be seen of them when this was written.
* Constant volume: Rabinovich, Esayanur, Moudgil, Langmuir 21, 10992 (2005). The paper was not at hand. Two programs that cite it
  (LIGGGHTS, cohesion easo/capillary; StupidCFD, BridgeForceRabinovich.m) have 2 pi r gamma cos(theta) [1 - 1/sqrt(1 + 2V/(pi r H^2))]
  between spheres of radius r; with r = 2R, Derjaguin's radius of a sphere and a plane, that is C g. It follows as well from a
  cylinder of water of radius x: V = pi x^2 (D + x^2/4R), F = 2 pi x^2 gamma cos(theta) / (D + x^2/2R). Confirmed.
* Rupture: D_off = V^1/3 - V^2/3/(5R). Willett, Adams, Johnson, Seville, Langmuir 16, 9396 (2000), as StupidCFD has it
  (BridgeRuptureWillet.m): (1 + theta/4) (V^1/3 - 2/5 V^2/3/r) of a sphere and a plane, r = 2R. Confirmed for theta = 0; the factor of
  the contact angle is left out, as Zitzler is said to do.
* Volume: V = 4 pi R h^2 + 4/3 pi h^3 + 2 pi r^2 h, from films of thickness h on both. Zitzler, Herminghaus, Mugele, Phys. Rev. B 66,
  155436 (2002): only the abstract was at hand, in which necks form and break in each cycle. The first two terms are, exactly, the
  cap of height 2h of a sphere of radius R + h: what the two films have in common when the solids touch. The third is the
  water that a flat contact of radius r presses out of both films, so that r is taken for the contact radius of the
  solids, and as V does not change here while the tip is pressed in, r = 0 (`contact_radius`). Not confirmed by the paper.
* D_on = 2h, where the films touch, or 3h, where they jump together: Santos and others, of whom only abstracts were at hand (Barcons et
  al., J. Phys. Chem. C 116, 7757 (2012): a force "relatively independent of distance", "a square well"). The constant force is
  theirs in this sense; the linear force is the constant chemical potential of the abstract of PubMed 25977852. D_on not confirmed.
* Kelvin: r_K = gamma Vm / (R T ln(1/RH)), 0.52 nm / ln(1/RH) for water at 25 C. Film of a wetting liquid in equilibrium with its vapour:
  A/(6 pi h^3) = (kT/v) ln(1/RH) (Israelachvili, Intermolecular and Surface Forces, on wetting films; from memory).
* VEDA's manual and dForce were not to be found.

Wet contacts.  See `drawn`. Those whose neck would break before it forms, or whose loop creates energy, are drawn again.

Engagement.  A lever that swings freely comes down by SPEED a ring-down time (Q/pi periods); where the amplitude behind a low-pass
of one ring-down time comes near the setpoint, an integral feedback lowers the tip by GAIN of the error a ring-down time, at
most by SPEED. Steps end on each change of state and, where a neck is near, on each turning point, so that none crosses a kink. What
is held is periodic if Newton's method on the map of one period, with the tip offset as third unknown, finds a stable orbit there
with the same events, to 3e-12 of the amplitude. Otherwise phasor and tip offset are means over groups of 16 ring-down times, with
half the gain, until their standard errors are 0.003 degree and 0.5 pm, or MOST periods have passed; setpoint and amplitude are
those of the mean phasor. Which share of the periods breaks the neck (4 of 19, 7 of 33, 11 of 52) goes with the way: `near` lists
what else is held after an approach 2.5 times as fast from elsewhere and, unless periodic, after two kicks and after a press.
Finer steps moved none of 13 periodic orbits by more than 1e-6 degree and 1e-5 pm. At its mean tip offset, without a feedback, an
irregular tip has the same mean to 1e-4 degree (of five; 3e-3 where one period in 44 breaks the neck).
The periodic cases were made with steps that end on every turning point, and of 0.4 at most; that moves a phase by 3e-10 degree.
When first compared, phasemap agreed in all 96 periodic cases (1.5e-4 degree) and in 98 irregular ones (0.1 degree), left 37, 52 and
166 unsettled, and had 151 in a pattern that harder kicks lead to, 82 in one not found here, and 88 within its own stated error.

Fields.  tip_offset, amplitude, mean_deflection, indentation [m], phase [degree, 90 - lag], dissipation and drag [J a cycle, all
and what the solid takes], period (1: periodic; n up to 12; 0: none), phase_spread [degree] and amplitude_spread [m] of single
periods, phase_error, tip_offset_error; shares of the periods in which a neck breaks (break_share) and the solids touch (contact_share).
neck: none | kept (never breaks) | every cycle | some cycles; solid: never | every cycle | some cycles.
"""

import json
import math
import pathlib
import sys

import numpy as np
from numba import njit
from scipy.integrate import DOP853, quad

WET = pathlib.Path(__file__).parent.parent / "data" / "wet.json"
SEED, COUNT = 20261124, 200
SPEED, GAIN = 0.02, 0.1  # nm and share of the error, in a ring-down time
TOLERANCE = 1e-12  # error of a step, over the free amplitude
MOST = 300_000  # periods in which a setpoint is held
KICK, PRESSED = 1e-3, 0.1  # of the free amplitude; nm
LOST = 3  # free amplitudes below the surface, where a tip is given up
POISSON = 0.35
GAMMA, MOLAR, GAS, BOLTZMANN, AVOGADRO = 0.072, 18.07e-6, 8.314462618, 1.380649e-23, 6.02214076e23  # water at 25 C, SI
MODELS = ("constant volume", "constant force", "linear")
DRY, MOIST, SOLID = range(3)  # states of the tip
OMEGA, ALPHA0, DRIVE, Z0, STIFF, PULL, REACH, ROOT, SHARE, CAP, VOLUME, ON, OFF, MODEL, TOL, SIZE = range(16)
Z, V, STATE, STEP = range(4)
ZC, ZS, ZM, WORK, DRAG, DEEPEST, BREAKS, TOUCHES, SERVED = range(9)
A, B, C, E3, E5 = (
    DOP853.A[:12, :12].copy(),
    DOP853.B,
    DOP853.C[:12].copy(),
    DOP853.E3[:12].copy(),
    DOP853.E5[:12].copy(),
)


@njit(cache=True, error_model="numpy")
def force(p, state, d):
    """F/k [nm]; in a state also a little beyond its ends, where stages of a step that is taken again may fall."""
    if state == SOLID:
        return (p[STIFF] * d * math.sqrt(d) if d > 0.0 else 0.0) - p[SHARE] * p[PULL] - p[CAP]
    s = 1.0 - min(d, 0.4 * p[REACH]) / p[REACH]
    long_range = -p[PULL] / (s * s)
    if state == DRY:
        return long_range
    if p[MODEL] == 0:
        shape = 1.0 + d / math.sqrt(p[VOLUME] + d * d)
    elif p[MODEL] == 1:
        shape = 1.0
    else:
        shape = 1.0 + d / p[OFF]
    return p[SHARE] * long_range - p[CAP] * shape


@njit(cache=True, error_model="numpy")
def drag(p, state, d):
    """2 alpha_s"""
    return 2.0 * p[ROOT] * math.sqrt(d) if state == SOLID and d > 0.0 else 0.0


@njit(cache=True, error_model="numpy")
def acceleration(p, state, cosine, z, v):
    d = z - p[Z0]
    return p[DRIVE] * cosine - (2.0 * p[ALPHA0] + drag(p, state, d)) * v - z - force(p, state, d)


@njit(cache=True, error_model="numpy")
def attempt(p, y, tau, h, to, kz, kv):
    """A step of length h: z, v and the integrals ZC to DRAG in `to`. Answers the error over the tolerance."""
    state = int(y[STATE])
    to[:] = 0.0
    five0 = five1 = three0 = three1 = 0.0
    for i in range(12):
        z = v = 0.0
        for j in range(i):
            z += A[i, j] * kz[j]
            v += A[i, j] * kv[j]
        z, v, angle = y[Z] + h * z, y[V] + h * v, p[OMEGA] * (tau + C[i] * h)
        cosine, sine = math.cos(angle), math.sin(angle)
        kz[i], kv[i] = v, acceleration(p, state, cosine, z, v)
        to[0] += B[i] * kz[i]
        to[1] += B[i] * kv[i]
        to[2 + ZC] += B[i] * z * cosine
        to[2 + ZS] += B[i] * z * sine
        to[2 + ZM] += B[i] * z
        to[2 + WORK] += B[i] * (p[DRIVE] * cosine - 2.0 * p[ALPHA0] * v) * v
        to[2 + DRAG] += B[i] * drag(p, state, z - p[Z0]) * v * v
        five0 += E5[i] * kz[i]
        five1 += E5[i] * kv[i]
        three0 += E3[i] * kz[i]
        three1 += E3[i] * kv[i]
    to *= h
    to[0] += y[Z]
    to[1] += y[V]
    five, three = five0 * five0 + five1 * five1, three0 * three0 + three1 * three1
    return 0.0 if five == 0.0 else h * five / math.sqrt(five + 0.01 * three) / p[TOL]


@njit(cache=True, error_model="numpy")
def located(p, y, tau, h, level, turn, to, kz, kv):
    """Length of the step, below h, that ends where the depth is `level`, or the tip turns; `to` has the end of a step of h."""
    start = y[V] if turn else y[Z] - p[Z0] - level
    end = to[1] if turn else to[0] - p[Z0] - level
    low, high, x = 0.0, h, h * start / (start - end)
    if not (0.001 * h < x < 0.999 * h):
        x = 0.5 * h
    for _ in range(80):
        attempt(p, y, tau, x, to, kz, kv)
        value = to[1] if turn else to[0] - p[Z0] - level
        slope = acceleration(p, int(y[STATE]), math.cos(p[OMEGA] * (tau + x)), to[0], to[1]) if turn else to[1]
        if abs(value) < 1e-15 * (abs(p[Z0]) + 10.0) or high - low < 1e-16:
            break
        if (value > 0.0) == (end > 0.0):
            high = x
        else:
            low = x
        x = x - value / slope
        if not (low < x < high):
            x = 0.5 * (low + high)
    return x


@njit(cache=True, error_model="numpy")
def period(p, y, out):
    """One period of the drive from phase 0; False if a step fails."""
    end, tau = 2.0 * math.pi / p[OMEGA], 0.0
    to, kz, kv = np.empty(7), np.empty(12), np.empty(12)
    out[:] = 0.0
    out[DEEPEST] = -1e300
    out[TOUCHES], out[SERVED] = y[STATE] == SOLID, y[STATE] != DRY
    for _ in range(100_000):
        if tau >= end - 1e-14:
            return True
        h, last = min(y[STEP], 1.0), False
        if tau + h >= end:
            h, last = end - tau, True
        error = attempt(p, y, tau, h, to, kz, kv)
        if not error <= 1.0:
            y[STEP] = h * (max(0.2, 0.9 * error**-0.125) if error > 0.0 else 0.1)
            if y[STEP] < 1e-13:
                return False
            continue
        grown = h * (min(6.0, 0.9 * error**-0.125) if error > 1e-8 else 6.0)
        y[STEP] = max(y[STEP], grown) if last else grown
        # Where no neck is near, a step need not end on a turning point.
        if y[V] * to[1] < 0.0 and (y[STATE] != DRY or (y[V] > 0.0 and to[0] - p[Z0] > -p[ON] - 1.0)):
            h = located(p, y, tau, h, 0.0, True, to, kz, kv)
            to[1] = 0.0
        state = y[STATE]
        there = to[0] - p[Z0]
        new, level = state, 0.0
        if state == DRY and there >= -p[ON]:
            new, level = MOIST, -p[ON]
        elif state == MOIST and there > 0.0:
            new = SOLID
        elif state == MOIST and there <= -p[OFF]:
            new, level = DRY, -p[OFF]
        elif state == SOLID and there < 0.0:
            new = MOIST
        if new != state:
            if there != level:
                h = located(p, y, tau, h, level, False, to, kz, kv)
            to[0] = p[Z0] + level
            out[BREAKS] += new == DRY
            out[TOUCHES] += new == SOLID
            out[SERVED] = 1.0
        out[DEEPEST] = max(out[DEEPEST], to[0] - p[Z0])
        y[Z], y[V], y[STATE] = to[0], to[1], new
        out[ZC : DRAG + 1] += to[2:]
        tau += h
    return False


@njit(cache=True, error_model="numpy")
def follow(p, y, slow, setpoint, gain, rate, until, count, rows):
    """Periods under a feedback that lowers the tip by gain (A - setpoint) a ring-down, at most by `rate`.

    `slow`: x, y of the phasor behind a low-pass of a ring-down. Stops where its amplitude falls below `until`. Rows, if there is room:
    x, y of the phasor, z0, and all that a period gives. Answers the periods done, or -1."""
    ring = p[OMEGA] / (2.0 * math.pi * p[ALPHA0])
    weight, out = -math.expm1(-1.0 / ring), np.empty(9)
    for i in range(count):
        if not period(p, y, out):
            return -1
        a, b = out[ZC] * p[OMEGA] / math.pi, -out[ZS] * p[OMEGA] / math.pi
        slow[0] += weight * (a - slow[0])
        slow[1] += weight * (b - slow[1])
        if i < len(rows):
            rows[i, 0], rows[i, 1], rows[i, 2], rows[i, 3:] = a, b, p[Z0], out
        amplitude = math.hypot(slow[0], slow[1])
        if amplitude < until:
            return i + 1
        p[Z0] -= min(max(gain * (amplitude - setpoint), -rate), rate) / ring
        if p[Z0] < -LOST * p[SIZE]:
            return -1
    return count


def film_volume(radius, film, contact_radius=0.0):
    """Volume [m3] that films of this thickness on tip and sample give to a neck."""
    return 4 * math.pi * radius * film**2 + 4 / 3 * math.pi * film**3 + 2 * math.pi * contact_radius**2 * film


def rupture_gap(radius, volume):
    return volume ** (1 / 3) - volume ** (2 / 3) / (5 * radius)


def kelvin_radius(humidity, temperature=298.15):
    return GAMMA * MOLAR / (GAS * temperature * math.log(1 / humidity))


def film_thickness(humidity, hamaker=1e-20, temperature=298.15):
    """Thickness [m] of a water film in equilibrium with the vapour; Hamaker constant of the solid and air across water [J]."""
    energy = BOLTZMANN * temperature * math.log(1 / humidity) * AVOGADRO / MOLAR
    return (hamaker / (6 * math.pi * energy)) ** (1 / 3)


def parameters(case, tolerance=TOLERANCE):
    """What the compiled functions take, lengths in nm."""
    r, k = case["tip_radius"], case["stiffness"]
    p = np.zeros(16)
    p[OMEGA], p[ALPHA0], p[SIZE] = 1.0, 0.5 / case["quality_factor"], case["free_amplitude"] * 1e9
    p[DRIVE] = p[SIZE] / case["quality_factor"]
    p[STIFF] = 4 / 3 * case["modulus"] / (1 - POISSON**2) * math.sqrt(r) / k * 1e-9**0.5
    p[PULL], p[REACH] = 2 * math.pi * case["adhesion"] * r / k * 1e9, case["decay_length"] * 1e9
    p[ROOT], p[SHARE] = case["damping"] / math.sqrt(r * 1e9), case["wet_share"]
    p[CAP] = 4 * math.pi * r * case["surface_tension"] * math.cos(math.radians(case["contact_angle"])) / k * 1e9
    p[VOLUME] = case["volume"] / (math.pi * r) * 1e18
    p[ON], p[OFF], p[MODEL] = case["forms_at"] * 1e9, case["breaks_at"] * 1e9, MODELS.index(case["model"])
    p[TOL] = tolerance * p[SIZE]
    return p


def loop_energy(case):
    """Energy [J] that a neck takes that forms and breaks: between its two gaps the tip comes dry and goes wet."""
    p = parameters(case)
    lost, _ = quad(lambda gap: force(p, DRY, -gap) - force(p, MOIST, -gap), p[ON], p[OFF], epsabs=1e-13, epsrel=1e-12)
    return lost * case["stiffness"] * 1e-18


class Tapping:
    """A tip in time, from a free swing far from the sample."""

    def __init__(self, case, start=0.0, tolerance=TOLERANCE):
        self.case, self.p = case, parameters(case, tolerance)
        p = self.p
        self.amplitude, self.ring = p[SIZE], p[OMEGA] / (2 * math.pi * p[ALPHA0])
        p[Z0] = p[SIZE] + max(p[OFF], 12 * p[REACH]) + 0.5 + start
        self.y = np.array([0.0, p[SIZE], DRY, 0.01])  # z = A0 sin(tau)
        self.slow = np.array([0.0, -p[SIZE]])

    def pass_periods(self, count, target=0.0, gain=0.0, rate=SPEED, until=-1.0, record=True):
        rows = np.empty((count if record else 0, 12))
        done = follow(self.p, self.y, self.slow, target, gain, rate, until, count, rows)
        if done < 0:
            raise OverflowError("the tip is lost")
        return rows if record else done

    def descend(self, target, speed):
        while self.pass_periods(100_000, -1e9, GAIN, speed, target + speed / GAIN, record=False) == 100_000:
            pass

    def orbit(self, target=None):
        """Newton's method from here on the map of a period, and on z0 if there is a target; rows of one period, or None."""
        n, size = (2 if target is None else 3), self.amplitude

        def mapped(x):
            p, y, out = self.p.copy(), self.y.copy(), np.empty(9)
            y[:2], p[Z0] = x[:2], x[2]
            if not period(p, y, out) or y[STATE] != self.y[STATE]:
                raise ArithmeticError
            amplitude = math.hypot(out[ZC], out[ZS]) * p[OMEGA] / math.pi
            return np.array([*(y[:2] - x[:2]), amplitude - (target or 0.0)])[:n], out

        x, before = np.array([*self.y[:2], self.p[Z0]]), None
        try:
            for _ in range(25):
                f, out = mapped(x)
                if before is not None and (out[BREAKS], out[TOUCHES] > 0) != before:
                    return None
                before = out[BREAKS], out[TOUCHES] > 0
                jacobian = np.empty((n, n))
                for i in range(n):
                    by = np.zeros(3)
                    by[i] = 1e-6 * size
                    jacobian[:, i] = (mapped(x + by)[0] - mapped(x - by)[0]) / (2e-6 * size)
                if np.abs(f).max() < 3e-12 * size:
                    break
                x[:n] -= np.linalg.solve(jacobian, f)
                if abs(x[2] - self.p[Z0]) > 0.02 * size:
                    return None
            else:
                return None
        except (ArithmeticError, np.linalg.LinAlgError):
            return None
        if np.abs(np.linalg.eigvals(jacobian[:2, :2] + np.eye(2))).max() > 1 - 1e-9:
            return None
        a, b = out[ZC] * self.p[OMEGA] / math.pi, -out[ZS] * self.p[OMEGA] / math.pi
        self.y[:2], self.p[Z0] = x[:2], x[2]
        return np.array([[a, b, x[2], *out]])

    def settle(self, target=None):
        """What is held at an amplitude, or at the tip offset where it is."""
        gain, held = (0.0, target or 0.0) if target is None else (GAIN, target)
        block = int(4 * self.ring) + 12
        for i in range(130):
            rows = self.pass_periods(block, held, gain)
            zeta = rows[:, 0] + 1j * rows[:, 1]
            apart = np.abs(zeta[-50:] - zeta[-1]).max()
            off = 0.0 if target is None else abs(abs(zeta[-1]) - target)
            events = rows[:, 3 + BREAKS] + 1j * (rows[:, 3 + TOUCHES] > 0)
            if i > 3 and max(apart, off) < 3e-4 * self.amplitude and np.all(events == events[0]):
                found = self.orbit(target)
                if found is not None and found[0, 3 + BREAKS] == events[0].real:
                    return self.stated(found, 1)
            if i > 31 and apart > 3e-4 * self.amplitude:
                break
        return self.mean(held, 0.5 * gain)

    def mean(self, target, gain):
        """The mean of groups of periods. What the feedback holds is corrected until the mean phasor has the amplitude."""
        size, groups, kept, done, held = max(int(16 * self.ring), 4000), [], [], 0, target
        while done < MOST:
            rows = self.pass_periods(size, held, gain)
            done += size
            kept.append(rows)
            zeta = complex(*rows[:, :2].mean(0))
            shift = target - abs(zeta) if gain else 0.0
            held += 0.5 * shift
            groups.append((rows[:, 2].mean() + shift, math.degrees(math.atan2(zeta.imag, zeta.real))))
            if len(groups) < 8:
                continue
            skip = max(2, len(groups) // 5)
            errors = np.std(groups[skip:], axis=0, ddof=1) / math.sqrt(len(groups) - skip)
            if errors[0] < 5e-4 and errors[1] < 3e-3:
                break
        last = (rows[:, 0] + 1j * rows[:, 1])[-240:]
        same = [n for n in range(1, 13) if np.abs(last[n:] - last[:-n]).max() < 1e-6 * self.amplitude]
        found = self.stated(np.concatenate(kept[skip:]), same[0] if same else 0)
        if gain:
            found["tip_offset"] += target * 1e-9 - found["amplitude"]
        return found | {"tip_offset_error": errors[0] * 1e-9, "phase_error": errors[1]}

    def stated(self, rows, repeats):
        zeta, single = complex(*rows[:, :2].mean(0)), rows[:, 0] + 1j * rows[:, 1]
        out, unit = rows[:, 3:].mean(0), self.case["stiffness"] * 1e-18
        breaks, touches, served = ((rows[:, 3 + i] > 0).mean() for i in (BREAKS, TOUCHES, SERVED))
        found = {
            "period": repeats, "tip_offset": rows[:, 2].mean() * 1e-9, "amplitude": abs(zeta) * 1e-9,
            "phase": 90 + math.degrees(math.atan2(zeta.imag, zeta.real)),
            "mean_deflection": out[ZM] * self.p[OMEGA] / (2 * math.pi) * 1e-9, "indentation": out[DEEPEST] * 1e-9,
            "dissipation": out[WORK] * unit, "drag": out[DRAG] * unit,
            "breaks": out[BREAKS], "break_share": breaks, "contact_share": touches,
            "neck": "none" if served == 0 else "kept" if breaks == 0 else "every cycle" if breaks == 1 else "some cycles",
            "solid": "never" if touches == 0 else "every cycle" if touches == 1 else "some cycles",
        }  # fmt: skip
        if repeats != 1:
            found |= {
                "amplitude_spread": np.abs(single).std() * 1e-9,
                "phase_spread": np.degrees(np.angle(single / zeta)).std(),
            }
        return found


def orbit_at(case, z0, start=None, tolerance=TOLERANCE):
    """What a tip comes to at this tip offset [m], from a free swing or from (z, dz/dtau, state) at drive phase 0 [nm]."""
    tip = Tapping(case, tolerance=tolerance)
    tip.p[Z0] = z0 * 1e9
    if start is not None:
        tip.y[:3] = start
    return tip.settle()


def lowered(case, speed=SPEED, start=0.0, tolerance=TOLERANCE):
    """The tip that has come from far to the setpoint."""
    tip = Tapping(case, start, tolerance)
    tip.descend(case["setpoint"] * tip.amplitude, speed)
    return tip


def engage(case, speed=SPEED, start=0.0, tolerance=TOLERANCE):
    """What a tip that comes from far is held at, at its setpoint."""
    try:
        tip = lowered(case, speed, start, tolerance)
        return {"held": True} | tip.settle(case["setpoint"] * tip.amplitude)
    except OverflowError:
        return {"held": False}


def differs(one, known, degree, length):
    if not (one["held"] and known["held"]):
        return one["held"] != known["held"]
    return abs(one["phase"] - known["phase"]) > degree or abs(one["tip_offset"] - known["tip_offset"]) > length


def made(case):
    """What the tip is held at, and `near`: what else where it comes faster, or is kicked, or is pressed on for a while."""
    tip = lowered(case)
    size, target = tip.amplitude, case["setpoint"] * tip.amplitude
    first = {"held": True} | tip.settle(target)
    ways, found = [engage(case, 2.5 * SPEED, 0.13)], [first]
    if first["period"] != 1:
        for angle in (0.0, 2.1):
            tip.y[:2] += KICK * size * np.array([math.cos(angle), math.sin(angle)])
            ways.append({"held": True} | tip.settle(target))
        tip.p[Z0] -= PRESSED
        tip.pass_periods(int(10 * tip.ring), record=False)
        ways.append({"held": True} | tip.settle(target))
    apart = (1e-4, 1e-13) if first["period"] == 1 else (0.01, 1e-11)
    for one in ways:
        if all(differs(one, known, *apart) for known in found):
            found.append(one)
    names = ("held", "period", "tip_offset", "phase", "break_share")
    return case | first | {"near": [{name: one.get(name) for name in names} for one in found[1:]]}


def drawn(count):
    """Wet contacts, evenly in the logarithm but for setpoint, damping, decay length, share, angle."""
    rng, cases = np.random.default_rng(SEED), []

    def between(low, high, log=True):
        x = math.exp(rng.uniform(math.log(low), math.log(high))) if log else rng.uniform(low, high)
        return float(f"{x:.4g}")

    while len(cases) < count:
        case = {
            "stiffness": between(2, 40), "resonance_frequency": between(70e3, 300e3), "quality_factor": between(100, 500),
            "tip_radius": between(5e-9, 30e-9), "free_amplitude": between(5e-9, 60e-9), "setpoint": between(0.5, 0.95, False),
            "modulus": between(0.1e9, 70e9), "adhesion": between(0.02, 0.1), "damping": between(0, 0.05, False),
            "decay_length": between(0.2e-9, 0.4e-9, False), "film": between(0.1e-9, 1.5e-9), "wet_share": between(0, 1, False),
            "contact_angle": between(0, 60, False), "surface_tension": GAMMA, "model": MODELS[len(cases) % 3],
            "films_apart": int(rng.integers(2, 4)), "poisson_ratio": POISSON,
        }  # fmt: skip
        case["volume"] = float(f"{film_volume(case['tip_radius'], case['film']):.10g}")
        case["forms_at"] = float(f"{case['films_apart'] * case['film']:.10g}")
        case["breaks_at"] = float(f"{rupture_gap(case['tip_radius'], case['volume']):.10g}")
        if case["breaks_at"] > 1.02 * case["forms_at"] and loop_energy(case) > 0:
            cases.append(case)
    return cases


def closes(case, found):
    """Whether all that is lost is drag and broken necks, in a periodic orbit."""
    lost = found["drag"] + found["breaks"] * loop_energy(case)
    scale = case["stiffness"] * case["free_amplitude"] ** 2 / case["quality_factor"]
    return abs(found["dissipation"] - lost) < 1e-8 * scale


def write(cases):
    rows = json.loads(json.dumps(cases), parse_float=lambda text: float(f"{float(text):.11g}"))
    WET.write_text("[\n" + ",\n".join(json.dumps(row) for row in rows) + "\n]\n")


def make(*numbers):
    """All, or those of these numbers again."""
    cases = {case["number"]: case for case in json.loads(WET.read_text())} if numbers else {}
    for number, case in enumerate(drawn(COUNT)):
        if not numbers or str(number) in numbers:
            one = cases[number] = {"number": number} | made(case)
            assert one["period"] != 1 or closes(case, one), one
            print(number, *(one[name] for name in ("period", "phase", "neck", "solid")), len(one["near"]), flush=True)
            write([cases[key] for key in sorted(cases)])


def check(every=10):
    """Print how far finer steps move the periodic orbits."""
    for one in json.loads(WET.read_text())[:: int(every)]:
        if one.get("period") == 1:
            finer = engage(one, tolerance=TOLERANCE / 30)
            moved = [finer.get(name, math.nan) - one[name] for name in ("phase", "tip_offset")]
            print(one["number"], f"{moved[0]:.1e} degree, {moved[1] * 1e12:.1e} pm", finer.get("neck"), one["neck"])


def compare(solver="auto"):
    """Print how often phasemap agrees, and where it does not."""
    import phasemap as pm

    table, worst = {}, [0.0, 0.0]
    for case in json.loads(WET.read_text()):
        angle = case["contact_angle"]
        law = pm.interaction.Capillary(
            case["film"], volume=case["volume"], surface_tension=case["surface_tension"], contact_angle=angle,
            tip_angle=angle, reach=case["films_apart"] / 2, wet_attraction=case["wet_share"], model=case["model"],
        )  # fmt: skip
        scope = pm.Microscope(
            pm.Cantilever(case["stiffness"], case["resonance_frequency"], case["quality_factor"]),
            pm.Tip(case["tip_radius"]), pm.Drive(case["free_amplitude"]), pm.Interaction(law, case["decay_length"]),
        )  # fmt: skip
        material = pm.Material(case["modulus"], case["adhesion"], case["damping"], poisson_ratio=POISSON)
        pixel = pm.solve_pixel(material, scope, case["setpoint"], solver)
        periodic = case["period"] == 1
        off = min(abs(pixel.phase - one["phase"]) for one in (case, *case["near"]) if one["held"])
        says = "agrees" if off < (1e-3 if periodic else 0.1) else "WRONG"
        if pixel.status.name != "good":
            says = "unsolved"
        elif (pixel.motion == "periodic") != periodic:
            says = "other motion"
        key = "periodic" if periodic else "irregular", says
        table[key] = table.get(key, 0) + 1
        if says == "agrees":
            worst[not periodic] = max(worst[not periodic], off)
        else:
            known = {name: case[name] for name in ("period", "phase", "tip_offset", "break_share")}
            print(case["number"], says, pixel, known, case["near"])
    for key, count in sorted(table.items()):
        print(*key, count)
    print(f"within {worst[0]:.1e} degree where periodic, {worst[1]:.1e} where not")


if __name__ == "__main__":
    task, *rest = sys.argv[1:]
    {"make": make, "check": check, "compare": compare}[task](*rest)
