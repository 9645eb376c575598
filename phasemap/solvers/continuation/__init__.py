"""Curves of orbits: every branch by continuation, and the orbits on them that a slow change up and down visits.

`path` says what is changed and how the law and the lever depend on it, `curves` follows the pieces of a curve,
`whole_curves` looks for all of them, and `visit` goes along them as an experiment does.
"""
