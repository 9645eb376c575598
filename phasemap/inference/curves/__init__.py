"""Fitting of measured curves: what a material must be for the sweep to look as it was measured.

`parameters` says what may be fitted and on which scale, `data` holds what was measured, `branches` gives the stable
orbits at every point measured, `problem` compares the two, `solve` looks for the best parameters and what is known of
them, `result` is what the user gets.
"""
