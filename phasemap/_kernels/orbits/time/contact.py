"""Interface between the march and a contact, which is a plug-in, and the numbers that a step moves.

A kind of contact is a file of its own, with a named tuple that has the fields law, p, compliance, pull, edge_force and
edge_slope, as `Elastic` has them, and now, a record whose mode says what the contact does; with a kernel for each
function here that is `Chosen`; and with the period that `march.march_oscillator` asks for. `elastic` has
surfaces that remember nothing, with a neck or without (`neck`); `relaxing` those that relax. Wherever the mode is
OFF_SURFACE, x is the depth, and elsewhere its root; what happens where, and what comes then, the kind alone knows.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.chosen import Chosen
from phasemap._kernels.compilation import ANY_ORDER, kernel
from phasemap._kernels.law import Law, has_longrange, longrange_force, longrange_slope
from phasemap._kernels.orbits.time.tip import PeriodResult
from phasemap._kernels.records import column, record

if TYPE_CHECKING:
    from phasemap._kernels.orbits.time.modes import Modes

Row = Any  # parameters of a material: a tuple where formulas are typed for an array, for all they do is index it
OFF_SURFACE = 0  # what a contact does: nothing; each kind has more
# What happens at the end of a step.
NO_EVENT = 0
FIRST_TOUCH = 1  # the tip comes to the surface
LAST_TOUCH = 2  # and is off it
NECK_CLOSES = 3  # d = 0 on the way in
NECK_BREAKS = 4
CONTACT_TURN = 5  # the edge of a contact that relaxes stands still
OLD_TURN = 6  # it passes where an earlier contact turned
PLACE_OF_X = 2 * col.MOST_ARMS  # in `Moved`
PERIOD_ENDS = -1  # in contact, where time is no variable of a step
TURNED = -2  # the tip is deepest


@record
class Moved:
    """Numbers that a step moves, and integrals over it; or the derivatives of all these by s."""

    # Of each arm of a contact that relaxes, the last one first: depth to which its dashpots have crept [m], and the
    # integral of what elements remember over the contact [m^(3/2)].
    arms: np.ndarray = column(PLACE_OF_X)
    x: float  # depth [m], in contact the root of that above where x = 0 [m^(1/2)]
    v: float  # z' [m]
    passed: float  # time since the step began [1/omega_c]
    modes: np.ndarray = column(2 * col.MOST_MODES - 2)  # displacement and velocity of each mode above the first [m]
    cos: float  # integral of z cos(omega tau) [m]
    sin: float  # of z sin(omega tau) [m]
    mean_z: float  # of z [m]
    loss: float  # of the energy into the surface, over stiffness [m2]
    virial: float  # of -F z/k, with the damping force [m2]
    # of v^2 [m2]; of several modes the sum of that, each times its `Modes.loss`, less what a second drive gives
    air: float
    second_cos: float  # of the second mode's displacement, with the phase of a second drive [m]
    second_sin: float


@record
class MotionPoint:
    """A point of the motion, and the slopes there."""

    at: Moved
    slope: Moved
    known: int  # 1 where the slopes are


@record
class Motion:
    """The march through a period: where it is, and what it has added up."""

    here: MotionPoint
    end: MotionPoint  # of the step
    trial: MotionPoint
    h: float  # length of the step, of the variable s
    time: float  # since the period began [1/omega_c]
    time_left: float  # of the period
    cos: float  # of the drive's phase
    sin: float
    event: int  # at the end of the step
    sums: PeriodResult  # over the period, before they are made means


class DrivenLever(NamedTuple):
    """The lever under its drive, over a tip offset."""

    omega: float
    alpha0: float
    drive: float  # u0 [m]
    z0: float  # [m]
    rate: float  # density of steps by its own motion, squared; 1 of one mode
    share: float  # acceleration of the tip by a force over k [1]; 1 of one mode
    modes: Modes


class Here(NamedTuple):
    """The moving system: the lever, and a contact of any kind."""

    contact: Any
    beam: DrivenLever


class Push(NamedTuple):
    """Force of a contact on the tip, with the depth, the drag, and the slope of time."""

    w: float  # slope of time
    depth: float  # of the tip [m]
    force: float  # over k [m]
    drag: float  # 2 alpha_s [1]


@Chosen
def push_of(contact: Any, off: bool, time: float, y: Moved) -> Push:
    """Force of the contact in a step that began at a time, `off` the surface or not; a kind may add more numbers."""
    raise NotImplementedError


@Chosen
def first_moved(contact: Any) -> int:
    """Index in `Moved` of the first number that a step in contact moves: x, or before it those of the contact's own."""
    raise NotImplementedError


@Chosen
def fill_own_slopes(contact: Any, off: bool, push: Any, y: Moved, a: float, k: Moved) -> float:
    """Fill into `k` the derivatives by s of x, and of what the contact has of its own, where the state is `y`.

    `a`: acceleration z'' of the tip [m]. Returns the rate of the energy into the surface over stiffness, without that
    of `Push.drag`.
    """
    raise NotImplementedError


@Chosen
def step_length(contact: Any, beam: DrivenLever, step_size: float, motion: Motion) -> float:
    """Length of the next step."""
    raise NotImplementedError


@Chosen
def edge_of(contact: Any, event: int, time: float) -> tuple[float, float]:
    """Value of x at which an event that x decides happens, and its rate off the surface."""
    raise NotImplementedError


@Chosen
def stop_at_event(contact: Any, here: Here, motion: Motion) -> None:
    """End a step at the first event in it, if any, by `equation_of_motion.end_step_at_event`: in ``motion.event``."""
    raise NotImplementedError


@Chosen
def pass_event(contact: Any, here: Here, motion: Motion) -> bool:
    """Let the contact go on from the end of a step, where something may happen; False if it cannot."""
    raise NotImplementedError


@kernel
def attraction_at_contact(law: Law, p: Row, compliance: float) -> tuple[float, float]:
    """The long-range force at d = 0, over k [m], and its slope: ``edge_force`` and ``edge_slope`` of any contact."""
    if not has_longrange(p):
        return 0.0, 0.0
    return longrange_force(law, 0.0, p) * compliance, longrange_slope(law, 0.0, p) * compliance


@kernel(inline=True, fastmath=ANY_ORDER)
def attraction_at(contact: Any, d: float) -> float:
    """The long-range force over k [m].

    Stages of the step that ends at contact stray past d = 0, where the law does not hold: its tangent there is off by
    the square of a distance that is itself O(h^5), so order 8 stands.
    """
    if not has_longrange(contact.p):
        return 0.0
    if d <= 0.0:
        return longrange_force(contact.law, d, contact.p) * contact.compliance
    return contact.edge_force + contact.edge_slope * d
