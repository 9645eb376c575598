"""The equation of motion, marched in time.

`tip` names the state of a tip and what a period gives. `runge_kutta` has the coefficients, `step_density` the lengths
of steps, `march` takes them and finds each contact; over a surface with memory `remembering` does, whose address
`compiled_memory` has. `modes` has what a lever of several modes adds, `free_flight` its exact flights. `period_map`
finds periodic orbits by Newton's method on marched periods, whose derivative `linear_map` solves. `landing` waits until
the motion is periodic again.
"""
