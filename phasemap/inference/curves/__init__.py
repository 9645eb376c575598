"""Fitting of measured curves: what a material must be for the sweep to look as it was measured.

`data` holds what was measured and says what may be fitted, `problem` compares it with the stable orbits, `solve` looks
for the best parameters and what is known of them, `verdict` judges, and `result` is what the user gets.
"""
