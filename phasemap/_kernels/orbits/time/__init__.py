"""The equation of motion, marched in time.

`tip` names the state of a tip and what a period gives. `march` takes a period: `period` step by step to what happens in
it, `runge_kutta` each step of a lever with any number of modes (`modes`), `free_flight` where nothing acts on it.
`step_density` says how long those are. What the surface does is a plug-in, `contact`: `elastic`, or `relaxing`, with
what happens to it (`relaxing_events`), the lengths of its steps (`relaxing_steps`), its arms and its `surface_memory`.

`period_map` finds periodic orbits by Newton's method on marched periods, whose derivative `linear_map` solves;
`many_periods` takes several at once, `landing` waits until the motion is periodic again.
"""
