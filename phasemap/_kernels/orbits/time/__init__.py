"""The equation of motion, marched in time.

`tip` names the state of a tip and what a period gives. `runge_kutta` has the coefficients, `march` takes the steps and
finds each contact; over a surface with memory `remembering` does, whose address `compiled_memory` has. `landing` waits
until the motion is periodic again. `period_map` finds periodic orbits by Newton's method on marched periods.
"""
