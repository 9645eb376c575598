"""Curves of orbits: every branch by continuation, and what a slow change up and down visits of them.

`path` says what is changed and how the law and the lever depend on it, `pieces` follows the curves and `complete`
looks for those that are left. `visit` goes along them as an experiment does, `slow_feedback` where a controller holds
the setpoint, `off_orbit` where the motion is not periodic.
"""
