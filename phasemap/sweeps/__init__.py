"""Sweeps: one thing is changed slowly, and everything that the tip does on the way is recorded.

`sweep` has the functions that a user calls, `follow` asks for the curves of orbits and goes along them, `dataset`
makes the Dataset. `orbits` gives every orbit at one point, `contrasts` what two materials differ by.
"""
