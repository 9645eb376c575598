"""Loops over materials: a problem's rows in, result rows out; the only kernels that Python calls for them.

`by_response` has the averaged orbits and those by the lever's response, also on the branch that the tip is not on,
`by_collocation` those by collocation, also at what the detector shows, and integrals over those that are solved,
`marched` those in time; `derivatives` those on a branch that is known, `collocation_derivatives` the same in liquid.
"""
