"""Solvers of a periodic orbit, given a guess of it.

`averaged` gives it to first order, `response` exactly by the lever's response to the force (the fast way),
`collocation` exactly by Newton's method on elements (the sure way). `time` marches the equation of motion, which needs
no harmonic and no period. `result_row` is what is kept of an orbit, `energy_balance` what is missing of its energy,
`orbit_nodes` its nodes, `integrals` what is integrated over them.
"""
