"""Which orbit a quasi-static engagement ends on, in time (hard_map.py), for hard cases.

The state is that of a stroboscope: (z, z') once a drive period.  The tip offset is lowered in small steps and time
passes after each until the state repeats itself.  The wait is shortened: from the measured derivative of the period map
the fixed point ahead is computed (Newton), and taken only if it lies near, is reached by contraction, and attracts
(both multipliers inside the unit circle); otherwise time passes.  A step that changes the oscillation much, passes the
setpoint, or cannot be followed is taken back and quartered, down to the smallest; only then whatever happens happens:
the tip jumps.

If the amplitude passes the setpoint continuously, the setpoint is held there.  If it jumps across, the controller finds
it too small and retracts: the tip offset is raised along the new oscillation until the setpoint is reached from below;
if the amplitude jumps across it again, nothing holds the setpoint.

outcome: "held"; "jumps across" (no oscillation holds the setpoint); "unsteady" (what reaches the setpoint does not
repeat every period); "never reached" (pressed in by a centimetre the lever still swings by more than the setpoint);
"budget" (the periods allowed were not enough to tell).
"""

import numpy as np
from hard_map import AL0, D0, FA, U0, W, change, differentiate, parameters, period, wait

TOL, TIGHT = 1e-9, 1e-11


class Tip:
    """A tip over a surface: lets time pass, counts periods, reads amplitude and phase.  Lengths in nm."""

    def __init__(self, case, shortcut=True):
        self.p, self.free = parameters(case)
        w, alpha = self.p[W], self.p[AL0]
        free = self.p[U0] / complex(1 - w**2, 2 * alpha * w)  # z = Re(free exp(i w tau)), z' = Re(i w free ...)
        self.s = np.array([free.real, -w * free.imag])
        self.shortcut = shortcut
        self.q = 0.5 / alpha
        decay = self.q * w / np.pi  # periods in which a free amplitude falls to 1/e
        self.block = int(min(max(8, decay / 4), 20_000))
        self.patience = int(min(12 * decay + 200, 400_000))
        self.periods, self.amplitude, self.phase, self.floquet = 0, np.nan, np.nan, np.nan

    def read(self, c, s):
        self.amplitude, self.phase = float(np.hypot(c, s)), float(90 - np.degrees(np.arctan2(s, c)))

    def leap(self, z0, reach):
        """Newton to the fixed point ahead, if near (within reach), contracting and attracting. True if there."""
        u, jac, r, out = np.array([*self.s, z0]), None, np.zeros(3), np.empty(5)
        size = 1e-7 * (np.hypot(*self.s) + 1e-3 * self.free)
        last = np.inf
        for i in range(14):
            if i in (0, 5, 10):
                jac = np.zeros((3, 3))
                self.periods += 6
                if not differentiate(self.p, u, size, TIGHT, jac):
                    return False
                multipliers = 1 + np.linalg.eigvals(jac[:2, :2]) if np.all(np.isfinite(jac)) else np.array([np.inf])
                if not np.all(np.abs(multipliers) < 1):
                    return False
            self.periods += 1
            if not change(self.p, u, TIGHT, out, r):
                return False
            d = np.linalg.solve(jac[:2, :2], -r[:2])
            way = np.hypot(*d)
            enough = (1e-9 + 20 * TIGHT * self.q) * self.free  # the integrator's own noise is amplified by Q
            if not (way <= 0.5 * last or way < enough) or (last == np.inf and way > reach):
                return False
            u[:2] += d
            last = way
            if way < enough:
                self.s = u[:2].copy()
                period(self.p, z0, u[:2].copy(), TIGHT, out)
                self.read(out[0], out[1])
                self.floquet = float(np.max(np.abs(multipliers)))
                return True
        return False

    def settle(self, z0, near=None):
        """Let the state come to rest at z0; True if it repeats every period.  near: the shortcut is tried at once, for a fixed point
        within this distance."""
        if self.shortcut and near is not None and self.leap(z0, near):
            return True
        spent = 0
        while spent < self.patience:
            trail = np.empty((self.block, 4))
            if not wait(self.p, z0, self.s, self.block, TOL, trail):
                raise ArithmeticError("integration failed")
            spent += self.block
            self.periods += self.block
            self.read(*trail[-1, 2:])
            move = np.max(np.hypot(trail[-8:, 0], trail[-8:, 1] / self.p[W]))
            if move * max(1.0, self.q / np.pi) < 1e-8 * self.free:
                return True
            if self.shortcut and self.leap(z0, 0.03 * self.free):
                return True
        self.read(*trail[:, 2:].mean(axis=0))
        return False

    def state(self):
        return self.s.copy(), self.amplitude, self.phase

    def restore(self, saved):
        self.s, self.amplitude, self.phase = saved[0].copy(), saved[1], saved[2]

    def signal(self):
        return self.amplitude * np.exp(1j * np.radians(self.phase))


def start_of(tip):
    """A tip offset at which the surface hardly matters."""
    pull, d0, free = tip.p[FA], tip.p[D0], tip.free
    if d0 <= 0:
        return 1.001 * free
    # the force at the apex is below 1e-3 of what bends the lever, u0 or the amplitude's own
    return free + d0 * (1 + min(np.sqrt(pull / (1e-3 * tip.p[U0])), 200 * max(1, (pull / d0) ** (1 / 3))))


def depth_limit(p, free):
    """Tip offset [nm] below which no instrument would press the lever in, nor the law of force hold."""
    return -(30 * free + 20 * p[FA] + 100)


def engage(case, step_max=0.02, step_min=1e-5, budget=60_000, shortcut=True, log=None):
    """Lower the tip, hold the setpoint; returns a dict, lengths in nm."""
    tip = Tip(case, shortcut)
    free, goal = tip.free, case["setpoint"] * tip.free
    z0 = start_of(tip)
    high, low = step_max * free, step_min * free
    jumps, unsteady, sign, step, falling, older, last = [], 0, -1.0, high, False, None, 0.0
    steady = tip.settle(z0, near=0.1 * free)
    lowest, highest = -(1e7 + 1e3 * free), 3 * (z0 + tip.p[FA]) + 1000

    def end(outcome, **more):
        return {
            "outcome": outcome, "tip_offset": z0, "amplitude": tip.amplitude, "phase": tip.phase, "retracted": sign > 0,
            "jumps": jumps, "unsteady": unsteady, "periods": tip.periods, **more,
        }  # fmt: skip

    while True:
        if tip.periods > budget:
            return end("budget")
        saved, was, before = tip.state(), steady, tip.signal()
        coarse = step > 1.0001 * low
        if log is not None:
            log.append((z0, tip.amplitude / free, tip.phase, steady, step))
        near = (min(2 * step + 0.02 * free, 0.1 * free) if coarse else 3 * step) if was else None
        new = tip.settle(z0 + sign * step, near)
        moved = abs(tip.signal() - before)
        jump = moved > 4 * step + 0.01 * free
        crossed = (tip.amplitude - goal) * sign >= 0
        if (
            falling
            and older is not None
            and tip.amplitude > abs(before)
            and abs(before) - goal < 0.02 * free
            and last > low
        ):
            # the dip that lies in this step or the last one may reach the setpoint
            z0, step, steady = older[0], max(last / 4, low), older[2]
            tip.restore(older[1])
            older, falling = None, False
            continue
        if (jump or (was and not new) or crossed) and coarse:
            tip.restore(saved)
            step = max(step / 4, low)
            continue
        older, last = (z0, saved, was), step
        z0 += sign * step
        steady, falling = new, sign < 0 and tip.amplitude < abs(before)
        unsteady += not new
        if jump:
            jumps.append([float(z0), float(abs(before)), tip.amplitude, bool(new)])
        if crossed:
            if not new:
                return end("unsteady")
            if moved <= 50 * low + 1e-4 * free:
                return hold(tip, goal, z0, step, before, sign, end)
            if sign > 0:
                return end("jumps across")
            sign, step = 1.0, high
            continue
        step = min(step * 1.6, high * max(1.0, 0.5 * abs(z0) / free))
        if not lowest < z0 < highest:
            return end("never reached")


def hold(tip, goal, z0, step, before, sign, end):
    """Regula falsi on the tip offset between the last two, then Newton on state and tip offset."""
    ends, side, new = [(z0 - sign * step, abs(before) - goal), (z0, tip.amplitude - goal)], 0, False
    for _ in range(60):
        (za, fa), (zb, fb) = ends
        at = (za * fb - zb * fa) / (fb - fa) if fb != fa else 0.5 * (za + zb)
        new = tip.settle(at, near=0.05 * tip.free)
        f = tip.amplitude - goal
        if not new or abs(f) < 1e-9 * goal or abs(za - zb) < 1e-13 * (tip.free + abs(at)):
            break
        if (f > 0) == (fb > 0):
            ends, side = [(za, 0.5 * fa if side == 1 else fa), (at, f)], 1
        else:
            ends, side = [(at, f), (zb, 0.5 * fb if side == -1 else fb)], -1
    if not new or abs(f) > 1e-5 * goal:
        return end("unsteady")
    return end("held", orbit=polish(tip.p, np.array([*tip.s, at]), goal))


def polish(p, u, goal):
    """The periodic orbit with this amplitude near u = (z, z', z0), by Newton's method; lengths in nm, or None."""
    r, jac, out = np.zeros(3), np.zeros((3, 3)), np.empty(5)
    for i in range(8):
        size = (1e-7, 3e-8)[i > 0] * (np.hypot(u[0], u[1]) + 1e-3 * goal)
        if not differentiate(p, u, size, 1e-12, jac) or not change(p, u, 1e-12, out, r):
            return None
        r[2] -= goal
        move = np.linalg.solve(jac, -r)
        if not np.max(np.abs(move)) < 0.05 * goal:
            return None
        u = u + move
        if np.max(np.abs(move)) < 1e-10 * goal:
            break
    s = u[:2].copy()
    period(p, u[2], s, 1e-12, out)
    # dA/dz0 after the transient
    slope = jac[2, 2] - jac[2, :2] @ np.linalg.solve(jac[:2, :2], jac[:2, 2])
    return {
        "tip_offset": float(u[2]), "phase": float(90 - np.degrees(np.arctan2(out[1], out[0]))),
        "amplitude": float(np.hypot(out[0], out[1])), "peak_indentation": float(out[2]), "contacts": int(out[3]),
        "floquet": float(np.max(np.abs(1 + np.linalg.eigvals(jac[:2, :2])))), "slope": float(slope),
        "last_step": float(np.max(np.abs(move))), "state": [float(u[0]), float(u[1])],
    }  # fmt: skip
