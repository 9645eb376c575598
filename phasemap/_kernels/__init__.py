"""Compiled code. Nothing in here knows units, names or files: float64 arrays in, float64 arrays and status codes out."""
