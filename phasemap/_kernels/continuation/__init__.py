"""Exact orbits along a curve, through its folds.

`path` has the points of a curve and the way to an orbit across it, `start` where it begins, `step` goes on by one
orbit, with the `cubic` between two, `piece` from one end to the other.
"""
