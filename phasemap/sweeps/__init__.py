"""Sweeps: one quantity changes slowly, and every orbit on the way is recorded.

`sweep` has the functions that a user calls, and `follow` asks for the curves of orbits, goes along them and makes the
Dataset. `contrasts` has what two materials differ by.
"""
