"""The equation of motion, marched in time.

`tip` names the state of a tip, what a period gives, and how that changes with the state. `march` takes a period over
any surface: `equation_of_motion` step by step to what happens in it, `runge_kutta` each step of a lever with any number
of modes (`modes`); `step_density` says how long those are. What the surface does is a plug-in, `contact`: `elastic`,
with or without a `neck`, or `relaxing`, with what happens to it (`relaxing_events`), the lengths of its steps
(`relaxing_steps`), its arms and its `surface_memory`.

`period_map` finds periodic orbits by Newton's method on marched periods; `many_periods` takes several at once, or waits
until the motion is periodic again.
"""
