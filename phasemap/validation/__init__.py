"""Validation: how far the numbers are to be trusted.

`bench` measures speed against error, beside other integrators and against orbits found by other means;
`checking` looks at every pixel of a file and solves some of them again. Its reference shares no code with what
it judges.
"""
