"""The equation of motion, marched in time.

`runge_kutta` has the coefficients, `march` takes the steps and finds each contact, `landing` waits until the
motion is periodic again. `period_map` finds periodic orbits by Newton's method on marched periods.
"""
