"""One step of the equation of motion: the 12-stage explicit Runge-Kutta method of order 8 behind DOP853.

E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, 2nd ed. (1993), section II.5. `row6` is
y + h times row 6 of the tableau applied to the slopes k, without the coefficients that are zero; `total` is the same
with the weights b: the end of the step. Newest slopes come last, because only they are waited for.

The equation, its variables and `touching` are explained in `march`. Everything is passed by value, as numbers and
tuples: an array here would cost two atomic reference counts a stage, more than the arithmetic. Where a lever has
several modes, the slopes of all stages are columns of a record on the stack.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from phasemap._kernels.columns import DAMPING, LONGRANGE
from phasemap._kernels.compilation import ANY_ORDER, kernel
from phasemap._kernels.law import contact_force, damping, longrange_force
from phasemap._kernels.records import column, record

if TYPE_CHECKING:
    from phasemap._kernels.law import Law
    from phasemap._kernels.orbits.time.modes import Modes

Numbers = tuple[float, ...]
OF_TIP = 3  # numbers of a step before those of the higher modes: x, v and the time passed
SLOPES = 15
Row = Any  # a tuple where formulas are typed for an array: all they do is index it


class Medium(NamedTuple):
    """What stays as it is over many steps."""

    omega: float
    alpha0: float
    compliance: float  # 1/k [m/N]
    drive: float  # u0 [m]
    z0: float  # [m]
    edge_force: float  # the long-range force at contact, over k [m]
    edge_slope: float  # its derivative there, over k
    bottom: float  # depth where x = 0 [m]: 0, in the neck that of release
    lever_rate: float  # density of steps by the lever's own motion, squared; 1 of one mode
    share: float  # acceleration of the tip by a force over k [1]; 1 of one mode


class Start(NamedTuple):
    """Where a step starts: depth or its root, velocity, and cosine and sine of the drive's phase."""

    x: float
    v: float
    cos: float
    sin: float


class End(NamedTuple):
    """Where a step ends, and integrals over it."""

    x: float
    v: float
    passed: float  # time tau
    cos: float  # of z cos(omega tau) [m]
    sin: float  # of z sin(omega tau) [m]
    mean_z: float  # of z [m]
    loss: float  # of 2 alpha_s v^2 [m2]
    virial: float  # of -F z/k, with the damping force [m2]
    air: float  # of v^2 [m2]; of several modes the sum of that, each times its `Modes.loss`


# fmt: off

@kernel(inline=True, fastmath=ANY_ORDER)
def row2(y: float, h: float, k1: float) -> float:
    return y + h * 0.05260015195876773 * k1


@kernel(inline=True, fastmath=ANY_ORDER)
def row3(y: float, h: float, k1: float, k2: float) -> float:
    return y + h * 0.0197250569845379 * k1 + h * 0.0591751709536137 * k2


@kernel(inline=True, fastmath=ANY_ORDER)
def row4(y: float, h: float, k1: float, k3: float) -> float:
    return y + h * 0.02958758547680685 * k1 + h * 0.08876275643042054 * k3


@kernel(inline=True, fastmath=ANY_ORDER)
def row5(y: float, h: float, k1: float, k3: float, k4: float) -> float:
    return y + h * 0.2413651341592667 * k1 - h * 0.8845494793282861 * k3 + h * 0.924834003261792 * k4


@kernel(inline=True, fastmath=ANY_ORDER)
def row6(y: float, h: float, k1: float, k4: float, k5: float) -> float:
    return y + h * 0.037037037037037035 * k1 + h * 0.17082860872947386 * k4 + h * 0.12546768756682242 * k5


@kernel(inline=True, fastmath=ANY_ORDER)
def row7(y: float, h: float, k1: float, k4: float, k5: float, k6: float) -> float:
    return (
        y + h * 0.037109375 * k1 + h * 0.17025221101954405 * k4 + h * 0.06021653898045596 * k5
        - h * 0.017578125 * k6
    )


@kernel(inline=True, fastmath=ANY_ORDER)
def row8(y: float, h: float, k1: float, k4: float, k5: float, k6: float, k7: float) -> float:
    return (
        y + h * 0.03709200011850479 * k1 + h * 0.17038392571223998 * k4 + h * 0.10726203044637328 * k5
        - h * 0.015319437748624402 * k6 + h * 0.008273789163814023 * k7
    )


@kernel(inline=True, fastmath=ANY_ORDER)
def row9(y: float, h: float, k1: float, k4: float, k5: float, k6: float, k7: float, k8: float) -> float:
    return (
        y + h * 0.6241109587160757 * k1 - h * 3.3608926294469414 * k4 - h * 0.868219346841726 * k5
        + h * 27.59209969944671 * k6 + h * 20.154067550477894 * k7 - h * 43.48988418106996 * k8
    )


@kernel(inline=True, fastmath=ANY_ORDER)
def row10(y: float, h: float, k1: float, k4: float, k5: float, k6: float, k7: float, k8: float, k9: float) -> float:
    return (
        y + h * 0.47766253643826434 * k1 - h * 2.4881146199716677 * k4 - h * 0.590290826836843 * k5
        + h * 21.230051448181193 * k6 + h * 15.279233632882423 * k7 - h * 33.28821096898486 * k8
        - h * 0.020331201708508627 * k9
    )


@kernel(inline=True, fastmath=ANY_ORDER)
def row11(
    y: float, h: float, k1: float, k4: float, k5: float, k6: float, k7: float, k8: float, k9: float, k10: float
) -> float:
    return (
        y - h * 0.9371424300859873 * k1 + h * 5.186372428844064 * k4 + h * 1.0914373489967295 * k5
        - h * 8.149787010746927 * k6 - h * 18.52006565999696 * k7 + h * 22.739487099350505 * k8
        + h * 2.4936055526796523 * k9 - h * 3.0467644718982196 * k10
    )


@kernel(inline=True, fastmath=ANY_ORDER)
def row12(
    y: float, h: float,
    k1: float, k4: float, k5: float, k6: float, k7: float, k8: float, k9: float, k10: float, k11: float,
) -> float:
    return (
        y + h * 2.273310147516538 * k1 - h * 10.53449546673725 * k4 - h * 2.0008720582248625 * k5
        - h * 17.9589318631188 * k6 + h * 27.94888452941996 * k7 - h * 2.8589982771350235 * k8
        - h * 8.87285693353063 * k9 + h * 12.360567175794303 * k10 + h * 0.6433927460157636 * k11
    )


@kernel(inline=True, fastmath=ANY_ORDER)
def total(
    y: float, h: float, k1: float, k6: float, k7: float, k8: float, k9: float, k10: float, k11: float, k12: float
) -> float:
    return (
        y + h * 0.054293734116568765 * k1 + h * 4.450312892752409 * k6 + h * 1.8915178993145003 * k7
        - h * 5.801203960010585 * k8 + h * 0.3111643669578199 * k9 - h * 0.1521609496625161 * k10
        + h * 0.20136540080403034 * k11 + h * 0.04471061572777259 * k12
    )
# fmt: on


@kernel(inline=True, fastmath=ANY_ORDER)
def turn(angle: float) -> tuple[float, float]:
    """Return cosine and sine of the small angle of one step by Taylor's series, to 1e-16 at 0.6 and 1e-12 at 1."""
    x = angle * angle
    even = 1 / 40320 + x * (-1 / 3628800 + x * (1 / 479001600 - x * (1 / 87178291200)))
    odd = 1 / 362880 + x * (-1 / 39916800 + x * (1 / 6227020800 - x * (1 / 1307674368000)))
    cosine = 1 + x * (-1 / 2 + x * (1 / 24 + x * (-1 / 720 + x * even)))
    sine = 1 + x * (-1 / 6 + x * (1 / 120 + x * (-1 / 5040 + x * odd)))
    return cosine, angle * sine


@kernel(inline=True, fastmath=ANY_ORDER)
def force_of_stage(law: Law, p: Row, fixed: Medium, touching: bool, x: float) -> tuple[float, float, float, float]:
    """Slope w of tau, depth, force over k, and its damping 2 alpha_s [1] at x."""
    force = drag = 0.0
    if touching:
        d = fixed.bottom + x * x
        w = 2 * x
        force = contact_force(law, d, p) * fixed.compliance
        if p[DAMPING] != 0.0 and fixed.bottom == 0.0:
            drag = 2 * damping(law, d, p)
    else:
        d = x
        w = 1.0
        if p[LONGRANGE] != 0.0:
            # Stages of the step that ends at contact stray past d = 0, where the law does not hold: its tangent there
            # is off by the square of a distance that is itself O(h^5), so order 8 stands.
            force = (
                longrange_force(law, d, p) * fixed.compliance if d <= 0.0 else fixed.edge_force + fixed.edge_slope * d
            )
    return w, d, force, drag


@kernel(inline=True, fastmath=ANY_ORDER)
def stage(law: Law, p: Row, fixed: Medium, touching: bool, start: Start, x: float, v: float, time: float) -> Numbers:
    """Slopes w of tau and w z'' of v, and the integrands that `End` names, at (x, v), `time` after the step's start."""
    c, s = turn(fixed.omega * time)
    c, s = start.cos * c - start.sin * s, start.sin * c + start.cos * s
    w, d, force, drag = force_of_stage(law, p, fixed, touching, x)
    z = fixed.z0 + d
    a = fixed.drive * c - z - force - (2 * fixed.alpha0 + drag) * v
    return w, w * a, w * z * c, w * z * s, w * z, w * drag * v * v, -w * (force + drag * v) * z, w * v * v


@kernel(inline=True, fastmath=ANY_ORDER)
def _step(law: Law, p: Row, fixed: Medium, touching: bool, start: Start, h: float) -> End:
    x1, v1 = start.x, start.v
    w1, a1, c1, s1, m1, e1, f1, o1 = stage(law, p, fixed, touching, start, x1, v1, 0.0)
    x2 = row2(x1, h, v1)
    v2 = row2(v1, h, a1)
    t2 = row2(0.0, h, w1)
    w2, a2 = stage(law, p, fixed, touching, start, x2, v2, t2)[:2]
    x3 = row3(x1, h, v1, v2)
    v3 = row3(v1, h, a1, a2)
    t3 = row3(0.0, h, w1, w2)
    w3, a3 = stage(law, p, fixed, touching, start, x3, v3, t3)[:2]
    x4 = row4(x1, h, v1, v3)
    v4 = row4(v1, h, a1, a3)
    t4 = row4(0.0, h, w1, w3)
    w4, a4 = stage(law, p, fixed, touching, start, x4, v4, t4)[:2]
    x5 = row5(x1, h, v1, v3, v4)
    v5 = row5(v1, h, a1, a3, a4)
    t5 = row5(0.0, h, w1, w3, w4)
    w5, a5 = stage(law, p, fixed, touching, start, x5, v5, t5)[:2]
    x6 = row6(x1, h, v1, v4, v5)
    v6 = row6(v1, h, a1, a4, a5)
    t6 = row6(0.0, h, w1, w4, w5)
    w6, a6, c6, s6, m6, e6, f6, o6 = stage(law, p, fixed, touching, start, x6, v6, t6)
    x7 = row7(x1, h, v1, v4, v5, v6)
    v7 = row7(v1, h, a1, a4, a5, a6)
    t7 = row7(0.0, h, w1, w4, w5, w6)
    w7, a7, c7, s7, m7, e7, f7, o7 = stage(law, p, fixed, touching, start, x7, v7, t7)
    x8 = row8(x1, h, v1, v4, v5, v6, v7)
    v8 = row8(v1, h, a1, a4, a5, a6, a7)
    t8 = row8(0.0, h, w1, w4, w5, w6, w7)
    w8, a8, c8, s8, m8, e8, f8, o8 = stage(law, p, fixed, touching, start, x8, v8, t8)
    x9 = row9(x1, h, v1, v4, v5, v6, v7, v8)
    v9 = row9(v1, h, a1, a4, a5, a6, a7, a8)
    t9 = row9(0.0, h, w1, w4, w5, w6, w7, w8)
    w9, a9, c9, s9, m9, e9, f9, o9 = stage(law, p, fixed, touching, start, x9, v9, t9)
    x10 = row10(x1, h, v1, v4, v5, v6, v7, v8, v9)
    v10 = row10(v1, h, a1, a4, a5, a6, a7, a8, a9)
    t10 = row10(0.0, h, w1, w4, w5, w6, w7, w8, w9)
    w10, a10, c10, s10, m10, e10, f10, o10 = stage(law, p, fixed, touching, start, x10, v10, t10)
    x11 = row11(x1, h, v1, v4, v5, v6, v7, v8, v9, v10)
    v11 = row11(v1, h, a1, a4, a5, a6, a7, a8, a9, a10)
    t11 = row11(0.0, h, w1, w4, w5, w6, w7, w8, w9, w10)
    w11, a11, c11, s11, m11, e11, f11, o11 = stage(law, p, fixed, touching, start, x11, v11, t11)
    x12 = row12(x1, h, v1, v4, v5, v6, v7, v8, v9, v10, v11)
    v12 = row12(v1, h, a1, a4, a5, a6, a7, a8, a9, a10, a11)
    t12 = row12(0.0, h, w1, w4, w5, w6, w7, w8, w9, w10, w11)
    w12, a12, c12, s12, m12, e12, f12, o12 = stage(law, p, fixed, touching, start, x12, v12, t12)
    return End(
        total(x1, h, v1, v6, v7, v8, v9, v10, v11, v12),
        total(v1, h, a1, a6, a7, a8, a9, a10, a11, a12),
        total(0.0, h, w1, w6, w7, w8, w9, w10, w11, w12),
        total(0.0, h, c1, c6, c7, c8, c9, c10, c11, c12),
        total(0.0, h, s1, s6, s7, s8, s9, s10, s11, s12),
        total(0.0, h, m1, m6, m7, m8, m9, m10, m11, m12),
        total(0.0, h, e1, e6, e7, e8, e9, e10, e11, e12),
        total(0.0, h, f1, f6, f7, f8, f9, f10, f11, f12),
        total(0.0, h, o1, o6, o7, o8, o9, o10, o11, o12),
    )


@kernel
def step_off_surface(law: Law, p: Row, fixed: Medium, start: Start, h: float) -> End:
    """Take one step of length h [s] out of contact."""
    return _step(law, p, fixed, False, start, h)


@kernel
def step_in_contact(law: Law, p: Row, fixed: Medium, start: Start, h: float) -> End:
    """Take one step in contact or in the neck: as `step_off_surface`."""
    return _step(law, p, fixed, True, start, h)


class Beam(NamedTuple):
    """A lever of several modes over a material, during a step."""

    law: Law
    p: Row
    fixed: Medium
    modes: Modes
    touching: bool


@record
class Stages:
    """Numbers of a step of a lever with several modes: at its start, in a stage, and the slopes of all stages.

    They are x, v and the time passed, displacement and velocity of each higher mode, and the integrals of `End`.
    """

    start: np.ndarray = column(SLOPES)
    now: np.ndarray = column(SLOPES)
    k1: np.ndarray = column(SLOPES)
    k2: np.ndarray = column(SLOPES)
    k3: np.ndarray = column(SLOPES)
    k4: np.ndarray = column(SLOPES)
    k5: np.ndarray = column(SLOPES)
    k6: np.ndarray = column(SLOPES)
    k7: np.ndarray = column(SLOPES)
    k8: np.ndarray = column(SLOPES)
    k9: np.ndarray = column(SLOPES)
    k10: np.ndarray = column(SLOPES)
    k11: np.ndarray = column(SLOPES)
    k12: np.ndarray = column(SLOPES)


@kernel(inline=True, fastmath=ANY_ORDER)
def _fill_slopes(here: Beam, start: Start, y: np.ndarray, k: np.ndarray, integrals: bool) -> None:
    """Fill in the slopes `k` of the numbers `y` of a step, those of the integrals if they are wanted."""
    fixed, modes, v = here.fixed, here.modes, y[1]
    c, s = turn(fixed.omega * y[2])
    c, s = start.cos * c - start.sin * s, start.sin * c + start.cos * s
    w, d, force, drag = force_of_stage(here.law, here.p, fixed, here.touching, y[0])
    z, push = fixed.z0 + d, force + drag * v
    first, first_speed, a, air = z, v, 0.0, 0.0
    for i in range(1, modes.count):
        own, speed = y[OF_TIP + 2 * i - 2], y[OF_TIP + 2 * i - 1]
        rise = modes.drive_re[i] * c - modes.drive_im[i] * s - modes.shares[i] * push
        rise -= modes.square[i] * own + modes.damping[i] * speed
        k[OF_TIP + 2 * i - 2], k[OF_TIP + 2 * i - 1] = w * speed, w * rise
        a += rise
        air += modes.loss[i] * speed * speed
        first -= own
        first_speed -= speed
    a += modes.drive_re[0] * c - modes.drive_im[0] * s - modes.shares[0] * push
    a -= modes.square[0] * first + modes.damping[0] * first_speed
    k[0], k[1], k[2] = v, w * a, w
    if integrals:
        k[9], k[10], k[11] = w * z * c, w * z * s, w * z
        k[12], k[13] = w * drag * v * v, -w * push * z
        k[14] = w * (air + modes.loss[0] * first_speed * first_speed)


@kernel(shared=True, vectors=True, fastmath=ANY_ORDER)
def step_of_modes(here: Beam, start: Start, h: float) -> End:
    """Take one step of a lever with several modes, from modes.now to modes.end; else as `step_in_contact`."""
    m = Stages()
    y, now, k1, k2, k3, k4, k5, k6 = m.start, m.now, m.k1, m.k2, m.k3, m.k4, m.k5, m.k6
    k7, k8, k9, k10, k11, k12 = m.k7, m.k8, m.k9, m.k10, m.k11, m.k12
    y[0], y[1] = start.x, start.v
    count, higher = OF_TIP + 2 * here.modes.count - 2, here.modes.now
    for j in range(OF_TIP, count):
        y[j] = higher[j - OF_TIP]
    _fill_slopes(here, start, y, k1, True)
    for j in range(count):
        now[j] = row2(y[j], h, k1[j])
    _fill_slopes(here, start, now, k2, False)
    for j in range(count):
        now[j] = row3(y[j], h, k1[j], k2[j])
    _fill_slopes(here, start, now, k3, False)
    for j in range(count):
        now[j] = row4(y[j], h, k1[j], k3[j])
    _fill_slopes(here, start, now, k4, False)
    for j in range(count):
        now[j] = row5(y[j], h, k1[j], k3[j], k4[j])
    _fill_slopes(here, start, now, k5, False)
    for j in range(count):
        now[j] = row6(y[j], h, k1[j], k4[j], k5[j])
    _fill_slopes(here, start, now, k6, True)
    for j in range(count):
        now[j] = row7(y[j], h, k1[j], k4[j], k5[j], k6[j])
    _fill_slopes(here, start, now, k7, True)
    for j in range(count):
        now[j] = row8(y[j], h, k1[j], k4[j], k5[j], k6[j], k7[j])
    _fill_slopes(here, start, now, k8, True)
    for j in range(count):
        now[j] = row9(y[j], h, k1[j], k4[j], k5[j], k6[j], k7[j], k8[j])
    _fill_slopes(here, start, now, k9, True)
    for j in range(count):
        now[j] = row10(y[j], h, k1[j], k4[j], k5[j], k6[j], k7[j], k8[j], k9[j])
    _fill_slopes(here, start, now, k10, True)
    for j in range(count):
        now[j] = row11(y[j], h, k1[j], k4[j], k5[j], k6[j], k7[j], k8[j], k9[j], k10[j])
    _fill_slopes(here, start, now, k11, True)
    for j in range(count):
        now[j] = row12(y[j], h, k1[j], k4[j], k5[j], k6[j], k7[j], k8[j], k9[j], k10[j], k11[j])
    _fill_slopes(here, start, now, k12, True)
    for j in range(SLOPES):
        now[j] = total(y[j], h, k1[j], k6[j], k7[j], k8[j], k9[j], k10[j], k11[j], k12[j])
    for j in range(OF_TIP, count):
        here.modes.end[j - OF_TIP] = now[j]
    return End(now[0], now[1], now[2], now[9], now[10], now[11], now[12], now[13], now[14])
