"""Validation: how far the numbers are to be trusted.

`checking` looks at every pixel of a file and solves some of them again.
"""
