"""Exact orbits along a curve, through its folds.

`path` says how the law and the lever change along it, `start` where it begins, `step` goes on by one orbit, with the
`cubic` between two, `piece` from one end to the other.
"""
