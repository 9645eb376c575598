"""Exact orbits along a curve, through its folds.

`point` has the points of a curve, where it begins and the way to an orbit across it, `step` goes on by one orbit, with
the `cubic` between two, `piece` from one end to the other.
"""
