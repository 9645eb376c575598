"""Loops over materials: a problem's rows in, result rows out; the only kernels that Python calls for them.

`fast` has the averaged orbits and those by the lever's response, `exact` those by collocation, `marched` those in
time, `seen` those at which the detector shows the setpoint, `nearby` those that begin from a neighbour. `other_branch`
and `other_branch_exact` ask for the orbit that the tip is not on, `branch_known` and `derivatives` for one on a branch
that is known. `along_orbit` has the nodes for integrals over an orbit, `forces` and `adhesion` these.
"""
