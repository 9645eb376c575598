"""Which orbit holds the setpoint: the one on which a tip ends that comes from far. Three rungs answer.

`branch_by_averaging`, where its decision has a margin, with `beside_resonance` where a lever is carried over its
resonance or a tip rebounds. What it leaves open the end of the attractive branch may decide, sought among orbits of the
lever's response (`by_response`).

`by_collocation`: the curve of exact orbits, with its folds.

`in_time`: time, which leads to a `goal`. `lowering` is how the tip comes to the setpoint, `holding` and `holding_mean`
how it stays there, `averages` what a lock-in shows, `stuck` recognises a tip that sticks; `second_drive` has the loops
of a second mode that is driven too.

`detected_setpoint` is for a detector that does not see the tip itself, `other_branch` finds the orbit that engagement
does not, `orbit_of_row` solves again for that of a result row.
"""
