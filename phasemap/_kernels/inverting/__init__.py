"""Kernels of the inversion: one orbit on a branch that is known, with its derivatives."""
