"""Numbering of what kernels take and give: columns of float64 arrays, and status codes."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    import numpy as np

# Columns of a parameter row, shape (ROW,). Contact laws use 0-3, long-range laws 4-7, damping laws 8-11, necks of
# liquid 12-15, films on a rigid base 14 and 15.
CONTACT = 0
LONGRANGE = 4
DAMPING = 8
ROW = 16
INVERSE_REACH = 5  # 1 over the length [m] on which the long-range force, at d = 0 of p[LONGRANGE] [N], changes there
EXPONENT = 9  # n of the built-in damping law, whose alpha1/R^n [m^-n] stands at DAMPING
BIAS = 11  # attraction [N] in contact of a long-range force, as of a voltage; negative where that repels
PULL = 1  # attraction [N] in contact of DMT's law
RELAXATION = 2  # of a law that may remember: tau [1/omega_c] if above 0
RELAXING = 3  # of the same: 1 - E_inf/E_0 [1]
WITHDRAWN = 2  # of a law with losses: attraction [N] more on the way out of contact
LOSS_FALL = 6  # of the same: 1 / length [1/m] over which the loss outside contact falls
LOSS = 7  # of the same: alpha_s [1] of that loss at d = 0
SPECTRUM = 9  # of the same, which has no DAMPING: address of its times, see `orbits.time.arms`; 0 where there is one
RELEASE = 10  # depth [m] at which contact ends, 0 or below: a law with hysteresis draws out a neck
FORMING = 12  # depth [m] at which a neck forms on the way in, from RELEASE to 0: below 0 where films of liquid meet
BRIDGE = 13  # attraction [N] of a bridge of liquid on a tip in contact
BRIDGE_CURVE = 14  # 1 / sqrt(V / (pi R)) [1/m] of a bridge of constant volume V; 0 of any other
BRIDGE_FALL = 15  # 1 / length [1/m] of a bridge whose force falls as a line; 0 of any other
THINNESS = 14  # of a law that has no neck: sqrt(R)/h [m^-0.5] of a film on a rigid base; 0 of a half-space
FILM_SERIES = 15  # of the same: c1 [1], the first coefficient of its law

# Entries of the lever, shape (MODE + MODE_NUMBERS n,) for n modes; see `phasemap.experiment.lever.lever_of`. Motion is
# that of the tip, forces are over k, and the phase of the drive is that of the force it makes at the tip.
OMEGA = 0  # drive frequency over the first mode's resonance [1]
ALPHA0 = 1  # damping ratio of the first mode [1]
STIFFNESS = 2  # k of the first mode [N/m]
DRIVE = 3  # u0, amplitude of the drive's force at the tip over k [m]
DYNAMIC_STIFFNESS = 4  # real part of 1 / (k G(omega)), G the compliance at the tip [1]; 1 - omega^2 of one mode
DYNAMIC_LOSS = 5  # imaginary part of it [1]; 2 alpha0 omega of one mode
# What the detector sees of a tip that moves with A exp(i phase): A_s exp(i phase_s) = OFFSET + FACTOR A exp(i phase).
OFFSET_RE = 6  # [m]
OFFSET_IM = 7
FACTOR_RE = 8  # [1]
FACTOR_IM = 9
TURN_COS = 10  # cosine and sine of the angle by which the drive's force at the tip is ahead of the drive itself
TURN_SIN = 11
RIGID = 12  # amplitude [m] with which the tip moves in phase with the drive and not by a mode: of a driven base
MODES = 13  # number of modes
SECOND_FREE = 14  # free amplitude of a second mode that is driven too [m], at the tip; 0 where it is not
SECOND_HELD = 15  # 1 where a phase-locked loop and a gain hold its resonance and its amplitude
SECOND_FORCE = 16  # amplitude of the second drive's force at the tip over k [m], 0 but where the march has both drives
SECOND_OMEGA = 17  # its frequency [1]
SECOND_PHASE = 18  # its phase where a period of the first drive begins
MODE = 19  # where the first begins; of each, in units of the first mode's stiffness, frequency and time:
MODE_NUMBERS = 5
FREQUENCY = 0  # w_i, its resonance [1]
RATE = 1  # alpha_i = w_i / (2 Q_i), at which it rings down [1]
SHARE = 2  # w_i^2 k / k_i: its acceleration by a force over k [1]
PULLED = 3  # its acceleration by the drive [m]
SLOPE_SEEN = 4  # weight with which the detector sees it [1]
MOST_MODES = 4
MOST_ARMS = 12  # relaxation times of a material

# Columns of a result row, shape (COLUMNS,).
TIP_OFFSET = 0  # z0 [m]
MEAN = 1  # mean deflection [m], towards the sample
PHASE = 2  # [rad], 0 at free resonance, positive repulsive
AMPLITUDE = 3  # first harmonic [m]
INDENTATION = 4  # largest d [m], negative if the tip does not touch
DISSIPATION = 5  # into the surface [J per cycle]
VIRIAL = 6  # -<F z> [J], positive for attraction
FLOQUET = 7  # largest modulus of the two multipliers
SLOPE = 8  # dA/dz0 at fixed drive [1]; the feedback needs it positive
STIFFENING = 9  # <F cos>/(k A) * 2 = omega_e^2 - 1 [1]: negative attractive, positive repulsive
CLOSURE = 10  # energy in - energy out, over energy in [1]
ERROR_PHASE = 11  # estimated [rad]
ERROR_HEIGHT = 12  # estimated [m]
SPREAD_AMPLITUDE = 13  # of motion that is not periodic, as a lock-in shows it [m]; 0 or NaN for a periodic orbit
SPREAD_PHASE = 14  # the same of the phase [rad]
COLUMNS = 15

# Columns of a row of a scan in time: TIP_OFFSET, PHASE, AMPLITUDE and STIFFENING, averaged over a pixel, and
AMPLITUDE_ERROR = 5  # amplitude less setpoint [m]

# Columns of a full row, shape (FULL,): the above, and
MEAN_FORCE = 15  # of the surface on the tip [N], positive repulsive
PEAK_FORCE = 16  # largest [N]
LEAST_FORCE = 17  # smallest [N]
CONTACT_TIME = 18  # in contact, necks included, over the period [1]
HARMONIC = 19  # amplitudes of the harmonics 2 ... 6 of the deflection [m]
HARMONICS = 5
TRACE = 24  # of the monodromy matrix [1]
PRODUCT = 25  # of the two multipliers [1]
START_Z = 26  # z [m] at drive phase 0
START_V = 27  # dz/dtau [m] there
START_HELD = 28  # whether in contact or neck there
PARAMETER = 29  # m [1]
KIND = 30  # what made the row: one of those below
INDEX = 31  # of the value asked for
SEEN = 32  # amplitude that the detector sees [m]
FULL = 33
ON_THE_WAY, WANTED, FOLD, END, TURN = 0, 1, 2, 3, 4  # FOLD: the control turns; TURN: the value wanted does

# Columns of a wide row, shape (WIDE,): a full row, and integrals over its orbit.
ADHESION_VIRIAL = FULL  # -<F_att A cos> [J], F_att the force less that of the same contact without adhesion or bias
ADHESION_LOSS = FULL + 1  # what F_att takes in a cycle [J]: the energy of necks
STORAGE = FULL + 2  # <F' (dd/dtheta)^2> [J], F' the slope of the same contact without adhesion or bias
GRADIENT = FULL + 3  # <dF/dd> [N/m]
DRAG = FULL + 4  # <2 alpha_s> [1]
SIDEBANDS = FULL + 5  # what the second mode finds softer, for all yield at sidebands: real, imaginary [N/m]
WAVES = FULL + 7  # harmonics 2 ... 6 as the detector sees them, Re(Z_n exp(i n theta)): Z_n, real, imaginary [m]
LOSSES = WAVES + 2 * HARMONICS  # what the damping of each mode takes in a period [J]
WIDE = LOSSES + MOST_MODES
NOT_DRIVEN = 0  # a second mode,
AT_REST = 1  # or at its free resonance,
IN_LOOP = 2  # or where a loop finds that
LOSS_HARMONICS = 80  # of the force, by which modes lose energy: the rest is below 1e-4 of what all modes lose

# Status codes; `phasemap.results.status.Status` says them in words.
GOOD = 0
NO_STABLE_ORBIT = 1
NOT_CONVERGED = 2
UNSTABLE = 3
NOT_SETTLED = 4
INVALID = 5
TOO_MANY_CONTACTS = 6
NO_AVERAGED_ORBIT = 7
CREATES_ENERGY = 8
OUT_OF_RANGE = 9
DIVERGED = 10
NOT_ENGAGED = 11
PENDING = -1  # between two kernels only

# Solver codes.
AVERAGING = 0
ORBIT = 1
MARCH = 2
INTERPOLATED = 3
CORRECTED = 4

ATTRACTING = 0  # on each branch, in the order of the codes of `branch`
REPELLING = 1
ENGAGED = 2  # what engagement from far finds
SLOTS = 3
NOWHERE = -1  # of a tip that has not been engaged
UNKNOWN_ORBIT = -1  # whether a material has an orbit: neither 0 nor 1


def is_mean(rows: np.ndarray) -> np.ndarray:
    """True if a result row, shape (..., COLUMNS), is the mean of motion that came to no periodic orbit."""
    spreads: np.ndarray = rows[..., SPREAD_AMPLITUDE] > 0
    return spreads


def is_repulsive(rows: np.ndarray) -> np.ndarray:
    """True if a result row, shape (..., COLUMNS), is on the repulsive branch; False also where there is none."""
    repelled: np.ndarray = rows[..., STIFFENING] > 0
    return repelled


class StableOrbits(NamedTuple):
    """Stable orbits that hold the setpoint, on each branch, for n materials."""

    # int, shape (2, n); whether a material has an orbit that holds the setpoint on each branch: 1, 0 or UNKNOWN_ORBIT
    stable: np.ndarray
    engaged: np.ndarray  # int, shape (n,); branch to which engagement from far leads, or NOWHERE
    offsets: np.ndarray  # shape (3, n); tip offsets of the orbits [m]
    reach: np.ndarray  # shape (2, n); highest tip offset [m] from which a tip comes to each; infinite: from any


class ErrorLimits(NamedTuple):
    """Largest estimated errors with which an orbit by passes, or an averaged one, may stand."""

    phase: float  # [rad]
    tip_offset: float  # [m]


class SolvedRows(NamedTuple):
    """Wide rows of the tip, whose integrals are to be filled in."""

    rows: np.ndarray  # shape (n, WIDE)
    averaged: np.ndarray  # bool, shape (n,); whether a row has the harmonic orbit only
    kept: np.ndarray  # rows with nodes of the orbits where COUNT is above 0, shape (n, KEEPING) or (1, 0)
