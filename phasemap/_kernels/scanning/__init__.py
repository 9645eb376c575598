"""Kernels of scans: the state of the oscillation goes from pixel to pixel."""
