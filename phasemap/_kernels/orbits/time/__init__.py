"""The equation of motion, marched in time.

`tip` names the state of a tip and what a period gives. `march` takes a period: `period` step by step to what happens in
it, `runge_kutta` each step of a lever with any number of modes (`modes`), `free_flight` where nothing acts on it.
`step_density` says how long those are. What the surface does is a plug-in, `contact`: `elastic`, or `relaxing`, with
what happens to it (`relaxing_events`), its steps and its memory (`elements`), whose address `compiled_memory` has.

`period_map` finds periodic orbits by Newton's method on marched periods, whose derivative `linear_map` solves;
`landing` waits until the motion is periodic again.
"""
