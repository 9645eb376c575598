"""Makes tests/data/leaps.json: where a tip lands that attraction carries over its resonance, engaged in time.

    python tests/reference/make_leaps.py [how many draws]

The drive is 0.05 to 10 linewidths below resonance, or at 0.9 of it, under soft and ordinary levers.  Attraction brings
the lever nearer to its resonance as the tip comes down, its amplitude rises, and the orbit ends at a fold.  Kept are
draws in which the amplitude at resonance is above the free one by more than 3 nm, and the setpoint is held.

Method, which shares nothing with phasemap or the other references but the equation of motion.  The tip is lowered
period by period by `RAMP` of the free amplitude per ring-down time, Q/pi periods, until the amplitude behind a low-pass
of one ring-down time falls to the setpoint; an integral feedback (time constant 10 ring-down times) holds it there until
it varies by less than 2e-4 over 40 ring-down times.  Classical Runge-Kutta steps of order 4, shorter where the force
rises; contact is not located, which leaves some hundredths of a degree: enough to tell one branch from another.
"""

import json
import math
import pathlib
import sys

import numpy as np
from numba import njit

OUT = pathlib.Path(__file__).parent.parent / "data" / "leaps.json"
RAMP, RISE = 1e-3, 3e-9
OMEGA, ALPHA0, U0, PULL, DECAY, STIFF, LOSS, FREE = range(8)  # lengths in nm, forces over the stiffness


@njit(cache=True)
def acceleration(z, v, drive, p, z0):
    d, force = z - z0, 0.0
    if d >= 0.0:
        root = math.sqrt(d)
        force = p[STIFF] * d * root - p[PULL] + 2.0 * p[LOSS] * root * v
    elif p[DECAY] > 0.0:
        force = -p[PULL] / (1.0 - d / p[DECAY]) ** 2
    return p[U0] * drive - z - 2.0 * p[ALPHA0] * v - force


@njit(cache=True)
def longest(z, v, p, z0):
    """Length of a step: an eighth of a radian of the lever, a quarter of one of lever and surface, a fifth of the reach."""
    d, speed = z - z0, max(abs(v), 1e-9)
    if d >= 0.0:
        root = math.sqrt(d)
        rate = math.sqrt(1.0 + 1.5 * p[STIFF] * (root + math.sqrt(d + 1e-4))) + 2.0 * p[LOSS] * root
        return min(min(0.12, 0.25 / rate), 0.2 * max(d, 0.02) / speed)
    if p[DECAY] > 0.0:
        q = 1.0 - d / p[DECAY]
        rate = math.sqrt(1.0 + 2.0 * p[PULL] / p[DECAY] / q**3)
        return min(min(0.12, 0.25 / rate), 0.2 * q * p[DECAY] / speed)
    return min(0.1, max(-0.5 * d, 0.02) / speed)


@njit(cache=True)
def period(state, p, z0):
    """One period from drive phase 0; returns the cosine and sine parts of the first harmonic."""
    omega, t, z, v = p[OMEGA], 0.0, state[0], state[1]
    end, cosine, sine = 2.0 * math.pi / omega, 0.0, 0.0
    while t < end - 1e-12:
        h = min(longest(z, v, p, z0), end - t)
        c0, s0 = math.cos(omega * t), math.sin(omega * t)
        ch, sh = math.cos(omega * (t + 0.5 * h)), math.sin(omega * (t + 0.5 * h))
        c1, s1 = math.cos(omega * (t + h)), math.sin(omega * (t + h))
        a1 = acceleration(z, v, c0, p, z0)
        v2 = v + 0.5 * h * a1
        a2 = acceleration(z + 0.5 * h * v, v2, ch, p, z0)
        v3 = v + 0.5 * h * a2
        a3 = acceleration(z + 0.5 * h * v2, v3, ch, p, z0)
        v4 = v + h * a3
        a4 = acceleration(z + h * v3, v4, c1, p, z0)
        z1, v1 = z + h / 6 * (v + 2 * v2 + 2 * v3 + v4), v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        middle = 0.5 * (z + z1) + h * (v - v1) / 8
        cosine += h / 6 * (z * c0 + 4 * middle * ch + z1 * c1)
        sine += h / 6 * (z * s0 + 4 * middle * sh + z1 * s1)
        z, v, t = z1, v1, t + h
    state[0], state[1] = z, v
    return cosine * omega / math.pi, sine * omega / math.pi


@njit(cache=True)
def engage(p, z0, goal, ring, most):
    """Whether the amplitude `goal` is held, at which tip offset [nm] and with which phase [degree]."""
    response = p[U0] / complex(1.0 - p[OMEGA] ** 2, 2.0 * p[ALPHA0] * p[OMEGA])
    state, low = np.array([response.real, -p[OMEGA] * response.imag]), complex(response.real, -response.imag)
    forget, free = 1.0 / max(ring, 3.0), p[FREE]
    for _ in range(most):
        c, s = period(state, p, z0)
        low += forget * (complex(c, s) - low)
        if abs(low) <= goal:
            break
        z0 -= RAMP * free / ring * (8.0 if abs(abs(low) / free - 1.0) < 1e-4 and z0 > 1.05 * free else 1.0)
        if z0 < -20.0 * free:
            return False, z0, 0.0
    count = int(40 * ring) + 50
    for _ in range(40):
        least, largest, total, offset = math.inf, 0.0, complex(0.0, 0.0), 0.0
        for _ in range(count):
            c, s = period(state, p, z0)
            low += forget * (complex(c, s) - low)
            least, largest = min(least, abs(low)), max(largest, abs(low))
            z0 += 0.1 / ring * (goal - abs(low))
            total += complex(c, s)
            offset += z0 / count
        if max(largest - least, abs(0.5 * (largest + least) - goal)) < 2e-4 * goal:
            return True, offset, 90.0 - math.degrees(math.atan2(total.imag, total.real))
    return False, z0, 0.0


def held(case):
    """Outcome of a case in SI: whether it is held, tip offset [m] and phase [degree]."""
    alpha0, omega, k = 0.5 / case["quality_factor"], case["frequency_ratio"], case["stiffness"]
    radius, u0 = case["tip_radius"] * 1e9, case["free_amplitude"] * 1e9 / case["quality_factor"]
    free = u0 / math.hypot(1.0 - omega**2, 2.0 * alpha0 * omega)
    pull, decay = 2.0 * math.pi * case["adhesion"] * radius / k, case["decay_length"] * 1e9
    contact = 4.0 / 3.0 * case["modulus"] / (1.0 - case["poisson_ratio"] ** 2) * 1e-9 * math.sqrt(radius) / k
    p = np.array([omega, alpha0, u0, pull, decay, contact, case["damping"] / math.sqrt(radius), free])
    good, offset, phase = engage(
        p, 1.02 * free + 2.0 + 20.0 * decay + pull / 400.0, case["setpoint"] * free, case["quality_factor"] / math.pi,
        2_000_000,
    )  # fmt: skip
    return good, offset * 1e-9, phase


def draw(number):
    """One case in SI."""
    rng = np.random.default_rng([15, number])

    def over_decades(low, high):
        return float(f"{low * (high / low) ** rng.random():.4g}")

    soft = rng.random() < 0.5
    quality = over_decades(50, 300) if soft else over_decades(100, 600)
    linewidths = over_decades(0.05, 10)
    ratio = round(1 - linewidths / quality, 6) if rng.random() < 0.9 else 0.9
    larger = quality * math.hypot(1 - ratio**2, ratio / quality)
    return {
        "name": f"leap {number}",
        "stiffness": over_decades(0.1, 3) if soft else over_decades(2, 50),
        "quality_factor": quality,
        "frequency_ratio": ratio,
        "free_amplitude": over_decades(8e-9, 5e-8) * larger,
        "tip_radius": over_decades(5e-9, 3e-8),
        "decay_length": over_decades(1.5e-10, 5e-10),
        "contact": "dmt",
        "modulus": over_decades(1e7, 1e11),
        "adhesion": over_decades(0.005, 0.3),
        "damping": over_decades(5e-4, 0.05) * float(rng.random() > 0.2),
        "poisson_ratio": 0.35,
        "setpoint": round(0.3 + 0.65 * rng.random(), 3),
    }


def main():
    kept = []
    for number in range(int(sys.argv[1]) if len(sys.argv) > 1 else 120):
        case = draw(number)
        omega, quality = case["frequency_ratio"], case["quality_factor"]
        u0 = case["free_amplitude"] / quality
        if u0 * quality / omega - u0 / math.hypot(1.0 - omega**2, omega / quality) < RISE:
            continue
        good, offset, phase = held(case)
        if good:
            kept.append(case | {"orbit": {"tip_offset": offset, "phase": phase}})
            print(case["name"], f"{offset * 1e9:.3f} nm {phase:.2f} degree", flush=True)
    OUT.write_text("[\n" + ",\n".join(json.dumps(one) for one in kept) + "\n]\n")


if __name__ == "__main__":
    main()
