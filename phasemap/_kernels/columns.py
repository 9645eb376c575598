"""Numbering of what kernels take and give: columns of float64 arrays, and status codes."""

# Columns of a parameter row, shape (ROW,). Contact laws use 0-3, long-range laws 4-7, damping laws 8-11.
CONTACT, LONGRANGE, DAMPING, ROW = 0, 4, 8, 12

# Entries of the lever, shape (4,): omega [1], alpha0 [1], stiffness [N/m], base amplitude u0 [m].
OMEGA, ALPHA0, STIFFNESS, BASE = 0, 1, 2, 3

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
COLUMNS = 13

# Status codes; `phasemap.status.Status` says them in words.
GOOD = 0
NO_STABLE_ORBIT = 1
NOT_CONVERGED = 2
UNSTABLE = 3
NOT_SETTLED = 4
INVALID = 5
TOO_MANY_CONTACTS = 6
NO_AVERAGED_ORBIT = 7
PENDING = -1  # between two kernels only

# Solver codes.
AVERAGING = 0
ORBIT = 1
MARCH = 2
INTERPOLATED = 3
CORRECTED = 4
