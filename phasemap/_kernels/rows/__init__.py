"""Loops over materials: a problem's rows in, result rows out; the only kernels that Python calls for them.

`fast` has the averaged orbits and those by the lever's response, also on the branch that the tip is not on, `exact`
those by collocation, `marched` those in time, `seen` those at which the detector shows the setpoint, `derivatives`
those on a branch that is known, and `integrals` what is pixels of an orbit that is solved.
"""
