"""Which orbit holds the setpoint: the one on which a tip ends that comes from far. Three rungs answer.

`averaged`: averaging, where its decision has a margin; `resonance` says which side of the resonance is meant, `leap`
where a lever is carried over it, `rebound` where a tip keeps a time of its own. What it leaves open the `end` of the
attractive branch may decide, sought among orbits of the lever's response (`response`).

`exact`: the curve of exact orbits, with its folds.

`in_time`: time. `lowering` is how the tip comes to the setpoint, `holding` how it stays there, `averages` what a
lock-in shows, `stuck` recognises a tip that sticks, and `ringing` lowers levers that ring for long.
"""
