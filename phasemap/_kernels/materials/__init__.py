"""Neighbours among materials.

`distinct` finds which rows are the same, `interpolate` evaluates what was interpolated between rows.
"""
