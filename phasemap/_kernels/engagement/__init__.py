"""Orbit that holds the setpoint: the one on which a tip ends that comes from far. Four ways to know, tried in order.

1. `by_averaging`: averaged orbits, where their answer has a margin; `beside_resonance` where a lever is carried over
   its resonance, or a tip rebounds.
2. `by_fold`: the end of the attractive branch, sought among exact orbits by the lever's response.
3. `by_curve`: the curve of exact orbits by collocation, with its folds.
4. `in_time`: the equation of motion, which leads to a `goal`. `lowering` is how the tip comes to the setpoint,
   `holding_in_time` and `holding_mean` how it stays there, `averages` what a lock-in shows, `stuck` recognises a tip
   that sticks; `second_drive` has the loops of a second mode that is driven too.

`at_detected_amplitude` is for a detector that does not see the tip itself, `other_branch` finds the orbit that
engagement does not, `orbit_of_row` solves again for that of a result row.
"""
