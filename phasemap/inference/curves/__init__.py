"""Fits of measured curves: material properties whose simulated sweep matches the measured one.

`data` holds what was measured and says what may be fitted; `recorded` makes it of a file. `residuals` compares it with
the stable branches and finds the best parameters, and `result` judges them and is what the user gets.
"""
