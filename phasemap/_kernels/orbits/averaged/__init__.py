"""Orbits to first order: a harmonic motion under the averaged force.

`harmonics` integrates the force over one oscillation, `orbits` finds the heights at which an amplitude is held,
`row` writes down what is recorded there.
"""
