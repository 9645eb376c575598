"""Orbits to first order: a harmonic motion under the averaged force.

`harmonics` integrates the force over one oscillation, `orbits` finds the heights at which an amplitude is held, `sides`
the one on a side of the resonance, `branch` the one near a guess.
"""
