"""Step of the equation of motion: the 12-stage explicit Runge-Kutta method of order 8 behind DOP853.

E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, 2nd ed. (1993), section II.5.

The equation and its variables are explained in `equation_of_motion`; what the surface does is a plug-in, `contact`.
Loops over the numbers of a lever with one mode have a length that LLVM knows: they are written out, and nothing is kept
in memory.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import ANY_ORDER, COMPILES, kernel
from phasemap._kernels.compilation.of_numba import intrinsic, ir, types
from phasemap._kernels.orbits.time.contact import (
    OFF_SURFACE,
    PLACE_OF_X,
    Here,
    Motion,
    MotionPoint,
    Moved,
    fill_own_slopes,
    first_moved,
    push_of,
)
from phasemap._kernels.records import numbers_of, record

ONE_MODE = PLACE_OF_X + 3  # numbers that a step moves, with one mode; each other one has two more
INTEGRALS = ONE_MODE + 2 * col.MOST_MODES - 2  # where those begin that a step adds up
ONE_DRIVE = INTEGRALS + 6  # where those begin that a second drive has

Numbers = tuple[float, ...]


class StepStart(NamedTuple):
    """Start of a step: time since the period began [1/omega_c], and cosine and sine of the drive's phase."""

    time: float
    cos: float
    sin: float


@record
class Stages:
    """Numbers of a stage, and the slopes in all of them."""

    now: Moved
    k1: Moved
    k2: Moved
    k3: Moved
    k4: Moved
    k5: Moved
    k6: Moved
    k7: Moved
    k8: Moved
    k9: Moved
    k10: Moved
    k11: Moved
    k12: Moved


# fmt: off
TABLEAU: tuple[dict[int, float], ...] = (  # of each stage after the first, and the end: weights of slopes
    {1: 0.05260015195876773},
    {1: 0.0197250569845379, 2: 0.0591751709536137},
    {1: 0.02958758547680685, 3: 0.08876275643042054},
    {1: 0.2413651341592667, 3: -0.8845494793282861, 4: 0.924834003261792},
    {1: 0.037037037037037035, 4: 0.17082860872947386, 5: 0.12546768756682242},
    {1: 0.037109375, 4: 0.17025221101954405, 5: 0.06021653898045596, 6: -0.017578125},
    {1: 0.03709200011850479, 4: 0.17038392571223998, 5: 0.10726203044637328, 6: -0.015319437748624402,
     7: 0.008273789163814023},
    {1: 0.6241109587160757, 4: -3.3608926294469414, 5: -0.868219346841726, 6: 27.59209969944671,
     7: 20.154067550477894, 8: -43.48988418106996},
    {1: 0.47766253643826434, 4: -2.4881146199716677, 5: -0.590290826836843, 6: 21.230051448181193,
     7: 15.279233632882423, 8: -33.28821096898486, 9: -0.020331201708508627},
    {1: -0.9371424300859873, 4: 5.186372428844064, 5: 1.0914373489967295, 6: -8.149787010746927,
     7: -18.52006565999696, 8: 22.739487099350505, 9: 2.4936055526796523, 10: -3.0467644718982196},
    {1: 2.273310147516538, 4: -10.53449546673725, 5: -2.0008720582248625, 6: -17.9589318631188,
     7: 27.94888452941996, 8: -2.8589982771350235, 9: -8.87285693353063, 10: 12.360567175794303,
     11: 0.6433927460157636},
    {1: 0.054293734116568765, 6: 4.450312892752409, 7: 1.8915178993145003, 8: -5.801203960010585,
     9: 0.3111643669578199, 10: -0.1521609496625161, 11: 0.20136540080403034, 12: 0.04471061572777259},
)
# fmt: on


@intrinsic
def along_tableau(_context: Any, y: Any, h: Any, slopes: Any) -> Any:
    """y + h times the weighted slopes of a stage of the tableau, summed so that only the newest slope is waited for."""
    row, number, flags = TABLEAU[len(slopes) - 1], types.float64, sorted(ANY_ORDER)

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        total, step, before = arguments
        for stage, weight in row.items():
            share = builder.fmul(step, ir.Constant(ir.DoubleType(), weight), flags=flags)
            slope = builder.extract_value(before, stage - 1)
            total = builder.fadd(total, builder.fmul(share, slope, flags=flags), flags=flags)
        return total

    return number(number, number, slopes), generate


def _along(y: float, h: float, slopes: tuple[float, ...]) -> float:
    """`along_tableau` in Python, where numba's compiler is off."""
    return y + sum(h * weight * slopes[stage - 1] for stage, weight in TABLEAU[len(slopes) - 1].items())


if not COMPILES:
    along_tableau = _along


@kernel(inline=True, fastmath=ANY_ORDER)
def cosine_and_sine(angle: float) -> tuple[float, float]:
    """Return cosine and sine of the small angle of one step by Taylor's series, to 1e-16 at 0.6 and 1e-12 at 1."""
    x = angle * angle
    even = 1 / 40320 + x * (-1 / 3628800 + x * (1 / 479001600 - x * (1 / 87178291200)))
    odd = 1 / 362880 + x * (-1 / 39916800 + x * (1 / 6227020800 - x * (1 / 1307674368000)))
    cosine = 1 + x * (-1 / 2 + x * (1 / 24 + x * (-1 / 720 + x * even)))
    sine = 1 + x * (-1 / 6 + x * (1 / 120 + x * (-1 / 5040 + x * odd)))
    return cosine, angle * sine


@kernel(inline=True, fastmath=ANY_ORDER)
def _fill_slopes(here: Here, start: StepStart, off: bool, many: bool, y: Moved, k: Moved, integrals: bool) -> None:
    """Fill in the slopes of the numbers moved, `many` of several modes or of arms, and of the integrals if wanted."""
    beam, modes, v = here.beam, here.beam.modes, y.v
    c, s = cosine_and_sine(beam.omega * y.passed)
    c, s = start.cos * c - start.sin * s, start.sin * c + start.cos * s
    push = push_of(here.contact, off, start.time, y)
    w, z, whole = push.w, beam.z0 + push.depth, push.force + push.drag * v
    if not many or modes.count == 1:
        a = beam.drive * c - z - push.force - (2 * beam.alpha0 + push.drag) * v
        air = v * v
    else:
        first, first_speed, a, air, pull = z, v, 0.0, 0.0, whole
        if modes.second > 0.0:
            angle = modes.second_phase + modes.second_omega * (start.time + y.passed)
            c2, s2 = math.cos(angle), math.sin(angle)
            pull -= modes.second * c2
            air -= 0.5 / beam.alpha0 * modes.second * c2 * v
            k.second_cos, k.second_sin = w * y.modes[0] * c2, w * y.modes[0] * s2
        for i in range(1, modes.count):
            displaced, speed = y.modes[2 * i - 2], y.modes[2 * i - 1]
            rise = modes.drive_re[i] * c - modes.drive_im[i] * s - modes.shares[i] * pull
            rise -= modes.square[i] * displaced + modes.damping[i] * speed
            k.modes[2 * i - 2], k.modes[2 * i - 1] = w * speed, w * rise
            a += rise
            air += modes.loss[i] * speed * speed
            first -= displaced
            first_speed -= speed
        a += modes.drive_re[0] * c - modes.drive_im[0] * s - modes.shares[0] * pull
        a -= modes.square[0] * first + modes.damping[0] * first_speed
        air += modes.loss[0] * first_speed * first_speed
    k.v, k.passed = w * a, w
    taken = fill_own_slopes(here.contact, off, push, y, a, k)
    if integrals:
        k.cos, k.sin, k.mean_z = w * z * c, w * z * s, w * z
        k.loss, k.virial, k.air = taken + w * push.drag * v * v, -w * whole * z, w * air


@kernel(inline=True, fastmath=ANY_ORDER)
def _step(here: Here, start: StepStart, off: bool, many: bool, point: MotionPoint, h: float, end: Moved) -> None:
    """Take a step of length h of Dormand and Prince's method of order 8, from `point` to `end`.

    `off`: whether the tip is off the surface. `many`: whether the lever has several modes, or the contact arms.
    """
    m, first = Stages(), PLACE_OF_X if off else first_moved(here.contact)
    count = ONE_MODE + 2 * here.beam.modes.count - 2 if many else ONE_MODE
    slope = point.slope if first < PLACE_OF_X else m.k1  # kept where it is wanted: memory would cost 3 % of a step
    if first == PLACE_OF_X or point.known == 0:
        point.at.passed, point.known = 0.0, 1
        _fill_slopes(here, start, off, many, point.at, slope, True)
    y, out, k1, now = numbers_of(point.at), numbers_of(end), numbers_of(slope), numbers_of(m.now)
    k2, k3, k4, k5 = numbers_of(m.k2), numbers_of(m.k3), numbers_of(m.k4), numbers_of(m.k5)
    k6, k7, k8, k9 = numbers_of(m.k6), numbers_of(m.k7), numbers_of(m.k8), numbers_of(m.k9)
    k10, k11, k12 = numbers_of(m.k10), numbers_of(m.k11), numbers_of(m.k12)
    for j in range(first, count):
        now[j] = along_tableau(y[j], h, (k1[j],))
    _fill_slopes(here, start, off, many, m.now, m.k2, False)
    for j in range(first, count):
        now[j] = along_tableau(y[j], h, (k1[j], k2[j]))
    _fill_slopes(here, start, off, many, m.now, m.k3, False)
    for j in range(first, count):
        now[j] = along_tableau(y[j], h, (k1[j], k2[j], k3[j]))
    _fill_slopes(here, start, off, many, m.now, m.k4, False)
    for j in range(first, count):
        now[j] = along_tableau(y[j], h, (k1[j], k2[j], k3[j], k4[j]))
    _fill_slopes(here, start, off, many, m.now, m.k5, False)
    for j in range(first, count):
        now[j] = along_tableau(y[j], h, (k1[j], k2[j], k3[j], k4[j], k5[j]))
    _fill_slopes(here, start, off, many, m.now, m.k6, True)
    for j in range(first, count):
        now[j] = along_tableau(y[j], h, (k1[j], k2[j], k3[j], k4[j], k5[j], k6[j]))
    _fill_slopes(here, start, off, many, m.now, m.k7, True)
    for j in range(first, count):
        now[j] = along_tableau(y[j], h, (k1[j], k2[j], k3[j], k4[j], k5[j], k6[j], k7[j]))
    _fill_slopes(here, start, off, many, m.now, m.k8, True)
    for j in range(first, count):
        now[j] = along_tableau(y[j], h, (k1[j], k2[j], k3[j], k4[j], k5[j], k6[j], k7[j], k8[j]))
    _fill_slopes(here, start, off, many, m.now, m.k9, True)
    for j in range(first, count):
        now[j] = along_tableau(y[j], h, (k1[j], k2[j], k3[j], k4[j], k5[j], k6[j], k7[j], k8[j], k9[j]))
    _fill_slopes(here, start, off, many, m.now, m.k10, True)
    for j in range(first, count):
        now[j] = along_tableau(y[j], h, (k1[j], k2[j], k3[j], k4[j], k5[j], k6[j], k7[j], k8[j], k9[j], k10[j]))
    _fill_slopes(here, start, off, many, m.now, m.k11, True)
    for j in range(first, count):
        now[j] = along_tableau(y[j], h, (k1[j], k2[j], k3[j], k4[j], k5[j], k6[j], k7[j], k8[j], k9[j], k10[j], k11[j]))
    _fill_slopes(here, start, off, many, m.now, m.k12, True)
    for j in range(first, count):
        out[j] = along_tableau(
            y[j], h, (k1[j], k2[j], k3[j], k4[j], k5[j], k6[j], k7[j], k8[j], k9[j], k10[j], k11[j], k12[j])
        )
    for j in range(INTEGRALS, len(out) if many else ONE_DRIVE):
        out[j] = along_tableau(
            0.0, h, (k1[j], k2[j], k3[j], k4[j], k5[j], k6[j], k7[j], k8[j], k9[j], k10[j], k11[j], k12[j])
        )


@kernel
def _step_off_surface(here: Here, start: StepStart, point: MotionPoint, h: float, end: Moved) -> None:
    """Take a step of a lever of one mode off the surface."""
    _step(here, start, True, False, point, h, end)


@kernel
def _step_in_contact(here: Here, start: StepStart, point: MotionPoint, h: float, end: Moved) -> None:
    """Take a step of a lever of one mode in contact with a surface that remembers nothing."""
    _step(here, start, False, False, point, h, end)


@kernel(fastmath=ANY_ORDER)
def _step_of_many(here: Here, start: StepStart, point: MotionPoint, h: float, end: Moved) -> None:
    """Take a step of a lever of several modes, or in contact with a surface that relaxes."""
    _step(here, start, here.contact.now.mode == OFF_SURFACE, True, point, h, end)


@kernel(inline=True)
def _moves_more_than_tip(here: Here) -> bool:
    """True if the lever has several modes, or the tip is in a contact with arms."""
    if here.beam.modes.count > 1:
        return True
    # Of what moves, arms come before the tip's x.
    return here.contact.now.mode != OFF_SURFACE and first_moved(here.contact) < PLACE_OF_X


@kernel(inline=True)
def take_step(here: Here, motion: Motion, h: float, to: MotionPoint) -> None:
    """Take a step of length h from where the motion is."""
    start = StepStart(motion.time, motion.cos, motion.sin)
    to.known = 0
    if _moves_more_than_tip(here):
        _step_of_many(here, start, motion.here, h, to.at)
    elif here.contact.now.mode == OFF_SURFACE:
        _step_off_surface(here, start, motion.here, h, to.at)
    else:
        _step_in_contact(here, start, motion.here, h, to.at)


@kernel
def find_slopes(here: Here, motion: Motion, point: MotionPoint) -> None:
    """Fill in the slopes at a point of the step that starts where the motion is."""
    start, off = StepStart(motion.time, motion.cos, motion.sin), here.contact.now.mode == OFF_SURFACE
    if _moves_more_than_tip(here):
        _fill_slopes(here, start, off, True, point.at, point.slope, True)
    elif off:
        _fill_slopes(here, start, True, False, point.at, point.slope, True)
    else:
        _fill_slopes(here, start, False, False, point.at, point.slope, True)
    point.known = 1
