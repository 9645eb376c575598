"""Which orbit holds the setpoint: the one on which a tip ends that comes from far.

`averaged` is asked first, and where it is sure that is the answer; `resonance` says which side of the resonance is
meant, `leap` where a lever lands that is carried over it, and `response` decides by exact orbits where the averaged
ones leave it open, if need be by those at the `end` of the attractive branch. Where this is not sure either, `exact`
follows the curve of exact orbits from far, `rest` says what becomes of a tip that loses its orbit, and where no
periodic orbit is left `in_time` marches: `lowering` is how the tip comes to the setpoint then, `holding` how it stays
there, `averages` what a lock-in shows, and `stuck` recognises a tip that sticks.
"""
