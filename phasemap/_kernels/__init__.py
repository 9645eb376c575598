"""Compiled code. Units, names and files are unknown here: float64 arrays in, float64 arrays and status codes out."""
