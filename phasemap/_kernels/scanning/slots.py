"""Places of a material's orbits that hold the setpoint."""

ATTRACTING, REPELLING = 0, 1  # on each branch, in the order of the codes of `branch`
ENGAGED = 2  # what engagement from far finds
SLOTS = 3
NOWHERE = -1  # of a tip that has not been engaged
