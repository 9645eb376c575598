"""Solvers: a problem in, one row of numbers for each of its materials out.

`problem` makes arrays of what a user described, `solver` has the solvers, and `run` spreads the rows over
threads. `in_time` is asked by all of them where no curve of orbits tells. Where the detector does not see the tip
itself, `seen_by_detector` finds the amplitude that shows as the setpoint. `pixel` is the shortest way to an answer;
`both_branches` and `continuation` ask for more than the orbit that a tip from far ends on.
"""
