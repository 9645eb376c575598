"""Validation: how far the numbers are to be trusted.

`checking` looks at every pixel of a file and solves it again, some also in time.
"""
